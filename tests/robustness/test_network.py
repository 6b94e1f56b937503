import os
import subprocess
import sys

import pytest

from tests.robustness.runs import ROOT, write_case

WATCHER = """
import sys

def watch(event, arguments):
    if event in ("socket.connect", "socket.getaddrinfo", "socket.gethostbyname", "socket.sendto"):
        with open({record!r}, "a") as file:
            print(event, arguments, file=file)
        raise PermissionError("no network")

sys.addaudithook(watch)
"""


def run_watched(folder, *arguments):
    """Run Python with every use of the network noted, in processes that it starts, too; return what was noted."""
    record = folder / "record"
    (folder / "sitecustomize.py").write_text(WATCHER.format(record=str(record)))
    search = os.pathsep.join(filter(None, [str(folder), str(ROOT), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        [sys.executable, *arguments], env=os.environ | {"PYTHONPATH": search}, cwd=folder, check=False
    )
    return done.returncode, record.read_text() if record.exists() else ""


def test_a_use_of_the_network_would_be_noticed(tmp_path):
    code, noted = run_watched(tmp_path, "-c", "import socket; socket.create_connection(('127.0.0.1', 9))")
    assert code == 1
    assert "127.0.0.1" in noted


def assert_without_network(case, folder):
    assert run_watched(folder, "-m", "post.pipeline", str(case), "-q", "-o", str(folder / "out")) == (0, "")
    assert (folder / "out/report.html").exists()


def test_from_a_cad_file_to_the_report_nothing_uses_the_network(tmp_path):
    assert_without_network(write_case(tmp_path, "pictures = false\n"), tmp_path)


@pytest.mark.slow
def test_from_a_cad_file_to_the_pictures_nothing_uses_the_network(tmp_path):
    assert_without_network(ROOT / "examples/cad_patch_test/case.toml", tmp_path)
