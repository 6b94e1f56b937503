"""Run a function in a process of its own: what crashes or hangs there does no harm here."""

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

from geom2iga.errors import GeometryError

Result = TypeVar("Result")


def isolated(function: Callable[..., Result], *arguments: object, seconds: float) -> Result:
    """Call a function of a module in a fresh interpreter.

    Parameters
    ----------
    function, arguments
        Anything that pickle takes, as is the result.
    seconds : float
        After which it is given up.

    Raises
    ------
    Exception
        That the function raised.
    GeometryError
        It crashed, or did not end in time.
    """
    with TemporaryDirectory() as folder:
        call, result = Path(folder) / "call", Path(folder) / "result"
        call.write_bytes(pickle.dumps((function, arguments)))
        command = [sys.executable, "-c", "from geom2iga.cad.isolated import serve; serve()", str(call), str(result)]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        try:
            ended = subprocess.run(
                command, env=environment, stdin=subprocess.DEVNULL, stdout=2, timeout=seconds, check=False
            )
        except subprocess.TimeoutExpired:
            raise GeometryError(f"gmsh did not end within {seconds:g} seconds; repair the file") from None
        if not result.exists():
            raise GeometryError(f"gmsh crashed ({_cause(ended.returncode)}); repair the file in the CAD program")
        answer = pickle.loads(result.read_bytes())
    if isinstance(answer, Exception):
        raise answer
    return answer


def _cause(code: int) -> str:
    """Name the signal that ended a process."""
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def serve() -> None:
    """Do the call of a file and write its result: what the fresh interpreter runs."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interruption is the caller's to act on
    function, arguments = pickle.loads(Path(sys.argv[1]).read_bytes())
    try:
        answer = function(*arguments)
    except Exception as error:
        answer = error
    Path(sys.argv[2]).write_bytes(pickle.dumps(answer))
