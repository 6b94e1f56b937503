"""The flags of the commands, their help, and their completion in the shell."""

import argparse
from argparse import ArgumentParser
from collections.abc import Callable, Mapping, Sequence
from math import inf, nan
from pathlib import Path
from string import ascii_letters
from typing import Any

SHELLS = ("bash", "zsh", "tcsh")
CASE_FILES = {"bash": "_iga_cases", "zsh": "_files -g '*.toml'", "tcsh": "f:*.toml"}
FOLDERS = {"bash": "_iga_folders", "zsh": "_files -/", "tcsh": "d"}
PREAMBLE = {
    "bash": """_iga_folders() { compgen -d -- "$1"; }
_iga_cases() { compgen -d -- "$1"; compgen -f -X '!*.toml' -- "$1"; }"""
}

SIZES = {"MB": 1e6, "GB": 1e9}
DURATIONS = {"S": 1.0, "M": 60.0, "H": 3600.0}
MOST_THREADS = 1024

EXIT_CODES = """exit codes:
  0 done, or up to date               3 geometry that cannot become blocks   5 a [[verify]] entry missed
  1 our bug                           4 not converged, or --max-time         130 interrupted, 143 by SIGTERM
  2 wrong command or case, or memory"""


def command_parser(
    program: str, description: str, version: str, flags: Sequence[Callable[[Any], None]]
) -> ArgumentParser:
    """Make the parser of a command.

    Parameters
    ----------
    flags : functions
        Add the flags of the stages.
    """
    examples = [("--new first", "write a case to begin with"), ("first/case.toml", "run it")]
    lines = [f"  {program} {arguments:<18} {meaning}" for arguments, meaning in examples]
    parser = ArgumentParser(
        prog=program,
        description=description,
        epilog="\n".join(["examples:", *lines, "", EXIT_CODES]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _file(parser.add_argument("case", nargs="?", type=Path, help="case file (TOML)"), CASE_FILES)
    running = parser.add_argument_group("what to do")
    _file(
        running.add_argument(
            "-o", "--output", type=folder, metavar="DIR", help="output folder, <case>.out beside the case"
        ),
        FOLDERS,
    )
    running.add_argument("-n", "--dry-run", action="store_true", help="check the case, say what would be done, stop")
    running.add_argument("-f", "--force", action="store_true", help="run even what is up to date")
    for add in flags:
        add(running)
    _limits(parser)
    talking = parser.add_argument_group("what to say")
    talking.add_argument("-q", "--quiet", action="store_true", help="print errors only")
    talking.add_argument("-v", "--verbose", action="store_true", help="print details")
    talking.add_argument("--json", action="store_true", help="print the summary on standard output")
    alone = parser.add_argument_group("instead of running a case").add_mutually_exclusive_group()
    _file(
        alone.add_argument("--new", type=folder, metavar="DIR", help="write a case to begin with into a folder"),
        FOLDERS,
    )
    alone.add_argument("--schema", action="store_true", help="print the JSON schema of the case file, for editors")
    alone.add_argument(
        "--print-completion", choices=SHELLS, metavar="SHELL", help=f"print completion for {', '.join(SHELLS)}"
    )
    alone.add_argument("--version", action="version", version=f"{program} {version}")
    return parser


def _limits(parser: ArgumentParser) -> None:
    """Add the flags for memory, time and threads."""
    taking = parser.add_argument_group("what it may take")
    taking.add_argument(
        "--max-memory", type=size, metavar="GB", help="resident memory in GB, or 500MB, 2GB; what ended before is kept"
    )
    taking.add_argument(
        "--max-time", type=duration, metavar="SECONDS", help="wall-clock time in seconds, or 10m, 2h; likewise"
    )
    taking.add_argument(
        "--threads", type=count, metavar="N", help="threads, in place of OMP_NUM_THREADS; else one per processor"
    )


def size(text: str) -> float:
    """Read a size [bytes], in GB where no unit is given.

    >>> size("2"), size("500MB"), size("1.5GB")
    (2000000000.0, 500000000.0, 1500000000.0)
    """
    return _positive(text, SIZES, "GB", "a size such as 2, 2GB or 500MB")


def duration(text: str) -> float:
    """Read a duration [seconds], in seconds where no unit is given.

    >>> duration("90"), duration("10m"), duration("2h")
    (90.0, 600.0, 7200.0)
    """
    return _positive(text, DURATIONS, "S", "a duration such as 90, 10m or 2h")


def folder(text: str) -> Path:
    """Read the name of a folder; an empty one, as of a variable that is not set, would be the current folder."""
    if not text:
        raise argparse.ArgumentTypeError("empty, name a folder")
    return Path(text)


def count(text: str) -> int:
    """Read a number of threads."""
    if not text.isdecimal() or not 1 <= int(text) <= MOST_THREADS:
        raise argparse.ArgumentTypeError(f'"{text}": expected a whole number from 1 to {MOST_THREADS}')
    return int(text)


def _positive(text: str, units: Mapping[str, float], usual: str, expected: str) -> float:
    """Read a positive number with a unit or without."""
    number = text.rstrip(ascii_letters)
    try:
        value = float(number) * units[text[len(number) :].upper() or usual]
    except (KeyError, ValueError):
        value = nan
    if not 0 < value < inf:
        raise argparse.ArgumentTypeError(f'"{text}": expected {expected}')
    return value


def completion(parser: ArgumentParser, shell: str) -> str:
    """Return a script that completes the command in a shell."""
    import shtab  # seldom needed

    return shtab.complete(parser, shell, preamble=PREAMBLE.get(shell, ""))


def _file(action: argparse.Action, completed: dict[str, str]) -> None:
    """Say what files or folders stand in an argument."""
    action.complete = completed  # type: ignore[attr-defined]
