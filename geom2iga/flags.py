"""The flags of the commands, their help, and their completion in the shell."""

import argparse
from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

SHELLS = ("bash", "zsh", "tcsh")
CASE_FILES = {"bash": "_iga_cases", "zsh": "_files -g '*.toml'", "tcsh": "f:*.toml"}
FOLDERS = {"bash": "_iga_folders", "zsh": "_files -/", "tcsh": "d"}
PREAMBLE = {
    "bash": """_iga_folders() { compgen -d -- "$1"; }
_iga_cases() { compgen -d -- "$1"; compgen -f -X '!*.toml' -- "$1"; }"""
}

EXIT_CODES = """exit codes:
  0 done, or up to date      3 geometry that cannot become blocks   5 a [[verify]] entry missed
  1 our bug                  4 not converged                        130 interrupted
  2 wrong command or case"""


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
            "-o", "--output", type=Path, metavar="DIR", help="output folder, <case>.out beside the case"
        ),
        FOLDERS,
    )
    running.add_argument("-n", "--dry-run", action="store_true", help="check the case, say what would be done, stop")
    running.add_argument("-f", "--force", action="store_true", help="run even what is up to date")
    for add in flags:
        add(running)
    talking = parser.add_argument_group("what to say")
    talking.add_argument("-q", "--quiet", action="store_true", help="print errors only")
    talking.add_argument("-v", "--verbose", action="store_true", help="print details")
    talking.add_argument("--json", action="store_true", help="print the summary on standard output")
    alone = parser.add_argument_group("instead of running a case").add_mutually_exclusive_group()
    _file(
        alone.add_argument("--new", type=Path, metavar="DIR", help="write a case to begin with into a folder"), FOLDERS
    )
    alone.add_argument("--schema", action="store_true", help="print the JSON schema of the case file, for editors")
    alone.add_argument(
        "--print-completion", choices=SHELLS, metavar="SHELL", help=f"print completion for {', '.join(SHELLS)}"
    )
    alone.add_argument("--version", action="version", version=f"{program} {version}")
    return parser


def completion(parser: ArgumentParser, shell: str) -> str:
    """Return a script that completes the command in a shell."""
    import shtab  # seldom needed

    return shtab.complete(parser, shell, preamble=PREAMBLE.get(shell, ""))


def _file(action: argparse.Action, completed: dict[str, str]) -> None:
    """Say what files or folders stand in an argument."""
    action.complete = completed  # type: ignore[attr-defined]
