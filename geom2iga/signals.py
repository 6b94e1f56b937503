"""Signals that ask a run to end: Ctrl-C, SIGTERM, and SIGHUP of a terminal that was closed."""

import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
USUAL = (signal.SIG_DFL, signal.default_int_handler)  # where anything else is set, such as by nohup, it stays


class Interrupted(KeyboardInterrupt):
    """A signal asked to end the run."""

    def __init__(self, number: int = signal.SIGINT) -> None:
        super().__init__(number)
        self.number = number


def exit_code(error: KeyboardInterrupt) -> int:
    """Exit code of a run that a signal ended, as shells have it: 128 and its number.

    >>> exit_code(KeyboardInterrupt()), exit_code(Interrupted(signal.SIGTERM))
    (130, 143)
    """
    return 128 + (error.number if isinstance(error, Interrupted) else signal.SIGINT)


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise Interrupted when a signal asks to end; another one while that is acted upon changes nothing."""

    def act(number: int, _: FrameType | None) -> None:
        if not _is_ending():
            raise Interrupted(number)

    with _handled(act, [number for number in ENDING if signal.getsignal(number) in USUAL]):
        yield


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold signals that ask to end back until the end: VTK and HDF5 die of an exception in the middle of their work."""
    received: list[int] = []
    known = [number for number in ENDING if signal.getsignal(number) not in (signal.SIG_IGN, None)]
    try:
        with _handled(lambda number, _: received.append(number), known):
            yield
    finally:
        for number in received[:1]:
            signal.raise_signal(number)  # to whatever acted on it before


@contextmanager
def _handled(act: Callable[[int, FrameType | None], None], numbers: Sequence[int]) -> Iterator[None]:
    """Act on signals inside; a thread other than the main one gets none."""
    if not _is_main():
        yield
        return
    before: dict[int, Any] = {}
    try:
        for number in numbers:
            before[number] = signal.signal(number, act)
        yield
    finally:
        for number, action in before.items():
            signal.signal(number, action)


def _is_main() -> bool:
    """Whether this is the thread that signals come to."""
    return threading.current_thread() is threading.main_thread()


def _is_ending() -> bool:
    """Whether an interruption is being acted upon."""
    error = sys.exception()
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None
