"""Files of our own carry a digest of what was written into them, so that nothing else is believed.

It tells damage, not forgery: whoever means to can make a digest anew, but no code runs from what we read.
"""

import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import Any

from geom2iga.errors import CaseError

SIZE = 512  # HDF5 looks for its beginning at 0, 512, 1024, ... bytes: what lies before is ours
LINE = re.compile(rb"(geom2iga [a-z ]+) version (\d{1,9})\n")
HDF5 = b"\x89HDF\r\n\x1a\n"  # how such a file, or what lies behind our block, begins
START = 8 * SIZE  # of an HDF5 file of ours, where one of its marks is found although some bytes are damaged
MARKS = re.compile(rb"geom2iga|." + re.escape(HDF5), re.DOTALL)  # somebody else's begins with what HDF5 begins with
MARKS_OF_SUMMARY = re.compile(rb'"(digest|stamp|newton_iterations)"')  # anywhere in a summary.json of ours
ANEW = "make it anew"
# of a summary: what no two runs have in common, or not those that were cut off and gone on with
PASSING = ("seconds", "peak_memory", "linear_iterations", "factorisations")


def seal(form: str, version: int, content: bytes | memoryview) -> bytes:
    """Make the block that comes before the content of a file: two lines of text, then zeros.

    >>> seal("geom2iga example", 1, b"").splitlines()[0]
    b'geom2iga example version 1'
    """
    return _block(form, version, hashlib.sha256(content).hexdigest())


def _block(form: str, version: int, digest: str) -> bytes:
    return f"{form} version {version}\nsha256 {digest}\n".encode().ljust(SIZE, b"\0")


@contextmanager
def unsealed(path: Path, form: str, version: int, remedy: str = ANEW) -> Iterator[BufferedReader]:
    """Open a sealed file once all its bytes are known to be those that were written.

    Parameters
    ----------
    form, version
        What it must be.
    remedy : str
        What to do otherwise.

    Raises
    ------
    CaseError
        It is missing, no file, cannot be read, is of another form or version, or damaged.
    """
    with readable(path, remedy) as file:
        block = file.read(SIZE)
        if fault := _fault(block, form, version):
            raise CaseError(f"{path}: {fault}; {remedy}")
        try:
            digest = hashlib.file_digest(file, "sha256").hexdigest()  # in small pieces
        except OSError as error:
            raise _unreadable(path, error) from None
        if block != _block(form, version, digest):
            raise CaseError(f"{path}: damaged, its bytes are not those that were written; {remedy}")
        yield file


@contextmanager
def readable(path: Path, remedy: str = ANEW) -> Iterator[BufferedReader]:
    """Open a file; raise CaseError where there is none that can be read."""
    try:
        check_no_folder(path)
        if path.exists() and not path.is_file():
            raise CaseError(f"{path}: a pipe or device, no file; remove it and {remedy}")
        file = path.open("rb")
    except FileNotFoundError:
        raise CaseError(f"{path}: no such file; {remedy}") from None
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from None
    with file:
        yield file


def check_no_folder(path: Path) -> None:
    """Raise CaseError where a folder has the name of a file."""
    if path.is_dir():
        raise CaseError(f"{path}: a folder, expected a file; move it away or choose another output folder")


def check_ours(path: Path) -> None:
    """Raise CaseError where something that we did not write has the name of a file of ours.

    A file of ours that is damaged is still known for one, unless nothing that marks it is left; an empty file or
    one of zeros is nobody's, a link or pipe holds nothing that could be lost.
    """
    check_no_folder(path)
    if not path.is_file():
        return
    with readable(path) as file:
        content, marks = (file.read(START), MARKS) if path.suffix == ".h5" else (file.read(), MARKS_OF_SUMMARY)
    if content.strip(b"\0") and not marks.search(content):
        raise CaseError(
            f"{path}: not written by this program, or damaged beyond recognition; move it away or name another folder "
            "with -o"
        )


def made_folder(folder: Path) -> None:
    """Make a folder where there is none yet; raise CaseError where something else has its name."""
    where = "move it away or choose another output folder (-o)"
    if folder.exists() and not folder.is_dir():
        raise CaseError(f"{folder}: a file, not a folder; {where}")
    if folder.is_symlink() and not folder.exists():
        raise CaseError(f"{folder}: a link that leads nowhere; {where}")
    folder.mkdir(parents=True, exist_ok=True)


def _unreadable(path: Path, error: OSError | ValueError) -> CaseError:
    reason = getattr(error, "strerror", None) or str(error)
    return CaseError(f"{path}: cannot be read ({reason.lower()}); mend that or remove it")


def _fault(block: bytes, form: str, version: int) -> str | None:
    """Say what the first block of a file shows it to be, None if it is what it must be."""
    if not block:
        return "empty"
    if block.startswith(HDF5):
        return f'written by an older version or by another program, expected "{form}" version {version}'
    line = LINE.match(block)
    if not line:
        return f'no "{form}" file, or damaged at its beginning'
    found, number = line[1].decode(), int(line[2])
    if found != form:
        return f'expected "{form}", found "{found}"'
    if number != version:
        age = "an older" if number < version else "a newer"
        return f'written by {age} version: expected "{form}" version {version}, found version {number}'
    return None


def digest_of(values: Mapping[str, Any]) -> str:
    """Hash what a JSON file holds, but for its digest and for what no two runs have in common.

    >>> digest_of({"dofs": 3, "seconds": 1.0}) == digest_of({"dofs": 3, "digest": "x"}) != digest_of({"dofs": 4})
    True
    """
    lasting = {key: value for key, value in values.items() if key not in ("digest", *PASSING)}
    return hashlib.sha256(json.dumps(lasting).encode()).hexdigest()


def read_sealed(path: Path, remedy: str = ANEW) -> dict[str, Any]:
    """Read a JSON file that holds its digest; raise CaseError where it is missing, damaged or somebody else's."""
    with readable(path, remedy) as file:
        try:
            values = json.load(file)
            known = values["digest"] == digest_of(values)
        except OSError as error:
            raise _unreadable(path, error) from None
        except (AttributeError, LookupError, RecursionError, TypeError, ValueError):
            known = False
    if not known:
        raise CaseError(f"{path}: damaged, or not written by this program; {remedy}")
    return values


def listed(path: Path) -> set[str]:
    """Return which files of the "files" of a sealed JSON file lie beside it; none where it cannot be believed.

    Names are those of entries of its own folder, never paths.
    """
    try:
        names = set(read_sealed(path)["files"])
        return {entry.name for entry in os.scandir(path.parent) if entry.name in names and _goes(entry)}
    except (CaseError, LookupError, OSError, TypeError):
        return set()


def _goes(entry: os.DirEntry[str]) -> bool:
    """Say whether removing an entry removes no more than itself: a link goes, what it leads to stays."""
    return entry.is_symlink() or entry.is_file()
