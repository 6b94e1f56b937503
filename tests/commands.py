"""A command that does what a test wants."""

from collections.abc import Callable
from pathlib import Path

from geom2iga.stage import Stage, run_command
from geom2iga.tables import Table


class Nothing(Table):
    """What a stage reads that reads nothing."""


def run_fake(folder: Path, *flags: str, work: Callable[[], object] = lambda: None) -> int:
    """Run a command of one stage on a case in a folder; its output goes to case.out beside it."""
    path = folder / "case.toml"
    path.write_text("", encoding="utf-8")
    stage = Stage("fake", Nothing, lambda *_: "inputs", lambda _: None, lambda _: "", lambda *_: work(), lambda _: {})
    return run_command("A fake.", [stage], [str(path), *flags])
