"""Threads of the linear algebra library."""

import os
from contextlib import AbstractContextManager

from threadpoolctl import threadpool_limits


def one_blas_thread() -> AbstractContextManager[object]:
    """Run numpy's OpenBLAS on one thread: its threads slow down products of many small matrices, by up to 60 times.

    PARDISO's threads (MKL) stay as they are.
    """
    return threadpool_limits({"libopenblas": 1, "libscipy_openblas": 1})


def thread_count() -> int:
    """How many threads to use: OMP_NUM_THREADS where it is set, else one per processor that this process may use."""
    wanted = os.environ.get("OMP_NUM_THREADS", "")
    return int(wanted) if wanted.isdigit() and int(wanted) > 0 else len(os.sched_getaffinity(0))
