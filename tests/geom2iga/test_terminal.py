"""log.txt and standard error, and what they are good for beside talk."""

import errno
import fcntl
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from geom2iga.temporary import temporary_path
from geom2iga.terminal import LogFile
from tests.commands import run_fake

pytestmark = pytest.mark.usefixtures("quiet_log")

ROOT = Path(__file__).parents[2]
TALKING = """
from geom2iga.terminal import log, talking
with talking(False, False):
    for number in range(1000):
        log.info("line %d", number)
"""


@pytest.fixture
def out(tmp_path):
    """The output folder of a command that has run."""
    assert run_fake(tmp_path) == 0
    return tmp_path / "case.out"


def test_a_folder_that_another_run_writes_to_is_refused_and_left_as_it_is(tmp_path, out, capsys):
    other = LogFile(out / "log.txt")  # open, as another process has it
    before = (out / "log.txt").read_text()
    assert run_fake(tmp_path) == 2
    assert f"another run (process {os.getpid()}) is writing there" in capsys.readouterr().err
    assert (out / "log.txt").read_text() == before
    other.close()
    assert run_fake(tmp_path) == 0


def test_a_folder_is_free_as_soon_as_a_command_has_ended(tmp_path, out):
    LogFile(out / "log.txt").close()
    assert run_fake(tmp_path, work=lambda: 1 / 0) == 1
    LogFile(out / "log.txt").close()


def test_files_that_runs_left_unfinished_are_removed_and_those_of_the_user_stay(tmp_path, out):
    left = [temporary_path(out / name) for name in ("geometry.h5", "report.html", "a.b.csv")]
    kept = [out / name for name in (".notes.2024.txt", ".case.toml.swp", "unfinished.1.h5")]
    for path in (*left, *kept):
        path.write_text("")
    assert run_fake(tmp_path) == 0
    assert {path for path in out.iterdir() if path.name != "log.txt"} == set(kept)


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS])
def test_a_file_system_without_locks_is_good_enough(tmp_path, out, monkeypatch, number):
    def no_locks(*_):
        raise OSError(number, os.strerror(number))

    of_another = temporary_path(out / "geometry.h5")
    of_another.write_text("")
    monkeypatch.setattr(fcntl, "flock", no_locks)
    assert run_fake(tmp_path) == 0
    assert of_another.exists()


def test_a_disk_that_takes_no_line_of_the_log_is_no_reason_to_end(tmp_path, capsys):
    (tmp_path / "case.out").mkdir()
    (tmp_path / "case.out" / "log.txt").symlink_to("/dev/full")
    assert run_fake(tmp_path, "-q") == 0
    assert capsys.readouterr().err == ""


def test_a_folder_that_vanishes_is_a_sentence(tmp_path, capsys):
    assert run_fake(tmp_path, work=lambda: shutil.rmtree(tmp_path / "case.out")) == 2
    assert "removed while the run wrote to it" in capsys.readouterr().err


def test_a_folder_that_vanished_and_was_made_anew_belongs_to_another_run(tmp_path, capsys):
    def work():
        shutil.rmtree(tmp_path / "case.out")
        (tmp_path / "case.out").mkdir()
        (tmp_path / "case.out" / "log.txt").write_text("of another run")

    assert run_fake(tmp_path, work=work) == 2
    assert "removed while the run wrote to it" in capsys.readouterr().err


def run_talking(shell):
    """Let a shell have its way with standard error of a process that talks a lot."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHON": sys.executable, "TALKING": TALKING}
    return subprocess.run(["bash", "-c", shell], env=environment, capture_output=True, text=True, timeout=60)


def test_standard_error_on_a_full_disk_does_not_end_a_run():
    ended = run_talking('"$PYTHON" -c "$TALKING" 2>/dev/full')
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")


def test_whoever_reads_standard_error_may_stop_early():
    ended = run_talking('"$PYTHON" -c "$TALKING" 2>&1 | (read -r line; echo "$line"); exit ${PIPESTATUS[0]}')
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "line 0\n", "")


def test_a_pipe_or_folder_in_the_place_of_the_log_is_named_and_not_waited_for(tmp_path, capsys):
    path = tmp_path / "case.out" / "log.txt"
    path.parent.mkdir()
    os.mkfifo(path)
    assert run_fake(tmp_path) == 2
    assert f"{path}: a pipe, no file; remove it" in capsys.readouterr().err
    path.unlink()
    path.mkdir()
    assert run_fake(tmp_path) == 2
    assert f"{path}: a folder, expected a file" in capsys.readouterr().err
