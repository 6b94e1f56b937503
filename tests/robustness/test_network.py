import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]

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


def test_from_a_cad_file_to_the_report_nothing_uses_the_network(tmp_path):
    case = ROOT / "examples/cad_patch_test/case.toml"
    assert run_watched(tmp_path, "-m", "post.pipeline", str(case), "-q", "-o", str(tmp_path / "out")) == (0, "")
    assert (tmp_path / "out/report.html").exists()
