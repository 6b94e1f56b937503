"""What a command may take: how much memory is free, and an end where more memory or time is taken than allowed.

A thread looks at both many times a second. Where a limit is passed it interrupts the work as Ctrl-C does, so that what
is half done is cleaned up and what has ended is kept; work inside a library that does not listen is cut off.
"""

import logging
import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar, copy_context
from pathlib import Path

import psutil

from geom2iga.errors import CaseError, UserError
from geom2iga.progress import hide
from geom2iga.threads import thread_count

SAMPLING = 0.02  # seconds between two looks
SEARCH = 25  # looks between two searches for child processes
GRACE = 5.0  # seconds from the interruption to the end
BEYOND = 1.1  # of the memory allowed, at which the end comes at once
GIGABYTE = 1e9
UNLIMITED = 2**60  # bytes: version 1 of control groups writes a number of this size where there is no limit

log = logging.getLogger("geom2iga")


class MemoryLimitError(UserError):
    """More memory was taken than --max-memory allows."""


class TimeLimitError(UserError):
    """More time was taken than --max-time allows; as with an analysis that does not converge, load steps are kept."""

    exit_code = 4


@contextmanager
def limited(memory: float | None = None, seconds: float | None = None) -> Iterator[None]:
    """Hold what happens inside, in the main thread, to limits; log how much memory was taken.

    Parameters
    ----------
    memory : float
        Resident memory of this process and all that it starts [bytes]; left out, what the machine has.
    seconds : float
        Wall-clock time; left out, any.

    Raises
    ------
    CaseError
        This process alone has more memory already.
    MemoryLimitError, TimeLimitError
        A limit was passed.
    """
    watch = Watch(memory, seconds)
    if memory is not None and watch.resident() > memory:
        raise CaseError(
            f"--max-memory: the program itself takes {_gigabytes(watch.resident())} GB, {_gigabytes(memory)} GB are "
            "allowed: allow more"
        )
    token = _WATCH.set(watch)
    try:
        with watch.listening():
            yield
    except (KeyboardInterrupt, Exception):
        if watch.reached is None:
            raise
        raise watch.reached from None
    finally:
        _WATCH.reset(token)
        log.debug("%s GB of memory at most, %d threads", _gigabytes(peak_memory()), thread_count())


class Watch:
    """Looks at memory and the clock from a thread of its own.

    Parameters
    ----------
    memory : float
        Allowed [bytes].
    seconds : float
        Allowed, from now on.
    """

    def __init__(self, memory: float | None, seconds: float | None) -> None:
        self.memory, self._seconds, self._began = memory, seconds, time.monotonic()
        self._process, self._ended = psutil.Process(), threading.Event()
        self._children: list[psutil.Process] = []
        self.reached: UserError | None = None  # what ended the work

    def resident(self) -> int:
        """Memory of this process and of the children that are known [bytes]."""
        total = self._process.memory_info().rss
        for child in self._children:
            with suppress(psutil.Error):  # it has ended
                total += child.memory_info().rss
        return total

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Look as long as what is inside goes on, and let it be interrupted."""
        if self.memory is None and self._seconds is None:
            yield
            return
        thread = threading.Thread(target=copy_context().run, args=(self._look,), name="limits", daemon=True)
        before = signal.getsignal(signal.SIGINT)
        if not callable(before):  # a shell has put us into the background, and Ctrl-C is for others
            signal.signal(signal.SIGINT, self._interrupted)
        thread.start()
        try:
            yield
        finally:
            self._ended.set()
            thread.join()
            signal.signal(signal.SIGINT, before)

    def _interrupted(self, *_: object) -> None:
        """End the work if a limit was passed; what else interrupts is ignored as before."""
        if self.reached is not None:
            raise KeyboardInterrupt

    def _look(self) -> None:
        """Interrupt the work where a limit is passed, and end the process if it goes on nevertheless."""
        looks, last = 0, float("inf")
        while not self._ended.wait(SAMPLING):
            if looks % SEARCH == 0:
                self._children = self._process.children(recursive=True)
            looks, taken, now = looks + 1, self.resident(), time.monotonic()
            if self.reached is None:
                self.reached = self._passed(taken, now - self._began)
                if self.reached is not None:
                    last = now + GRACE
                    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
            if self.reached is not None and (now > last or (self.memory and taken > BEYOND * self.memory)):
                self._end(self.reached)

    def _passed(self, taken: float, seconds: float) -> UserError | None:
        """Say which limit is passed, if any."""
        if self.memory is not None and taken > self.memory:
            return MemoryLimitError(
                f"stopped at {_gigabytes(taken, 3)} GB of memory, --max-memory allows {_gigabytes(self.memory, 3)} GB; "
                "what had ended is kept: allow more, or take fewer spans"
            )
        if self._seconds is not None and seconds > self._seconds:
            return TimeLimitError(
                f"stopped after {seconds:.3g} s, --max-time allows {self._seconds:g} s; what had ended is kept: "
                "allow more, or run it again to go on from there"
            )
        return None

    def _end(self, error: UserError) -> None:
        """End this process and its children at once: the main thread is where no interruption reaches it."""
        for child in self._process.children(recursive=True):
            with suppress(psutil.Error):
                child.kill()
        talk = threading.Thread(target=copy_context().run, args=(_say, error), daemon=True)
        talk.start()
        talk.join(1)  # the main thread may hold the lock of what is written to
        os._exit(error.exit_code)


def _say(error: UserError) -> None:
    """Write the last word."""
    hide()
    log.error("%s", error)


def free_memory() -> float:
    """Memory that may still be taken: of the machine, of the container, and of what the command may take [bytes]."""
    return min(psutil.virtual_memory().available, group_memory(), _allowed())


def check_memory(what: str, wanted: float, advice: str) -> None:
    """Raise CaseError where something needs more memory than is free.

    Parameters
    ----------
    what : str
        What it is, in the plural.
    wanted : float
        How much it takes [bytes].
    advice : str
        What to do.
    """
    allowed = _allowed()
    free = min(psutil.virtual_memory().available, group_memory(), allowed)
    if wanted > free:
        whose = " under --max-memory" if free == allowed else ""
        raise CaseError(
            f"{what} need about {_gigabytes(wanted)} GB of memory, {_gigabytes(free)} GB are free{whose}: {advice}"
        )


def _allowed() -> float:
    """What --max-memory leaves [bytes]."""
    watch = _WATCH.get()
    return float("inf") if watch is None or watch.memory is None else max(0.0, watch.memory - watch.resident())


def group_memory(process: Path = Path("/proc/self/cgroup"), root: Path = Path("/sys/fs/cgroup")) -> float:
    """Memory that the control groups of this process, and all around these, have left [bytes]; infinite without any.

    Containers and batch systems hold processes to these; the machine's free memory does not know of them. Of what a
    group has taken, files that were read and could be read again do not count.
    """
    left = float("inf")
    with suppress(OSError):
        for line in process.read_text().splitlines():
            _, kinds, place = line.split(":", 2)
            if kinds in ("", "memory"):
                names = ("memory.max", "memory.current") if not kinds else V1_NAMES
                top = root / kinds
                group = top / place.strip("/")
                for folder in (group, *group.parents):
                    left = min(left, _left_in(folder, *names))
                    if folder == top:
                        break
    return left


V1_NAMES = ("memory.limit_in_bytes", "memory.usage_in_bytes")


def _left_in(folder: Path, most: str, taken: str) -> float:
    """Memory that one control group has left [bytes]."""
    try:
        limit = int((folder / most).read_text())
        if limit >= UNLIMITED:
            return float("inf")
        statistics = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())
        files = int(statistics.get("total_inactive_file", statistics.get("inactive_file", 0)))
        return max(0.0, limit - int((folder / taken).read_text()) + files)
    except (OSError, ValueError):  # no such group, or "max"
        return float("inf")


def peak_memory() -> int:
    """Largest resident memory of this process so far [bytes]."""
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return largest if sys.platform == "darwin" else 1024 * largest


def _gigabytes(size: float, digits: int = 2) -> str:
    """Write a size with some digits."""
    return f"{size / GIGABYTE:.{digits}g}"


_WATCH: ContextVar[Watch | None] = ContextVar("watch", default=None)
