"""Threads of the linear algebra library."""

from contextlib import AbstractContextManager

from threadpoolctl import threadpool_limits


def one_blas_thread() -> AbstractContextManager[object]:
    """Run numpy's OpenBLAS on one thread: its threads slow down products of many small matrices, by up to 60 times.

    PARDISO's threads (MKL) stay as they are.
    """
    return threadpool_limits({"libopenblas": 1, "libscipy_openblas": 1})
