"""What the commands say: messages on standard error and in log.txt, data on standard output."""

import fcntl
import json
import logging
import os
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from rich.console import Console

from geom2iga.errors import CaseError
from geom2iga.seal import check_no_folder, made_folder
from geom2iga.temporary import remove_temporaries

STYLES = ((logging.ERROR, "red"), (logging.WARNING, "yellow"))

log = logging.getLogger("geom2iga")


class Screen(Console):
    """Standard error; whoever reads it may stop early."""

    def on_broken_pipe(self) -> None:
        """Go on, and write nowhere."""
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.file.fileno())


class Terminal(logging.Handler):
    """Prints messages on standard error, warnings in yellow, errors in red, without breaking lines."""

    def __init__(self) -> None:
        super().__init__()
        self.console = Screen(stderr=True, soft_wrap=True, markup=False, highlight=False)

    @property
    def is_live(self) -> bool:
        """Whether somebody looks at a terminal that can move its cursor; not so where output is piped or recorded."""
        return self.console.file.isatty() and not self.console.is_dumb_terminal

    def emit(self, record: logging.LogRecord) -> None:
        """Print one message."""
        style = next((style for level, style in STYLES if record.levelno >= level), None)
        try:
            self.console.print(self.format(record), style=style)
        except OSError:  # standard error goes to a full disk
            self.console.on_broken_pipe()


class LogFile(logging.FileHandler):
    """Writes messages into log.txt; as long as it is open, no other run gets the folder.

    Raises
    ------
    BlockingIOError
        Another run has it.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, encoding="utf-8")
        self.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(message)s"))
        assert self.stream is not None
        self.is_alone = True
        try:
            fcntl.flock(self.stream, fcntl.LOCK_EX | fcntl.LOCK_NB)  # the system gives it back, however this ends
        except BlockingIOError:
            self.close()
            raise
        except OSError:  # a file system without locks
            self.is_alone = False

    def check_there(self) -> None:
        """Raise CaseError where the file does not lie any more where it was opened, nor, it seems, what else was."""
        path = Path(self.baseFilename)
        assert self.stream is not None
        try:
            found = path.stat()
        except OSError:
            found = None
        if found is None or not os.path.samestat(found, os.fstat(self.stream.fileno())):
            raise CaseError(f"{path.parent}: what lay there was removed while the run wrote to it: run it again")

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - the name is that of logging
        """Leave a line out that the disk does not take: what else it does not take ends the run with a sentence."""

    def close(self) -> None:
        """Close it, also where the disk does not take the last lines."""
        with suppress(OSError):
            super().close()


@contextmanager
def talking(quiet: bool, verbose: bool) -> Iterator[Console | None]:
    """Send messages to standard error, as loud as asked for, until the end, and no longer to any log.txt.

    Yield where bars of progress may be drawn, else None.
    """
    _hush()
    handler = Terminal()
    handler.setLevel(logging.ERROR if quiet else logging.DEBUG if verbose else logging.INFO)
    log.addHandler(handler)
    log.setLevel(logging.DEBUG)
    log.propagate = False
    try:
        yield handler.console if handler.is_live and not quiet else None
    finally:
        _hush()


def _hush() -> None:
    """Send messages nowhere."""
    for old in list(log.handlers):
        log.removeHandler(old)
        old.close()


def log_to(folder: Path, program: str) -> LogFile:
    """Send all messages to log.txt too, after those of earlier runs; remove what runs that were cut off left behind.

    Raises
    ------
    CaseError
        Nothing can be written there, or another run writes there.
    """
    path = folder / "log.txt"
    try:
        made_folder(folder)
        check_no_folder(path)
        if path.is_fifo():  # to open it would wait for a reader
            raise CaseError(f"{path}: a pipe, no file; remove it")
        handler = LogFile(path)
    except BlockingIOError:
        raise CaseError(
            f"{folder}: another run{_last_process(path)} is writing there: wait for it or name another folder with -o"
        ) from None
    except OSError as error:
        raise CaseError(f"{folder}: cannot write there ({error.strerror}); name another folder with -o") from None
    log.addHandler(handler)
    log.debug("%s, %s, process %d", " ".join(sys.argv), program, os.getpid())
    if handler.is_alone:
        remove_temporaries(folder)
    return handler


def _last_process(path: Path) -> str:
    """Say which process began to write a log.txt last."""
    found = re.findall(r", process (\d+)$", path.read_text(encoding="utf-8", errors="replace"), re.MULTILINE)
    return f" (process {found[-1]})" if found else ""


def print_data(text: str) -> None:
    """Print on standard output; whoever reads it may stop early."""
    try:
        print(text, flush=True)
    except OSError as error:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - so that the interpreter's own flush at exit is quiet
        if not isinstance(error, BrokenPipeError):
            error.filename = "standard output"
            raise


def print_json(data: Mapping[str, Any]) -> None:
    """Print a table of data."""
    print_data(json.dumps(data, indent=2))
