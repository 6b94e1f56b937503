import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info

from geom2iga import __main__ as command
from geom2iga import limits, threads
from geom2iga.errors import CaseError
from geom2iga.limits import MemoryLimitError, TimeLimitError, check_memory, free_memory, group_memory, limited

ROOT = Path(__file__).parents[2]
DEAF = """
import signal, sys, time
import geom2iga.limits as limits
limits.GRACE = 0.3
signal.signal(signal.SIGINT, lambda *_: None)
with limits.limited(seconds=0.2):
    time.sleep(20)
"""
IGNORED = """
import signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
from geom2iga.limits import TimeLimitError, limited
try:
    with limited(seconds=0.2):
        signal.raise_signal(signal.SIGINT)
        time.sleep(20)
except TimeLimitError:
    print(signal.getsignal(signal.SIGINT) is signal.SIG_IGN)
"""


def alone(script):
    """Run a script in a process of its own."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=60)


def test_what_takes_longer_than_allowed_is_interrupted_and_said():
    began = time.perf_counter()
    with (
        pytest.raises(TimeLimitError, match=r"--max-time allows 0\.1 s; .* kept: allow more, or run it again to go on"),
        limited(seconds=0.1),
    ):
        time.sleep(20)
    assert time.perf_counter() - began < 5
    assert TimeLimitError.exit_code == 4


def grow():
    """Take more and more memory."""
    held = []
    while True:
        held.append(bytearray(2_000_000))
        time.sleep(0.005)


def test_what_takes_more_memory_than_allowed_is_interrupted_and_said():
    allowed = limits.Watch(None, None).resident() + 50e6
    with pytest.raises(MemoryLimitError, match=r"--max-memory allows .* kept"), limited(memory=allowed):
        grow()
    assert MemoryLimitError.exit_code == 2


def test_a_little_more_memory_than_allowed_is_told_apart_from_what_is_allowed():
    reached = limits.Watch(2.5e8, None)._passed(2.51e8, 0.0)
    assert "stopped at 0.251 GB of memory, --max-memory allows 0.25 GB" in str(reached)


def test_memory_of_child_processes_counts(monkeypatch):
    monkeypatch.setattr(limits, "BEYOND", 10.0)  # that of the child comes all at once
    allowed = limits.Watch(None, None).resident() + 60e6
    child = "import time; held = b'x' * 150_000_000; time.sleep(20)"
    with subprocess.Popen([sys.executable, "-c", child]) as running:
        with pytest.raises(MemoryLimitError), limited(memory=allowed):
            time.sleep(20)
        running.kill()


def test_within_its_limits_nothing_happens_and_no_thread_is_left():
    before = threading.active_count(), signal.getsignal(signal.SIGINT)
    with limited(memory=1e15, seconds=1e6):
        assert threading.active_count() == before[0] + 1
    assert (threading.active_count(), signal.getsignal(signal.SIGINT)) == before


def test_an_interruption_by_the_user_stays_one():
    with pytest.raises(KeyboardInterrupt), limited(seconds=60):
        signal.raise_signal(signal.SIGINT)


def test_an_error_of_the_work_stays_what_it_is():
    with pytest.raises(ZeroDivisionError), limited(seconds=60):
        _ = 1 / 0


def test_work_that_no_interruption_reaches_is_cut_off_with_a_sentence():
    ended = alone(DEAF)
    assert ended.returncode == 4
    assert "--max-time" in ended.stderr


def test_a_run_in_the_background_that_ignores_ctrl_c_is_held_to_limits_all_the_same():
    ended = alone(IGNORED)
    assert ended.stdout.strip() == "True", ended.stderr


def test_less_memory_than_the_program_itself_has_is_refused():
    with pytest.raises(CaseError, match="the program itself takes"), limited(memory=1e6):
        pass


def test_what_is_free_is_at_most_what_is_allowed(monkeypatch):
    assert free_memory() > 2e8  # of the machine
    monkeypatch.setattr(limits.Watch, "resident", lambda _: 4e8)
    with limited(memory=5e8):
        assert free_memory() == 1e8
        check_memory("points", 1e8, "less")
        with pytest.raises(
            CaseError, match=r"points need about 1 GB of memory, 0\.1 GB are free under --max-memory: less"
        ):
            check_memory("points", 1e9, "less")
    assert free_memory() > 2e8


GROUPS = {
    "0::/jobs/mine": ("", "memory.max", "memory.current", "inactive_file"),
    "4:memory:/jobs/mine": ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
}


@pytest.mark.parametrize("line", GROUPS)
def test_a_container_has_what_it_and_those_around_it_have_left(tmp_path, line):
    kind, most, taken, files = GROUPS[line]
    process = tmp_path / "cgroup"
    process.write_text(f"7:cpu:/elsewhere\n{line}\n")
    for place, limit, used, cached in (("jobs", "1000", 700, 50), ("jobs/mine", "900", 100, 0), ("", str(2**63), 5, 0)):
        folder = tmp_path / "root" / kind / place
        folder.mkdir(parents=True, exist_ok=True)
        (folder / most).write_text(f"{limit}\n")
        (folder / taken).write_text(f"{used}\n")
        (folder / "memory.stat").write_text(f"anon 3\n{files} {cached}\n")
    assert group_memory(process, tmp_path / "root") == 350
    (tmp_path / "root" / kind / "jobs" / most).write_text("max\n")
    assert group_memory(process, tmp_path / "root") == 800
    assert group_memory(tmp_path / "none", tmp_path) == float("inf")


@pytest.mark.parametrize(
    ("flag", "value"),
    [("--max-memory", value) for value in ("0", "-1", "nan", "inf", "3XB", "GB", "")]
    + [("--max-time", value) for value in ("0", "-5", "soon", "1d")]
    + [("--threads", value) for value in ("0", "-1", "1.5", "all", "99999", "")],
)
def test_limits_that_make_no_sense_end_with_two_and_say_what_is_expected(flag, value, capsys):
    with pytest.raises(SystemExit) as end:
        command.main([f"{flag}={value}", "case.toml"])
    assert end.value.code == 2
    assert f"argument {flag}" in capsys.readouterr().err


@pytest.mark.usefixtures("quiet_log")
@pytest.mark.parametrize("mesh", ["spans = 400", "knots = [{0}, {0}, {0}]"])
def test_a_mesh_that_does_not_fit_is_refused_before_it_is_made_also_in_a_dry_run(tmp_path, mesh, capsys, monkeypatch):
    at = [0, 0, *(n / 400 for n in range(1, 400)), 1, 1]
    case = tmp_path / "case.toml"
    case.write_text(f'[geometry]\n[[geometry.block]]\nname = "cube"\nsize = [1, 1, 1]\n{mesh.format(at)}\n')
    for flags in ([], ["-n"]):
        assert command.main([*flags, "--max-memory", "5", str(case)]) == 2
        assert "control points need about 6.4 GB of memory" in capsys.readouterr().err


def test_threads_are_as_asked_inside_and_as_before_afterwards(monkeypatch):
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with threads.threads(3):
        assert threads.thread_count() == 3
        assert os.environ["MKL_NUM_THREADS"] == "3"
        assert 3 in {library["num_threads"] for library in threadpool_info()}
    assert threads.thread_count() == 2
    assert "MKL_NUM_THREADS" not in os.environ


def test_without_affinity_every_processor_counts(monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    assert threads.thread_count() == (os.cpu_count() or 1)


@pytest.mark.usefixtures("quiet_log")
def test_a_command_stopped_by_its_time_says_so_in_the_log_too_and_goes_on_when_run_again(tmp_path, capsys):
    case = tmp_path / "case.toml"
    case.write_text('[[geometry.block]]\nname = "cube"\nsize = [1, 1, 1]\nspans = 60\n')
    assert command.main([str(case), "--max-time", "0.05"]) == 4
    assert "--max-time allows 0.05 s" in capsys.readouterr().err
    assert "--max-time allows 0.05 s" in (tmp_path / "case.out" / "log.txt").read_text()
    assert not list((tmp_path / "case.out").glob(".*"))
    assert command.main(["-q", str(case)]) == 0
