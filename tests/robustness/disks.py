"""Small disks, and folders that turn read-only: what only root may make."""

import shutil
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory


@cache
def can_mount() -> bool:
    """Whether file systems may be mounted here."""
    with TemporaryDirectory() as folder:
        try:
            with small_disk(Path(folder), 1):
                return True
        except (OSError, subprocess.CalledProcessError):
            return False


@contextmanager
def small_disk(folder: Path, megabytes: int) -> Iterator[None]:
    """Mount a disk in memory as a folder."""
    _mount("-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", folder)
    try:
        yield
    finally:
        _run("umount", "--lazy", folder)


@contextmanager
def read_only(folder: Path) -> Iterator[None]:
    """Let nothing be opened for writing in a folder; what is open stays so."""
    with TemporaryDirectory() as twin, ExitStack() as stack:
        _mount("--bind", folder, twin)  # first elsewhere: a mount that somebody writes to cannot be turned
        stack.callback(_run, "umount", "--lazy", twin)
        _mount("-o", "remount,bind,ro", twin)
        _mount("--bind", twin, folder)
        stack.callback(_run, "umount", "--lazy", folder)
        yield


def fill(folder: Path, left: int) -> Path:
    """Fill the disk of a folder but for some bytes; return the file that does."""
    path = folder / "filler"
    with path.open("wb", buffering=0) as file:
        free = shutil.disk_usage(folder).free
        file.write(bytes(max(0, free - left)))
    return path


def _mount(*arguments: object) -> None:
    _run("mount", *arguments)


def _run(*command: object) -> None:
    subprocess.run([str(part) for part in command], check=True, capture_output=True)
