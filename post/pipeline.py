"""The command iga-run: all three stages in a row."""

from collections.abc import Sequence

from geom2iga import __main__ as geometry
from geom2iga.stage import run_command
from post import __main__ as post
from solve import __main__ as solution

STAGES = (geometry.STAGE, solution.STAGE, post.STAGE)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command("Run a case file from geometry to pictures.", STAGES, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
