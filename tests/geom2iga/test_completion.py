import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import post.__main__
import solve.__main__
from geom2iga import __main__ as geometry
from geom2iga.flags import SHELLS
from post import pipeline

COMMANDS = {"geom2iga": geometry, "iga-solve": solve.__main__, "iga-post": post.__main__, "iga-run": pipeline}

ASK = """
source "$1"
complete -p "$2"
function=$(complete -p "$2" | sed 's/.*-F \\([^ ]*\\).*/\\1/')
COMP_WORDS=("${@:2}")
COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
COMP_LINE="${COMP_WORDS[*]}"
COMP_POINT=${#COMP_LINE}
"$function" "$2" "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture
def script(capsys, tmp_path):
    """Write the completion of a command for a shell."""

    def written(program, shell):
        assert COMMANDS[program].main(["--print-completion", shell]) == 0
        path = tmp_path / f"{program}.{shell}"
        path.write_text(capsys.readouterr().out)
        return path

    return written


@pytest.fixture
def folder(tmp_path):
    """A folder with cases, other files and folders."""
    found = tmp_path / "there"
    (found / "case.out").mkdir(parents=True)
    for name in ("case.toml", "cube.toml", "notes.txt"):
        (found / name).touch()
    return found


def completed(script, folder, *words):
    """What bash offers for the last word."""
    ended = subprocess.run(
        ["bash", "-c", ASK, "bash", str(script), *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
        timeout=30,
    )
    registered, *offered = ended.stdout.split("\n")
    assert registered.startswith("complete ")
    return {word for word in offered if word}


@pytest.mark.parametrize("program", COMMANDS)
def test_bash_completes_flags_cases_and_folders_of_each_command(program, script, folder):
    path = script(program, "bash")
    assert completed(path, folder, program, "") >= {"case.toml", "cube.toml", "case.out"}
    assert "notes.txt" not in completed(path, folder, program, "")
    assert completed(path, folder, program, "cu") == {"cube.toml"}
    assert completed(path, folder, program, "--dr") == {"--dry-run"}
    assert completed(path, folder, program, "case.toml", "-o", "") == {"case.out"}
    assert completed(path, folder, program, "--print-completion", "") == set(SHELLS)


def test_bash_completes_formats_only_where_the_command_has_them(script, folder):
    assert "mfem" in completed(script("iga-run", "bash"), folder, "iga-run", "--export", "")
    assert completed(script("iga-solve", "bash"), folder, "iga-solve", "--exp") == set()


@pytest.mark.parametrize("shell", SHELLS)
def test_each_shell_gets_a_script_that_it_can_read(shell, script):
    path = script("iga-run", shell)
    assert "iga-run" in path.read_text()
    assert "toml" in path.read_text()
    if shutil.which(shell):
        subprocess.run([shell, "-n", str(path)], check=True, timeout=30)


def test_a_shell_that_is_not_known_is_refused(capsys):
    with pytest.raises(SystemExit) as end:
        pipeline.main(["--print-completion", "cmd"])
    assert end.value.code == 2
    assert "bash" in capsys.readouterr().err


def test_commands_that_complete_nothing_do_not_import_what_completes():
    lines = "import sys; from post.pipeline import main; main(['--schema']); assert 'shtab' not in sys.modules"
    root = Path(__file__).parents[2]
    subprocess.run(
        [sys.executable, "-c", lines], check=True, stdout=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": str(root)}
    )
