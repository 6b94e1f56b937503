"""Scripts of gmsh (.geo files): refuse those that could run commands of the system."""

import os
import re
from collections.abc import Callable, Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from geom2iga.errors import GeometryError

RUNS = re.compile(r"\b(System|SystemCall|NonBlockingSystemCall|OnelabRun|ExternalProcess)\b")
GAP = r"(?:\s|//[^\n]*\n|/\*(?:[^*]|\*(?!/))*\*/)*"  # white space and comments, in one way only: no backtracking
REDIRECTED = rf"""\bPrintf\b{GAP}\((?:"[^"]*"|'[^']*'|[^"';])*\){GAP}>"""
WRITES = re.compile(rf"{REDIRECTED}|\b(?:Save|Print|CreateDir|LogFileName)\b", re.DOTALL)
INCLUDES = re.compile(r"\b(Include|Merge|MergeWithBoundingBox)\b\s*([^;\n]*)")
LITERAL = re.compile(r'"([^"]*)"\s*')
# what gmsh merges as a CAD model; to it, the rest of what it does not know are scripts, also .BREP or .Step
MODELS = (".step", ".STEP", ".stp", ".STP", ".iges", ".IGES", ".igs", ".IGS", ".brep", ".xao", ".XAO")
TRUST = "read it, and set trusted = true if it may"


def check_script(path: Path) -> None:
    """Raise GeometryError where a script, or one that it includes, runs commands, writes files or includes itself.

    Comments and texts count too: what would have to be told apart could be told apart wrongly.
    """
    included: dict[Path, list[Path]] = {}

    def look(script: Path, text: str) -> None:
        _check_text(script, text)
        included[script] = [each for each, _ in _included(script, text)]

    for script in with_included(path, look):
        if not os.path.isfile(script):  # which is no more than false for a name that is too long
            raise GeometryError(f'"{path}": it includes "{script}", which is not there')
    try:
        TopologicalSorter(included).prepare()
    except CycleError as error:
        raise GeometryError(f'"{error.args[1][0]}": it includes itself, or what includes it: {TRUST}') from None


def with_included(path: Path, look: Callable[[Path, str], None] = lambda path, text: None) -> list[Path]:
    """List a script and the files that it includes by their names, each once, after a look at the text of scripts."""
    scripts, models = [path], list[Path]()
    for script in scripts:  # which grows meanwhile
        text = script.read_text(encoding="utf-8", errors="replace") if os.path.isfile(script) else ""
        look(script, text)
        for included, is_script in _included(script, text):
            kind = scripts if is_script else models
            if included not in kind:
                kind.append(included)
    return list(dict.fromkeys(scripts + models))


def _included(script: Path, text: str) -> Iterator[tuple[Path, bool]]:
    """Yield what the text of a script includes by its name, and whether gmsh reads it as a script."""
    for word, name in INCLUDES.findall(text):
        if literal := LITERAL.fullmatch(name):
            path = Path(os.path.abspath(script.parent / literal[1]))
            yield path, word == "Include" or path.suffix not in MODELS


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
    for _, name in INCLUDES.findall(text):
        if LITERAL.fullmatch(name) is None:
            raise GeometryError(f'"{path}": it includes {name.strip()}, a name that the script makes up: {TRUST}')
