import numpy as np
from threadpoolctl import threadpool_info, threadpool_limits

from geom2iga.threads import one_blas_thread


def blas_threads():
    """Threads that each OpenBLAS of numpy and scipy uses."""
    np.ones((2, 2)) @ np.ones((2, 2))
    return [library["num_threads"] for library in threadpool_info() if library["internal_api"] == "openblas"]


def test_blas_runs_on_one_thread_and_afterwards_on_as_many_as_before():
    with threadpool_limits(2):
        before = blas_threads()
        assert before
        assert set(before) == {2}
        with one_blas_thread():
            assert set(blas_threads()) == {1}
        assert blas_threads() == before


def test_other_libraries_keep_their_threads():
    with threadpool_limits(2):
        others = [library for library in threadpool_info() if library["internal_api"] != "openblas"]
        with one_blas_thread():
            assert [library for library in threadpool_info() if library["internal_api"] != "openblas"] == others
