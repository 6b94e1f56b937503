"""What may happen to a run, and how it may end then."""

import shutil
import signal
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.robustness.disks import fill, read_only
from tests.robustness.runs import Run

OPERATIONS = 95  # about as many openings, renamings and removals of files as a run does
AT_OPERATION = """
import errno, os, signal, sys
number = 0
def look(event, arguments):
    global number
    if event not in ("open", "os.rename", "os.remove") or not str(arguments[0]).startswith({out!r} + "/"):
        return
    if event == "open" and not arguments[2] & (os.O_WRONLY | os.O_RDWR):
        return
    number += 1
    if {way!r} == "full":
        if number >= {which} and event != "os.remove":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), arguments[0])
    elif number == {which}:
        os.kill(os.getpid(), getattr(signal, {way!r}))
sys.addaudithook(look)
"""

Happen = Callable[[Run, Path, Any, ExitStack], list[str]]


@dataclass(frozen=True)
class Kind:
    """One way to interrupt a run.

    Parameters
    ----------
    codes : tuple of int
        With which it may end, beside 0 where it had ended already, or had nothing left to do.
    happen : function of (run, output folder, random, stack)
        Interrupts it, and returns what went wrong; the stack undoes it once the run has ended.
    inside : str
        What to do at one of its operations on files instead: a signal, or "full".
    keeps : bool
        Whether what had ended is still there.
    mounts : bool
        Whether it needs a file system of its own.
    """

    codes: tuple[int, ...]
    happen: Happen
    inside: str = ""
    keeps: bool = True
    mounts: bool = False

    def before(self, out: Path, random: Any) -> str:
        """Python that the process runs first."""
        return self.inside and AT_OPERATION.format(out=str(out), way=self.inside, which=random.integers(1, OPERATIONS))


def _nothing(run: Run, out: Path, random: Any, stack: ExitStack) -> list[str]:
    return []


def _signal(number: signal.Signals, times: int = 1) -> Happen:
    """Send a signal."""

    def happen(run: Run, out: Path, random: Any, stack: ExitStack) -> list[str]:
        for _ in range(times):
            run.send(number)
            run.wait(random.uniform(0, 0.1))
        return []

    return happen


def _fill(run: Run, out: Path, random: Any, stack: ExitStack) -> list[str]:
    """Leave little room on the disk, from nothing to a megabyte."""
    stack.callback(fill(out.parent, int(10 ** random.uniform(0, 6))).unlink)
    return []


def _turn_read_only(run: Run, out: Path, random: Any, stack: ExitStack) -> list[str]:
    out.mkdir(exist_ok=True)
    stack.enter_context(read_only(out))
    return []


def _remove(run: Run, out: Path, random: Any, stack: ExitStack) -> list[str]:
    shutil.rmtree(out, ignore_errors=True)
    return []


def _run_another(run: Run, out: Path, random: Any, stack: ExitStack) -> list[str]:
    """Run a second one into the same folder: one of both may have to give way, with a sentence."""
    second = Run(run.case, out)
    code, said = second.ended()
    if code == 0 or (code == 2 and f"another run (process {run.number}) is writing there" in said):
        return []
    return [f"the second run ended with {code}: {said}"]


KINDS = {
    "kill": Kind((-signal.SIGKILL,), _signal(signal.SIGKILL)),
    "interrupt": Kind((130, -signal.SIGINT), _signal(signal.SIGINT)),
    "full disk": Kind((2,), _fill, mounts=True),
    "vanishing folder": Kind((2,), _remove, keeps=False),
    "terminate": Kind((143, -signal.SIGTERM), _signal(signal.SIGTERM)),
    "read-only folder": Kind((2,), _turn_read_only, mounts=True),
    "kill at a file": Kind((-signal.SIGKILL,), _nothing, inside="SIGKILL"),
    "second run": Kind((2,), _run_another),
    "interrupt twice": Kind((130, -signal.SIGINT), _signal(signal.SIGINT, 2)),
    "full disk at a file": Kind((2,), _nothing, inside="full"),
    "interrupt at a file": Kind((130,), _nothing, inside="SIGINT"),
    "hang up": Kind((129, -signal.SIGHUP), _signal(signal.SIGHUP)),
}
