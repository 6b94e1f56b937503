"""What asks a command to end, from its first import to its last word."""

import os
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from geom2iga.signals import ENDING, interruptible, uninterrupted
from geom2iga.start import COMMANDS
from tests.commands import run_fake

pytestmark = pytest.mark.usefixtures("quiet_log")

ROOT = Path(__file__).parents[2]
INTERRUPTING = "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(30)\n"
SCRIPT = "import sys; sys.argv[0] = {name!r}; from {module} import main; sys.exit(main())"


@pytest.fixture
def own_handlers():
    """Give the handlers back, whatever a test does to them."""
    before = {number: signal.getsignal(number) for number in ENDING}
    yield before
    for number, action in before.items():
        signal.signal(number, action)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_ends_a_command_with_its_number_and_a_sentence(tmp_path, capsys, number, code):
    assert run_fake(tmp_path, work=lambda: signal.raise_signal(number)) == code
    assert capsys.readouterr().err.splitlines() == ["interrupted; stages that had ended are kept"]


def test_signals_are_as_before_when_a_command_has_ended(tmp_path, own_handlers):
    run_fake(tmp_path, work=lambda: signal.raise_signal(signal.SIGTERM))
    assert {number: signal.getsignal(number) for number in ENDING} == own_handlers


def test_a_second_interruption_does_not_disturb_how_the_first_is_acted_upon(tmp_path, capsys):
    done = []

    def work():
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            for number in ENDING:
                signal.raise_signal(number)
            done.append("tidied up")

    assert run_fake(tmp_path, work=work) == 130
    assert done == ["tidied up"]
    assert run_fake(tmp_path, work=lambda: signal.raise_signal(signal.SIGTERM)) == 143


def test_a_signal_that_was_ignored_stays_ignored(tmp_path, own_handlers):
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    assert run_fake(tmp_path, work=lambda: signal.raise_signal(signal.SIGHUP)) == 0
    with uninterrupted():
        signal.raise_signal(signal.SIGHUP)


@pytest.mark.parametrize("number", ENDING)
def test_what_must_not_be_interrupted_is_done_before_a_signal_acts(number):
    done = []

    def drawn():
        with interruptible(), uninterrupted():
            signal.raise_signal(number)
            done.append("picture")

    with pytest.raises(KeyboardInterrupt):
        drawn()
    assert done == ["picture"]


def test_a_signal_that_was_held_back_goes_to_the_handler_of_the_program_around(own_handlers):
    received = []
    signal.signal(signal.SIGTERM, lambda number, _: received.append(number))
    with uninterrupted():
        signal.raise_signal(signal.SIGTERM)
        assert received == []
    assert received == [signal.SIGTERM]


def run_interrupted(folder, module, *command):
    """Run Python on a command that is interrupted while it imports a module."""
    (folder / f"{module}.py").write_text(INTERRUPTING)
    return subprocess.run(
        [sys.executable, *command],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])},
        capture_output=True,
        text=True,
        timeout=60,
    )


@pytest.mark.parametrize(
    ("module", "command"),
    [
        ("h5py", ["-m", "geom2iga"]),
        ("scipy", ["-m", "post.pipeline"]),
        ("h5py", ["-Bm", "solve"]),
        ("numpy", ["-c", SCRIPT.format(name="/usr/bin/iga-solve", module="solve.__main__")]),
        ("pydantic", ["-c", SCRIPT.format(name="iga-post", module="post.__main__")]),
    ],
)
def test_ctrl_c_while_a_command_imports_its_libraries_is_no_traceback(tmp_path, module, command):
    ended = run_interrupted(tmp_path, module, *command)
    assert (ended.returncode, ended.stdout, ended.stderr) == (-signal.SIGINT, "", "")


def test_programs_that_import_us_keep_their_own_ctrl_c(tmp_path):
    program = "try:\n    import geom2iga\nexcept KeyboardInterrupt:\n    print('noticed')"
    assert run_interrupted(tmp_path, "h5py", "-c", program).stdout == "noticed\n"


@pytest.mark.parametrize("arguments", [[], ["-m", "geom2iga"]])
def test_packages_that_import_us_keep_their_own_ctrl_c(tmp_path, arguments):
    (tmp_path / "anytool").mkdir()
    program = "try:\n    import geom2iga\nexcept KeyboardInterrupt:\n    print('noticed')\n"
    (tmp_path / "anytool" / "__init__.py").write_text(program)
    (tmp_path / "anytool" / "__main__.py").write_text("")
    assert run_interrupted(tmp_path, "h5py", "-m", "anytool", *arguments).stdout == "noticed\n"


def test_all_commands_are_known():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert set(COMMANDS) == set(project["scripts"])
