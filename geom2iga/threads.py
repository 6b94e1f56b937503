"""Threads: how many, of ours and of the libraries."""

import logging
import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache

from threadpoolctl import threadpool_limits

log = logging.getLogger("geom2iga")

VARIABLES = (
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "LP_NUM_THREADS",
)  # the last: Mesa's pictures


def one_blas_thread() -> AbstractContextManager[object]:
    """Run numpy's OpenBLAS on one thread: its threads slow down products of many small matrices, by up to 60 times.

    PARDISO's threads (MKL) stay as they are.
    """
    return threadpool_limits({"libopenblas": 1, "libscipy_openblas": 1})


@contextmanager
def threads(count: int | None) -> Iterator[None]:
    """Use so many threads inside, here and in all libraries, be they loaded already or not; None: as it was."""
    if count is None:
        yield
        return
    before = {name: os.environ.get(name) for name in VARIABLES}
    os.environ.update(dict.fromkeys(VARIABLES, str(count)))
    try:
        with threadpool_limits(count):
            yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def thread_count() -> int:
    """How many threads to use: OMP_NUM_THREADS where it is set, else one per processor that this process may use."""
    return _wanted(os.environ.get("OMP_NUM_THREADS", "")) or _processors()


@cache  # so that it is said once
def _wanted(text: str) -> int | None:
    """Read OMP_NUM_THREADS: of a list for nested regions the first number; None where it is empty or no number."""
    first = text.partition(",")[0].strip()
    if first.isdecimal() and int(first) > 0:
        return int(first)
    if text.strip():
        log.warning(
            "warning: OMP_NUM_THREADS=%s is no number of threads: %d are used",
            *(text, _processors()),
        )
    return None


def _processors() -> int:
    """Processors that this process may use; all of the machine where the system does not tell."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
