"""Files for people and scripts beside the solution: summary.json, and tables as CSV."""

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from geom2iga.files import replacing
from geom2iga.seal import digest_of
from solve.newton import Step


def write_summary(path: Path, summary: Mapping[str, Any]) -> None:
    """Write summary.json, with a digest of what it holds; geom2iga.seal.read_sealed reads it."""
    text = json.dumps({**summary, "digest": digest_of(summary)}, indent=2)
    with replacing(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def write_rows(path: Path, names: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write a CSV file with a header; numbers in as many digits as bring them back exactly."""
    with replacing(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows(rows)


def write_history(path: Path, history: Sequence[Step]) -> None:
    """Write history.csv, a row per Newton step."""
    write_rows(path, [field.name for field in fields(Step)], map(asdict, history))
