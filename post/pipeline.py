"""The command iga-run: all three stages in a row."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from geom2iga import __main__ as geometry
from geom2iga.files import read_model
from geom2iga.stage import run_command
from geom2iga.tables import Case, checked
from post import __main__ as post
from post.case import PostCase
from post.wanted import check_wanted
from solve import __main__ as solution
from solve.case import SolveCase


def solve_what_can_be_shown(case: Case, folder: Path, stamp: str) -> None:
    """Solve, but first check that what is asked for exists."""
    model, contacts = read_model(folder / geometry.FILE), checked(case, SolveCase).solve.contact
    check_wanted(model, contacts, checked(case, PostCase))
    solution.run(case, folder, stamp)


STAGES = (geometry.STAGE, replace(solution.STAGE, run=solve_what_can_be_shown), post.STAGE)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command("Run a case file from geometry to pictures.", STAGES, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
