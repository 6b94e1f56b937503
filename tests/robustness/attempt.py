"""One run of iga-run on a mutant, in this process, and what was wrong with how it ended."""

import json
import os
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import h5py

from post.pipeline import main
from tests.robustness.cad_parts import FILES, lay_out
from tests.robustness.mutation import Mutant
from tests.robustness.streams import written_to

PATIENCE = "40"  # seconds: a mutant may be a large case, and right
LONGEST = 1500  # characters of a message
ENDINGS = {  # what a whole file ends with
    ".vtu": b"</VTKFile>",
    ".pvd": b"</VTKFile>",
    ".csv": b"\n",
    ".txt": b"\n",
    ".json": b"}",
    ".html": b"</html>",
    ".svg": b"</svg>",
    ".png": b"IEND\xaeB`\x82",
    ".pdf": b"%%EOF",
}


class Ending(NamedTuple):
    """How a run ended: exit code, what it said, and what was wrong, nothing where all was well."""

    code: int
    text: str
    wrong: tuple[str, ...]


def attempted(case: Mutant) -> Ending:
    """Run a mutant in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="mutant") as name:
        folder = Path(name)
        (folder / "case.toml").write_bytes(case.content)
        (folder / "temporary").mkdir()
        lay_out(folder)
        text, code = _run(folder, case.flags)
        wrong = (*_wrong_words(code, text, case), *_wrong_files(folder, code, "-n" in case.flags))
    return Ending(code, text, wrong)


def _run(folder: Path, flags: tuple[str, ...]) -> tuple[str, int]:
    """Run the command there; return all that it and its libraries wrote on standard output and error, and its code."""
    here, before = Path.cwd(), tempfile.tempdir
    with tempfile.TemporaryFile() as said, warnings.catch_warnings():
        warnings.simplefilter("always")
        os.chdir(folder)
        tempfile.tempdir = str(folder / "temporary")
        try:
            with written_to(said.fileno()):
                code = main([*flags, "--max-time", PATIENCE, "case.toml"])
        finally:
            os.chdir(here)
            tempfile.tempdir = before
        said.seek(0)
        return said.read().decode("utf-8", errors="replace"), code


def _wrong_words(code: int, text: str, case: Mutant) -> Iterator[str]:
    """Yield what is wrong with an exit code and with what was said."""
    if code not in (0, 2, 3, 4) and not (code == 5 and b"verify" in case.content):
        yield f"exit {code}"
    if "Traceback" in text or "Warning" in text:
        yield "a traceback or a warning of Python"
    if not text.replace("\n", "").isprintable():
        yield "characters that do not print"
    if "-q" in case.flags:
        expected = "" if code == 0 or not text.strip() else text.rstrip("\n").rpartition("\n")[2] + "\n"
        if text != expected or (code != 0) != bool(text):
            yield "not one message of one line where it failed, and none where it did not"
    if len(text.rstrip("\n").rpartition("\n")[2]) > LONGEST:
        yield f"more than {LONGEST} characters in a line"


def _wrong_files(folder: Path, code: int, dry: bool) -> Iterator[str]:
    """Yield what is wrong with the files left: temporary or half-written ones, missing ones after a success."""
    if left := [path.name for path in (folder / "temporary").iterdir()]:
        yield f"temporary files: {left}"
    if more := {path.name for path in folder.iterdir()} - {*FILES, "case.toml", "case.out", "temporary"}:
        yield f"files beside the case: {sorted(more)}"
    out = folder / "case.out"
    names = sorted(path.name for path in out.iterdir()) if out.is_dir() else []
    for name in names:
        if name.startswith(".") or not _is_whole(out / name):
            yield f"{name} is not whole"
    if code == 0 and not dry:
        listed = json.loads((out / "summary.json").read_text(encoding="utf-8"))["files"]
        if missing := {"geometry.h5", "solution.h5", "log.txt", *listed} - set(names):
            yield f"exit 0 without {sorted(missing)}"
    if dry and names:
        yield f"files of a dry run: {names}"


def _is_whole(path: Path) -> bool:
    """Say whether a file has its end; a file of a kind that iga-run does not write is not whole."""
    if path.suffix == ".h5":
        try:
            h5py.File(path).close()
        except OSError:
            return False
        return True
    ending = ENDINGS.get(path.suffix)
    return ending is not None and path.read_bytes().endswith((ending, ending + b"\n"))
