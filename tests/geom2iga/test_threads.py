import os

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from geom2iga import threads
from geom2iga.threads import one_blas_thread, thread_count


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


@pytest.mark.parametrize(("text", "wanted"), [("3", 3), ("2,3", 2), (" 4 , 1", 4), ("", None), (" ", None)])
def test_the_first_number_of_the_variable_counts(monkeypatch, caplog, text, wanted):
    monkeypatch.setenv("OMP_NUM_THREADS", text)
    assert thread_count() == (wanted or len(os.sched_getaffinity(0)))
    assert not caplog.records


@pytest.mark.parametrize("text", ["0", "abc", "-1", "²", "1.5"])
def test_what_is_no_number_of_threads_is_told_once(monkeypatch, caplog, text):
    threads._wanted.cache_clear()
    monkeypatch.setenv("OMP_NUM_THREADS", text)
    for _ in range(2):
        assert thread_count() == len(os.sched_getaffinity(0))
    assert [record.getMessage() for record in caplog.records] == [
        f"warning: OMP_NUM_THREADS={text} is no number of threads: {thread_count()} are used"
    ]
