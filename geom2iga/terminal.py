"""What the commands say: messages on standard error and in log.txt, data on standard output."""

import json
import logging
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from geom2iga.errors import CaseError

STYLES = ((logging.ERROR, "red"), (logging.WARNING, "yellow"))

log = logging.getLogger("geom2iga")


class Terminal(logging.Handler):
    """Prints messages on standard error, warnings in yellow, errors in red, without breaking lines."""

    def __init__(self) -> None:
        super().__init__()
        self.console = Console(stderr=True, soft_wrap=True, markup=False, highlight=False)

    @property
    def is_live(self) -> bool:
        """Whether somebody looks at a terminal that can move its cursor; not so where output is piped or recorded."""
        return self.console.file.isatty() and not self.console.is_dumb_terminal

    def emit(self, record: logging.LogRecord) -> None:
        """Print one message."""
        style = next((style for level, style in STYLES if record.levelno >= level), None)
        self.console.print(self.format(record), style=style)


def talk(quiet: bool, verbose: bool) -> Console | None:
    """Send messages to standard error, as loud as asked for; return where bars of progress may be drawn, else None."""
    for old in list(log.handlers):
        log.removeHandler(old)
        old.close()
    handler = Terminal()
    handler.setLevel(logging.ERROR if quiet else logging.DEBUG if verbose else logging.INFO)
    log.addHandler(handler)
    log.setLevel(logging.DEBUG)
    log.propagate = False
    return handler.console if handler.is_live and not quiet else None


def log_to(folder: Path, program: str) -> None:
    """Send all messages to log.txt too, after those of earlier runs."""
    path = folder / "log.txt"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handler = logging.FileHandler(path, encoding="utf-8")
    except OSError as error:
        raise CaseError(f"{folder}: cannot write there ({error.strerror}); name another folder with -o") from None
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(message)s"))
    log.addHandler(handler)
    log.debug("%s, %s, process %d", " ".join(sys.argv), program, os.getpid())


def print_data(text: str) -> None:
    """Print on standard output; whoever reads it may stop early."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - so that the interpreter's own flush at exit is quiet


def print_json(data: Mapping[str, Any]) -> None:
    """Print a table of data."""
    print_data(json.dumps(data, indent=2))
