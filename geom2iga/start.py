"""Imported first of all: until a command can say so in a sentence, Ctrl-C ends it at once and without a traceback.

Its libraries take a second to import, and nothing is written by then. Programs that import us keep their signals.
"""

import signal
import sys
import threading
from itertools import pairwise
from pathlib import Path

COMMANDS = ("geom2iga", "iga-solve", "iga-post", "iga-run")
MODULE = "-m"  # what sys.argv begins with while python -m imports the package that it runs
PACKAGES = ("geom2iga", "solve", "post")


def is_command() -> bool:
    """Whether this process runs one of our commands."""
    name = (getattr(sys, "argv", None) or [""])[0]
    if name == MODULE:
        words = (run for flag, run in pairwise(sys.orig_argv) if flag[:1] == "-" and flag[-1:] == "m")  # also -Im
        return next(words, "").partition(".")[0] in PACKAGES
    return Path(name).name in COMMANDS


if (
    is_command()
    and threading.current_thread() is threading.main_thread()
    and signal.getsignal(signal.SIGINT) is signal.default_int_handler
):
    signal.signal(signal.SIGINT, signal.SIG_DFL)
