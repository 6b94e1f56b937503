import io
import os
import pty
import re
import select
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from rich.console import Console

from geom2iga import progress as module
from geom2iga.case import GeometryCase
from geom2iga.progress import noted, progress, tracked, turned_on
from geom2iga.stage import Stage, log, run_command

pytestmark = pytest.mark.usefixtures("quiet_log")

ROOT = Path(__file__).parents[2]
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "TERM": "xterm", "COLUMNS": "100"}
HIDDEN, VISIBLE = "\x1b[?25l", "\x1b[?25h"
COMMAND = """
import sys, time
from geom2iga import progress as module
from geom2iga.terminal import talking

module.DELAY = 0.2
with talking(False, False) as console, module.turned_on(console):
    try:
        with module.progress("pushing"):
            for _ in range(400):
                time.sleep(0.05)
    except KeyboardInterrupt:
        module.log.error("interrupted")
"""


def opened_terminal():
    """Both ends of a pseudo-terminal."""
    try:
        return pty.openpty()
    except OSError as error:
        pytest.skip(f"no pseudo-terminals here: {error}")


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "cube.toml"
    path.write_text('[[geometry.block]]\nname = "cube"\nsize = [1, 2, 3]\n')
    return path


def run_fake(case, *flags, pause):
    """Run a command that says something ten times."""

    def run(*_):
        with progress("pushing", 10) as advance:
            for number in range(10):
                time.sleep(pause)
                log.info("message %d of a whole line", number)
                advance(1)

    stage = Stage("fake", GeometryCase, lambda *_: "inputs", lambda _: None, lambda _: "", run, lambda _: {})
    return run_command("A fake.", [stage], [str(case), *flags])


def read_all(descriptor):
    """All that is written on a terminal until it is closed."""
    text = b""
    while select.select([descriptor], [], [], 30.0)[0]:
        try:
            text += os.read(descriptor, 65536)
        except OSError:  # how Linux says that nobody writes there any more
            return text.decode()
    raise TimeoutError(text)


@pytest.fixture
def on_a_terminal(monkeypatch):
    """Call a function with a terminal as standard error; return what it returns, and all that it wrote there."""
    monkeypatch.setattr(module, "DELAY", 0.2)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")

    def called(function):
        ours, theirs = opened_terminal()
        with ThreadPoolExecutor(1) as pool:
            text = pool.submit(read_all, ours)
            with os.fdopen(theirs, "w") as terminal, monkeypatch.context() as patched:
                patched.setattr(sys, "stderr", terminal)
                found = function()
            text = text.result()
        os.close(ours)
        return found, text

    return called


def shown(text):
    """What is left on the screen: lines that were wiped or drawn over are gone."""
    lines, row = [""], 0
    for part in re.split(r"(\x1b\[[?0-9;]*[A-Za-z]|\r\n|\r|\n)", text):
        if part.endswith("A") and part.startswith("\x1b["):
            row -= int(part[2:-1] or 1)
        elif part == "\x1b[2K":
            lines[row] = ""
        elif part in ("\n", "\r\n"):
            row += 1
            lines += [""] * (row + 1 - len(lines))
        elif part and part != "\r" and not part.startswith("\x1b"):
            lines[row] += part
    return [line for line in lines if line]


def test_a_slow_job_shows_a_bar_that_vanishes_and_tears_no_message(case, on_a_terminal):
    code, text = on_a_terminal(lambda: run_fake(case, pause=0.1))
    assert code == 0
    assert re.search("pushing.*[1-9]/10", text)
    assert text.count(HIDDEN) == 1
    assert text.rindex(VISIBLE) > text.rindex(HIDDEN)
    assert shown(text) == [f"message {number} of a whole line" for number in range(10)]


def test_a_short_job_shows_none(case, on_a_terminal):
    code, text = on_a_terminal(lambda: run_fake(case, pause=0.001))
    assert code == 0
    assert "message 9" in text
    assert "pushing" not in text
    assert HIDDEN not in text


def test_quiet_shows_none_and_the_log_is_complete(case, on_a_terminal):
    assert on_a_terminal(lambda: run_fake(case, "-q", pause=0.06)) == (0, "")
    text = (case.parent / "cube.out" / "log.txt").read_text()
    assert "message 9 of a whole line" in text
    assert re.search(r"pushing: 0\.\d\d s", text)


def test_a_terminal_that_cannot_move_its_cursor_gets_none(case, on_a_terminal, monkeypatch):
    monkeypatch.setenv("TERM", "dumb")
    _, text = on_a_terminal(lambda: run_fake(case, pause=0.06))
    assert "message 9" in text
    assert "pushing" not in text


def test_a_pipe_gets_none_even_where_colours_are_forced(case, capfd, monkeypatch):
    monkeypatch.setattr(module, "DELAY", 0.2)
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert run_fake(case, pause=0.06) == 0
    out, err = capfd.readouterr()
    assert "message 9" in err
    assert "pushing" not in out + err
    assert HIDDEN not in err


def test_ctrl_c_wipes_the_bar_and_gives_the_cursor_back():
    ours, theirs = opened_terminal()
    text = b""
    with subprocess.Popen([sys.executable, "-c", COMMAND], stdin=theirs, stderr=theirs, env=ENVIRONMENT) as process:
        os.close(theirs)
        while HIDDEN.encode() not in text and select.select([ours], [], [], 30.0)[0]:
            text += os.read(ours, 65536)
        process.send_signal(signal.SIGINT)
        text = text.decode() + read_all(ours)
    os.close(ours)
    assert process.returncode == 0
    assert text.rindex(VISIBLE) > text.rindex(HIDDEN)
    assert shown(text) == ["interrupted"]


@pytest.fixture
def console(monkeypatch):
    monkeypatch.setattr(module, "DELAY", 0.01)
    return Console(file=io.StringIO(), force_terminal=True, width=120, color_system=None)


def drawn(console, word):
    """All that has been drawn so far, once that holds a word."""
    for _ in range(200):
        time.sleep(0.02)
        if word in console.file.getvalue():
            break
    return console.file.getvalue()


def test_jobs_inside_a_job_have_bars_below_it_and_a_note(console):
    with turned_on(console), progress("outer"), progress("inner", 4) as advance:
        advance(3)
        noted("residual 1.0e-05")
        text = drawn(console, "residual")
    assert re.search("outer.*inner.*3/4.*residual 1.0e-05", text, re.DOTALL)


def test_nothing_is_left_behind_where_a_job_fails(console):
    @progress("job")
    def failing(delay):
        time.sleep(delay)
        raise ZeroDivisionError

    threads = threading.active_count()
    with turned_on(console):
        for delay in (0.0, 0.1):
            with pytest.raises(ZeroDivisionError):
                failing(delay)
        for _ in tracked(range(3), "left early"):
            time.sleep(0.1)
            break
    text = console.file.getvalue()
    assert text.count(HIDDEN) == text.count(VISIBLE) > 0
    for _ in range(100):
        time.sleep(0.02)
        if threading.active_count() <= threads:
            break
    assert threading.active_count() <= threads


def test_a_library_sees_nothing_of_it(capfd):
    threads = threading.active_count()
    with progress("job", 3) as advance:
        advance(1)
        noted("half")
        assert list(tracked(iter("abc"), "letters")) == ["a", "b", "c"]
        assert threading.active_count() == threads
    assert capfd.readouterr() == ("", "")


def test_rich_is_not_imported_where_nothing_is_shown():
    lines = (
        "import sys; from geom2iga.progress import progress, tracked",
        "with progress('job'): list(tracked([1, 2], 'numbers'))",
        "assert not [name for name in sys.modules if name.startswith('rich')]",
    )
    subprocess.run([sys.executable, "-c", "\n".join(lines)], check=True, env=ENVIRONMENT, timeout=60)


@pytest.mark.parametrize("items", [[], [1], [1, 2, 3], (1, 2), {1: 2}, iter([1, 2])])
def test_what_is_tracked_comes_through_as_it_is(console, items):
    expected = list(items)
    with turned_on(console):
        assert list(tracked(iter(expected), "items")) == expected
        assert list(tracked(expected, "items")) == expected


def test_a_generator_that_is_given_up_does_not_keep_what_it_shows(console):
    def numbers():
        with progress("numbers"):
            yield from range(10)

    with turned_on(console):
        for number in numbers():
            if number == 3:
                break
        with progress("after"):
            text = drawn(console, "after")
    assert "numbers" not in text
    assert "after" in text


def test_a_timer_that_fires_after_its_job_has_ended_draws_nothing(console, monkeypatch):
    monkeypatch.setattr(module, "DELAY", 60.0)
    jobs = module.Jobs(console)
    with jobs.opened("ended", None):
        late = jobs._timer.function
    with jobs.opened("other", None):
        late()
        jobs.hide()
    assert console.file.getvalue() == ""
