"""Run iga-run on case files that are nearly right, and tell which runs did not end as a command should.

Each mutant must end with exit 0, 2, 3, 4 (or 5, where it has [[verify]]), with one clear line where it failed, within a
bounded time and memory, and leave whole files only. Each has a number and can be repeated by it:

    python -m tests.robustness.case_mutants --count 5000 --first 0 --workers 2
    python -m tests.robustness.case_mutants --first 137 --count 1 --show
"""

import argparse
import multiprocessing
import os
import resource
import signal
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import count
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Lock

from tests.robustness.attempt import Ending, attempted
from tests.robustness.mutation import mutant

MOST_SECONDS, MOST_BYTES = 60, 4 << 30
RENEWED = 200  # mutants after which a process is replaced by a fresh one


class Worker:
    """A process that runs mutants one after the other; one that crashes or hangs is replaced."""

    def __init__(self) -> None:
        self.runs = 0
        self.pipe, theirs = multiprocessing.Pipe()
        self.process = multiprocessing.get_context("spawn").Process(target=_serve, args=(theirs,), daemon=False)
        self.process.start()
        theirs.close()
        self.pipe.recv()  # it is ready

    def run(self, number: int) -> Ending:
        """Run one mutant, within the bound of time."""
        self.runs += 1
        self.pipe.send(number)
        try:
            if self.pipe.poll(MOST_SECONDS):
                return self.pipe.recv()
        except EOFError:
            self.process.join()
            return Ending(-1, "", (f"crashed: exit code {self.process.exitcode}",))
        return Ending(-1, "", (f"took longer than {MOST_SECONDS} s",))

    def end(self) -> None:
        """Kill it with all its children."""
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.join()
        self.pipe.close()


def _serve(pipe: Connection) -> None:
    """Run the mutants whose numbers arrive."""
    os.setsid()
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES, MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    pipe.send("ready")
    while True:
        try:
            number = pipe.recv()
        except EOFError:
            return
        pipe.send(attempted(mutant(number)))


def endings(numbers: Iterator[int]) -> Iterator[tuple[int, Ending]]:
    """Run mutants in one process at a time."""
    worker = Worker()
    try:
        for number in numbers:
            ending = worker.run(number)
            yield number, ending
            if ending.code < 0 or worker.runs >= RENEWED:
                worker.end()
                worker = Worker()
    finally:
        worker.end()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the mutants; return 1 where one was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=5000, help="number of mutants")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--workers", type=int, default=1, help="processes at a time")
    parser.add_argument("--show", action="store_true", help="print every message")
    parser.add_argument("--keep", type=Path, help="folder for the case files that went wrong")
    options = parser.parse_args(arguments)
    os.environ |= {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    numbers, lock, wrong, codes = count(options.first), Lock(), [], Counter()

    def shared() -> Iterator[int]:
        while (number := _next(numbers, lock)) < options.first + options.count:
            yield number

    def work(_: int) -> None:
        for number, ending in endings(shared()):
            codes[ending.code] += 1
            if sum(codes.values()) % 100 == 0:
                print(f"{number}: {len(wrong)} wrong so far", file=sys.stderr, flush=True)
            if ending.wrong:
                wrong.append(number)
                _keep(options.keep, number)
            if ending.wrong or options.show:
                print(
                    f"{number}: exit {ending.code} {'; '.join(ending.wrong)}\n    {ending.text[-1500:]!r}", flush=True
                )

    with ThreadPoolExecutor(options.workers) as pool:
        list(pool.map(work, range(options.workers)))
    found = ", ".join(f"{number} exit {code}" for code, number in sorted(codes.items()))
    print(f"{sum(codes.values())} mutants: {found}; {len(wrong)} wrong{': ' if wrong else ''}{sorted(wrong) or ''}")
    return 1 if wrong else 0


def _next(numbers: Iterator[int], lock: Lock) -> int:
    with lock:
        return next(numbers)


def _keep(folder: Path | None, number: int) -> None:
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{number}.toml").write_bytes(mutant(number).content)


if __name__ == "__main__":
    raise SystemExit(main())
