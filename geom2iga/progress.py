"""Bars of long jobs, on a terminal, where a command has turned them on.

Without that, in other people's programs and in notebooks, nothing is drawn, timed or imported, and no thread runs.
"""

import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from datetime import timedelta
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rich.console import Console
    from rich.live import Live
    from rich.table import Table

DELAY = 2.0  # seconds that a job goes on before it gets a bar
WIDTH = 30  # of a bar [characters]

log = logging.getLogger("geom2iga")

T = TypeVar("T")
Advance = Callable[[float], None]


@contextmanager
def progress(text: str, total: float | None = None) -> Iterator[Advance]:
    """Show a bar for what happens inside, if it takes longer than two seconds; yield what moves it on.

    Parameters
    ----------
    text : str
        What is done, in a word or two.
    total : float
        How much there is to do; left out, nobody knows.

    Examples
    --------
    >>> with progress("cells", total=100) as advance:
    ...     advance(25)
    """
    jobs = _JOBS.get()
    if jobs is None:
        yield _ignored
    else:
        with jobs.opened(text, total) as job:
            yield job.advance


def tracked(items: Iterable[T], text: str, total: float | None = None) -> Iterator[T]:
    """Go through items and show how many are done; without a bar where there is only one.

    >>> [2 * number for number in tracked([1, 2], "numbers")]
    [2, 4]
    """
    if total is None and isinstance(items, Sized):
        total = len(items)
    if total is not None and total < 2:
        yield from items
        return
    with progress(text, total) as advance:
        for item in items:
            yield item
            advance(1)


def noted(text: str) -> None:
    """Write something beside the bar of the innermost job, such as how far an iteration has got."""
    jobs = _JOBS.get()
    if jobs is not None:
        jobs.note(text)


def hide() -> None:
    """Wipe the bars away and give the cursor back, where the process is about to end in the middle of a job."""
    jobs = _JOBS.get()
    if jobs is not None:
        jobs.hide()


@contextmanager
def turned_on(console: "Console | None") -> Iterator[None]:
    """Let jobs inside show bars on a terminal, and log how long each took that is no part of another one.

    Parameters
    ----------
    console : Console or None
        What prints all else on that terminal, so that nothing is torn; None: no bars.
    """
    jobs = Jobs(console)
    token = _JOBS.set(jobs)
    try:
        yield
    finally:
        _JOBS.reset(token)
        jobs.hide()


def _ignored(count: float) -> None:
    """Show nothing."""


@dataclass(eq=False)
class Job:
    """Something under way."""

    text: str
    total: float | None
    done: float = 0.0
    note: str = ""
    began: float = field(default_factory=time.perf_counter)

    @property
    def seconds(self) -> float:
        """How long it has gone on."""
        return time.perf_counter() - self.began

    def advance(self, count: float) -> None:
        """Put down that more of it is done."""
        self.done += count

    @property
    def count(self) -> str:
        """How much is done, of how much."""
        return f"{self.done:g}" + ("" if self.total is None else f"/{self.total:g}") if self.done or self.total else ""

    @property
    def clock(self) -> str:
        """How long it has gone on, and may yet."""
        left = self.seconds * (self.total - self.done) / self.done if self.total and self.done else None
        return _clock(self.seconds) + ("" if left is None else f", {_clock(left)} left")


def _clock(seconds: float) -> str:
    """Hours, minutes and seconds."""
    return str(timedelta(seconds=round(seconds)))


class Jobs:
    """Jobs under way, each inside the one before, and their bars from the moment on that the first is old enough."""

    def __init__(self, console: "Console | None") -> None:
        self._console, self._open, self._lock = console, list[Job](), threading.Lock()
        self._timer: threading.Timer | None = None
        self._live: Live | None = None

    @contextmanager
    def opened(self, text: str, total: float | None) -> Iterator[Job]:
        """Show a job as long as it lasts."""
        job = Job(text, total)
        self._open.append(job)
        try:
            if len(self._open) == 1 and self._console is not None:
                self._timer = threading.Timer(DELAY, self._show)
                self._timer.daemon = True
                self._timer.start()
            yield job
        finally:
            self._open.remove(job)
            if not self._open:
                self.hide()
                log.debug("%s: %.2f s", text, job.seconds)

    def note(self, text: str) -> None:
        """Write something beside the innermost job."""
        for job in self._open[-1:]:
            job.note = text

    def hide(self) -> None:
        """Wipe the bars away and give the cursor back."""
        with self._lock:
            timer, live = self._timer, self._live
            self._timer = self._live = None
            if timer is not None:
                timer.cancel()
            if live is not None:
                live.stop()

    def _show(self) -> None:
        """Begin to draw, unless the job that this was meant for has ended."""
        from rich.live import Live  # takes its time, and is often not needed

        with self._lock:
            if self._timer is threading.current_thread():
                self._live = Live(
                    get_renderable=self._bars, console=self._console, transient=True, redirect_stdout=False
                )
                self._live.start()

    def _bars(self) -> "Table":
        """Lay out one line for each job that is old enough."""
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        table = Table.grid(padding=(0, 1))
        for job in [job for job in self._open if job.seconds >= DELAY]:
            bar = ProgressBar(job.total, min(job.done, job.total or job.done), width=WIDTH)
            table.add_row(Text(job.text), bar, *(Text(part, "dim") for part in (job.count, job.clock, job.note)))
        return table


_JOBS: ContextVar[Jobs | None] = ContextVar("jobs", default=None)
