import logging
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from geom2iga.cad import isolated as isolation
from geom2iga.cad import session
from geom2iga.cad.isolated import isolated
from geom2iga.errors import CaseError, GeometryError

CAUGHT = (signal.SIGINT, signal.SIGTERM)


def test_a_function_is_called_in_another_process():
    assert isolated(os.getpid, seconds=60) != os.getpid()


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGABRT, signal.SIGKILL])
def test_a_crash_of_the_other_process_becomes_a_message(number):
    with pytest.raises(GeometryError, match=rf"crashed \({number.name}\).*repair the file"):
        isolated(signal.raise_signal, number, seconds=60)


def test_an_exit_of_the_other_process_becomes_a_message():
    with pytest.raises(GeometryError, match=r"crashed \(exit code 5\)"):
        isolated(os._exit, 5, seconds=60)


def test_a_script_that_ends_gmsh_is_told_so():
    with pytest.raises(GeometryError, match="the script ends gmsh: remove Exit"):
        isolated(os._exit, 0, seconds=60)


def test_one_that_says_nothing_any_more_is_waited_for_without_haste(monkeypatch):
    looks, waiting = [], isolation._waiting
    monkeypatch.setattr(isolation, "_waiting", lambda *given: looks.append(given) or waiting(*given))
    begin = time.monotonic()
    with subprocess.Popen(["sh", "-c", "exec >&- 2>&-; sleep 0.3"], stdout=subprocess.PIPE) as process:
        assert isolation._heard(process, 60) == (0, "")
    assert len(looks) < 5 + (time.monotonic() - begin) / isolation.PAUSE


def test_without_a_word_about_it_memory_is_what_the_command_may_take(monkeypatch):
    monkeypatch.setattr(isolation, "free_memory", lambda: 1e9)
    with pytest.raises(GeometryError, match=r"more than the 1 GB of memory it may"):
        isolated(bytearray, 20_000_000_000, seconds=60)


def test_a_hang_of_the_other_process_becomes_a_message():
    begin = time.perf_counter()
    with pytest.raises(GeometryError, match=r"did not end within 1 seconds"):
        isolated(time.sleep, 60, seconds=1)
    assert time.perf_counter() - begin < 10


def test_what_the_user_did_wrong_comes_through_as_it_is(tmp_path):
    with pytest.raises(CaseError, match="no such file") as error:
        isolated(session.check_file, tmp_path / "missing.step", seconds=60)
    assert error.value.exit_code == 2


def test_a_function_that_takes_too_much_memory_is_stopped():
    with pytest.raises(GeometryError, match=r"more than the 1 GB of memory it may"):
        isolated(bytearray, 20_000_000_000, seconds=60, memory=1e9)


def test_what_the_other_process_prints_goes_to_the_log(capfd, caplog):
    with caplog.at_level(logging.DEBUG, "geom2iga"):
        isolated(os.system, "echo one; echo two >&2", seconds=60)
    assert capfd.readouterr() == ("", "")
    assert "one\ntwo" in caplog.text


def started(folder):
    """Processes whose command names a folder."""
    return [
        each for each in psutil.process_iter(["cmdline"]) if any(str(folder) in w for w in each.info["cmdline"] or ())
    ]


def awaited(condition, seconds=60.0):
    """Wait until something holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.slow
def test_what_the_other_process_started_ends_with_it(tmp_path):
    with pytest.raises(GeometryError, match="did not end"):
        isolated(subprocess.call, ["sh", "-c", f"echo > {tmp_path}/begun; sleep 600"], seconds=30)
    assert (tmp_path / "begun").exists()
    awaited(lambda: not started(tmp_path))


@pytest.mark.parametrize("number", [signal.SIGKILL, *(pytest.param(n, marks=pytest.mark.slow) for n in CAUGHT)])
def test_nothing_is_left_of_the_other_process_when_its_caller_ends(tmp_path, number):
    script = f"""
import subprocess
from geom2iga.cad.isolated import isolated
isolated(subprocess.call, ["sh", "-c", "echo > {tmp_path}/begun; sleep 600"], seconds=600)
"""
    folder = tmp_path / "temporary"
    folder.mkdir()
    environment = os.environ | {"TMPDIR": str(folder), "PYTHONPATH": str(Path(__file__).parents[3])}
    caller = subprocess.Popen([sys.executable, "-c", script], env=environment, stderr=subprocess.DEVNULL)
    awaited((tmp_path / "begun").exists)
    assert any(each.pid != caller.pid for each in started(folder))
    caller.send_signal(number)
    assert caller.wait(60) != 0
    awaited(lambda: not started(tmp_path) and not any(folder.iterdir()))
