"""Run a function in a process of its own: what crashes, hangs or takes all memory there does no harm here."""

import logging
import os
import pickle
import resource
import select
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

from geom2iga.errors import GeometryError
from geom2iga.limits import GIGABYTE, free_memory

HEARD = 10_000  # bytes of what the other process says that are kept, the last ones
PAUSE = 0.02  # seconds between looks at whether it has ended

log = logging.getLogger("geom2iga")

Result = TypeVar("Result")


def isolated(
    function: Callable[..., Result], *arguments: object, seconds: float, memory: float | None = None
) -> Result:
    """Call a function of a module in a fresh interpreter, which ends when this process does, however that ends.

    What it prints goes to the log. What it writes to the folder for temporary files is removed.

    Parameters
    ----------
    function, arguments
        Anything that pickle takes, as is the result.
    seconds : float
        After which it is given up.
    memory : float
        Bytes that it may take; left out, what is free.

    Raises
    ------
    Exception
        That the function raised.
    GeometryError
        It crashed, did not end in time, or took too much memory.
    """
    memory = free_memory() if memory is None else memory
    with TemporaryDirectory(prefix="geom2iga-") as folder:
        call, result = Path(folder) / "call", Path(folder) / "result"
        call.write_bytes(pickle.dumps((function, arguments)))
        code, said = _run(folder, seconds, memory)
        if said:
            log.debug("gmsh said: %s", said)
        answer: Result | Exception | None = pickle.loads(result.read_bytes()) if result.exists() else None
        if isinstance(answer, MemoryError) or (not result.exists() and "bad_alloc" in said):
            raise GeometryError(f"gmsh took more than the {memory / GIGABYTE:.2g} GB of memory it may: simplify it")
        if not result.exists() and code == 0:
            raise GeometryError("the script ends gmsh: remove Exit")
        if not result.exists():
            raise GeometryError(f"gmsh crashed ({_cause(code)}); repair the file in the CAD program")
    if isinstance(answer, Exception):
        raise answer
    return answer  # type: ignore[return-value]


def _run(folder: str, seconds: float, memory: float) -> tuple[int, str]:
    """Serve the call that lies in a folder; return the exit code, and the last of what was said meanwhile."""
    watched, held = os.pipe()  # its end that is held here closes when this process ends
    command = [sys.executable, "-c", "from geom2iga.cad.isolated import serve; serve()"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "TMPDIR": folder}
    with os.fdopen(held, "wb"), os.fdopen(watched, "rb"):
        process = subprocess.Popen(
            [*command, folder, str(watched), str(int(memory))],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            bufsize=0,
            pass_fds=(watched,),
            process_group=0,  # so that what it starts ends with it
        )
        with process:
            try:
                return _heard(process, seconds)
            except BaseException:
                if process.returncode is None:
                    os.killpg(process.pid, signal.SIGKILL)
                raise


def _heard(process: subprocess.Popen[bytes], seconds: float) -> tuple[int, str]:
    """Wait for the end of a process; return its exit code, and the last of what it said."""
    assert process.stdout is not None
    said, end = b"", time.monotonic() + seconds
    while process.poll() is None:
        if time.monotonic() > end:
            raise GeometryError(f"gmsh did not end within {seconds:.0f} seconds; simplify or repair the file")
        said = (said + _waiting(process.stdout.fileno(), PAUSE))[-HEARD:]
    while rest := _waiting(process.stdout.fileno(), 0):  # not to its end: another process may hold it open
        said = (said + rest)[-HEARD:]
    return process.returncode, said.decode(errors="replace").strip()


def _waiting(pipe: int, seconds: float) -> bytes:
    """Read what waits in a pipe, or comes within some time."""
    if select.select([pipe], [], [], seconds)[0]:
        if heard := os.read(pipe, 1 << 16):
            return heard
        time.sleep(seconds)  # it is closed
    return b""


def _cause(code: int) -> str:
    """Name the signal that ended a process."""
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def serve() -> None:
    """Do the call that lies in a folder and write its result there: what the fresh interpreter runs."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interruption is the caller's to act on
    folder, watched, memory = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    threading.Thread(target=_end_with_caller, args=(folder, watched), daemon=True).start()
    _limit(resource.RLIMIT_DATA, memory)
    _limit(resource.RLIMIT_CORE, 0)  # a crash leaves no file behind
    # pickle runs what it reads: the folder is this user's alone, and nothing but these two processes writes to it
    function, arguments = pickle.loads((folder / "call").read_bytes())
    try:
        answer = function(*arguments)
    except Exception as error:
        answer = error
    unfinished = folder / "unfinished"
    unfinished.write_bytes(pickle.dumps(answer))
    unfinished.rename(folder / "result")


def _end_with_caller(folder: Path, watched: int) -> None:
    """Wait until the caller is no more, then remove its folder and end this process and those that it started."""
    os.read(watched, 1)
    shutil.rmtree(folder, ignore_errors=True)
    os.killpg(0, signal.SIGKILL)


def _limit(kind: int, amount: int) -> None:
    """Lower a limit of this process."""
    highest = resource.getrlimit(kind)[1]
    lower = amount if highest == resource.RLIM_INFINITY else min(amount, highest)
    resource.setrlimit(kind, (lower, highest))
