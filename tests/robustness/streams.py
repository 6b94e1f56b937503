"""What a process and its libraries say."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def written_to(file: int) -> Iterator[None]:
    """Send what this process and its libraries in C write to a file."""
    streams, kept = (sys.stdout, sys.stderr), (os.dup(1), os.dup(2))
    with open(os.dup(file), "w", encoding="utf-8", errors="backslashreplace", buffering=1) as stream:
        sys.stdout = sys.stderr = stream
        os.dup2(file, 1)
        os.dup2(file, 2)
        try:
            yield
        finally:
            stream.flush()
            sys.stdout, sys.stderr = streams
            for number, copy in enumerate(kept, 1):
                os.dup2(copy, number)
                os.close(copy)
