"""Scripts of gmsh (.geo files): refuse those that could run commands of the system."""

import re
from pathlib import Path

from geom2iga.errors import GeometryError

RUNS = re.compile(r"\b(System|SystemCall|NonBlockingSystemCall|OnelabRun|ExternalProcess)\b")
GAP = r"(?:\s|//[^\n]*\n|/\*(?:[^*]|\*(?!/))*\*/)*"  # white space and comments, in one way only: no backtracking
REDIRECTED = rf"""\bPrintf\b{GAP}\((?:"[^"]*"|'[^']*'|[^"';])*\){GAP}>"""
WRITES = re.compile(rf"{REDIRECTED}|\b(?:Save|Print|CreateDir|LogFileName)\b", re.DOTALL)
INCLUDES = re.compile(r"\b(?:Include|Merge|MergeWithBoundingBox)\b\s*([^;\n]*)")
TRUST = "read it, and set trusted = true if it may"


def check_script(path: Path, seen: frozenset[Path] = frozenset()) -> None:
    """Raise GeometryError where a script, or one that it includes, runs commands or writes files.

    Comments and texts count too: what would have to be told apart could be told apart wrongly.
    """
    text = path.read_text(encoding="utf-8", errors="replace")
    for number, line in enumerate(text.splitlines(), start=1):
        if found := RUNS.search(line):
            raise GeometryError(f'"{path}", line {number}: {found[1]} runs a command of the system: {TRUST}')
    if found := WRITES.search(text):
        number = text.count("\n", 0, found.end()) + 1
        raise GeometryError(f'"{path}", line {number}: it writes a file: {TRUST}')
    for name in INCLUDES.findall(text):
        literal = re.fullmatch(r'"([^"]*)"\s*', name)
        if literal is None:
            raise GeometryError(f'"{path}": it includes {name.strip()}, a name that the script makes up: {TRUST}')
        included = (path.parent / literal[1]).resolve()
        if not included.is_file():
            raise GeometryError(f'"{path}": it includes "{literal[1]}", which is not there')
        if included not in seen:
            check_script(included, seen | {included})
