"""The case that --new writes: two blocks in contact, every common key explained."""

import json
import logging
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from geom2iga.errors import CaseError
from geom2iga.files import replacing

CASE, SCHEMA = "case.toml", "case.schema.json"

log = logging.getLogger("geom2iga")


def write_starter(folder: Path, schema: Mapping[str, Any]) -> None:
    """Write a case file, and beside it the schema by which editors complete its keys.

    Raises
    ------
    CaseError
        One of the files is there already, or the name is that of a case file.
    """
    if folder.suffix == ".toml":
        raise CaseError(f"--new {folder} would be a folder of that name: name one without .toml")
    for name in (CASE, SCHEMA):
        if (folder / name).exists():
            raise CaseError(f"{folder / name} is there already and stays as it is: name another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise CaseError(f"{folder} is a file: name a folder") from None
    for name, text in {SCHEMA: json.dumps(schema, indent=2) + "\n", CASE: starter()}.items():
        with replacing(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    log.info("%s is ready; next: iga-run %s", folder / CASE, folder / CASE)


def starter() -> str:
    """Return the text of the case file."""
    return (files("geom2iga") / "starter.toml").read_text(encoding="utf-8")
