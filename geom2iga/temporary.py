"""Names of files that are being written, told from all others so that what is left of them can be removed."""

import os
import re
from pathlib import Path

NAME = re.compile(r"\..+\.\d+\.unfinished(\.\w+)?")


def temporary_path(path: Path) -> Path:
    """Name a file beside another, of the same ending, that this process alone writes.

    >>> NAME.fullmatch(temporary_path(Path("out/solution.h5")).name) is not None
    True
    """
    return path.with_name(f".{path.stem}.{os.getpid()}.unfinished{path.suffix}")


def remove_temporaries(folder: Path) -> None:
    """Remove what runs that were cut off left in a folder that no other run writes to."""
    for path in folder.iterdir():
        if NAME.fullmatch(path.name):
            path.unlink(missing_ok=True)
