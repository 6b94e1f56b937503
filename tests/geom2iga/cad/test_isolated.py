import os
import signal
import time

import pytest

from geom2iga.cad import session
from geom2iga.cad.isolated import isolated
from geom2iga.errors import CaseError, GeometryError


def test_a_function_is_called_in_another_process():
    assert isolated(os.getpid, seconds=60) != os.getpid()


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGABRT, signal.SIGKILL])
def test_a_crash_of_the_other_process_becomes_a_message(number):
    with pytest.raises(GeometryError, match=rf"crashed \({number.name}\).*repair the file"):
        isolated(signal.raise_signal, number, seconds=60)


def test_an_exit_of_the_other_process_becomes_a_message():
    with pytest.raises(GeometryError, match=r"crashed \(exit code 5\)"):
        isolated(os._exit, 5, seconds=60)


def test_a_hang_of_the_other_process_becomes_a_message():
    begin = time.perf_counter()
    with pytest.raises(GeometryError, match=r"did not end within 1 seconds"):
        isolated(time.sleep, 60, seconds=1)
    assert time.perf_counter() - begin < 10


def test_what_the_user_did_wrong_comes_through_as_it_is(tmp_path):
    with pytest.raises(CaseError, match="no such file") as error:
        isolated(session.check_file, tmp_path / "missing.step", seconds=60)
    assert error.value.exit_code == 2
