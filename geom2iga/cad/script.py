"""Scripts of gmsh (.geo files): refuse those that could run commands of the system."""

import os
import re
from collections.abc import Callable
from pathlib import Path

from geom2iga.errors import GeometryError

RUNS = re.compile(r"\b(System|SystemCall|NonBlockingSystemCall|OnelabRun|ExternalProcess)\b")
GAP = r"(?:\s|//[^\n]*\n|/\*(?:[^*]|\*(?!/))*\*/)*"  # white space and comments, in one way only: no backtracking
REDIRECTED = rf"""\bPrintf\b{GAP}\((?:"[^"]*"|'[^']*'|[^"';])*\){GAP}>"""
WRITES = re.compile(rf"{REDIRECTED}|\b(?:Save|Print|CreateDir|LogFileName)\b", re.DOTALL)
INCLUDES = re.compile(r"\b(?:Include|Merge|MergeWithBoundingBox)\b\s*([^;\n]*)")
LITERAL = re.compile(r'"([^"]*)"\s*')
TRUST = "read it, and set trusted = true if it may"


def check_script(path: Path) -> None:
    """Raise GeometryError where a script, or one that it includes, runs commands or writes files.

    Comments and texts count too: what would have to be told apart could be told apart wrongly.
    """
    for script in with_included(path, _check_text):
        if not os.path.isfile(script):  # which is no more than false for a name that is too long
            raise GeometryError(f'"{path}": it includes "{script}", which is not there')


def with_included(path: Path, look: Callable[[Path, str], None] = lambda path, text: None) -> list[Path]:
    """List a script and the files that it includes by their names, each once, after a look at the text of each."""
    found = [path]
    for script in found:  # which grows meanwhile
        text = script.read_text(encoding="utf-8", errors="replace") if os.path.isfile(script) else ""
        look(script, text)
        for name in INCLUDES.findall(text):
            literal = LITERAL.fullmatch(name)
            included = Path(os.path.abspath(script.parent / literal[1])) if literal else script
            if included not in found:
                found.append(included)
    return found


def inputs(path: Path) -> list[Path]:
    """List the files that a CAD file stands for: of a script also those that it includes."""
    return with_included(path) if path.suffix.lower() == ".geo" else [path]


def _check_text(path: Path, text: str) -> None:
    """Raise GeometryError where the text of a script runs commands, writes files, or makes up what it includes."""
    for number, line in enumerate(text.splitlines(), start=1):
        if found := RUNS.search(line):
            raise GeometryError(f'"{path}", line {number}: {found[1]} runs a command of the system: {TRUST}')
    if found := WRITES.search(text):
        number = text.count("\n", 0, found.end()) + 1
        raise GeometryError(f'"{path}", line {number}: it writes a file: {TRUST}')
    for name in INCLUDES.findall(text):
        if LITERAL.fullmatch(name) is None:
            raise GeometryError(f'"{path}": it includes {name.strip()}, a name that the script makes up: {TRUST}')
