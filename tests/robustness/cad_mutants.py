"""Run geom2iga on CAD files that are nearly right, and tell which runs did not end as a command should.

Each mutant of a STEP, BREP, IGES, XAO, .geo or G+Smo file must end with exit 0, 2 or 3, with one clear line where it
failed and none where it did not, within a bounded time and memory; it must leave no process, no temporary file and
nothing half written. Each has a number and can be repeated by it:

    python -m tests.robustness.cad_mutants --count 500 --first 0
    python -m tests.robustness.cad_mutants --first 137 --count 1 --show
"""

import argparse
import multiprocessing
import os
import resource
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import psutil

from geom2iga.__main__ import main as command
from geom2iga.cad import importing
from geom2iga.files import read_model
from tests.robustness.attempt import LONGEST, Ending
from tests.robustness.cad_mutation import lay_out, mutant
from tests.robustness.streams import written_to

GMSH_SECONDS = 10.0  # that gmsh may take in these runs: the models are small
MOST_SECONDS = 40.0  # of a whole run
MOST_BYTES = 3 << 30
ALLOWED = {"case.toml", "case.out", "beside.geo", "elsewhere", "temporary"}


def attempted(number: int) -> Ending:
    """Run a mutant in a folder of its own, with little patience."""
    case = mutant(number)
    with tempfile.TemporaryDirectory(prefix="mutant") as name:
        folder, began = Path(name), time.monotonic()
        lay_out(case, folder)
        text, code = _run(folder)
        wrong = [*_wrong_words(code, text), *_wrong_leavings(folder, code, case.name)]
        if (seconds := time.monotonic() - began) > MOST_SECONDS:
            wrong.append(f"took {seconds:.0f} s")
    return Ending(code, text, tuple(wrong))


def _run(folder: Path) -> tuple[str, int]:
    """Run the command there; return all that it and its libraries wrote on standard output and error, and its code."""
    here, temporary, patience = Path.cwd(), tempfile.tempdir, importing.PATIENCE
    (folder / "temporary").mkdir()
    with tempfile.TemporaryFile() as said, warnings.catch_warnings():
        warnings.simplefilter("always")
        os.chdir(folder)
        tempfile.tempdir, importing.PATIENCE = str(folder / "temporary"), GMSH_SECONDS
        try:
            with written_to(said.fileno()):
                code = command(["-q", "case.toml"])
        finally:
            os.chdir(here)
            tempfile.tempdir, importing.PATIENCE = temporary, patience
        said.seek(0)
        return said.read().decode("utf-8", errors="replace"), code


def _wrong_words(code: int, text: str) -> Iterator[str]:
    """Yield what is wrong with an exit code and with what was said."""
    if code not in (0, 2, 3):
        yield f"exit {code}"
    if text.count("\n") != (code != 0) or not text.replace("\n", "").isprintable():
        yield "not one line where it failed, or something where it did not"
    if len(text) > LONGEST:
        yield f"more than {LONGEST} characters"


def _wrong_leavings(folder: Path, code: int, file: str) -> Iterator[str]:
    """Yield what a run should not have left, or should have."""
    if left := [path.name for path in (folder / "temporary").iterdir()]:
        yield f"temporary files: {left}"
    if more := {path.name for path in folder.iterdir()} - {*ALLOWED, file}:
        yield f"files beside the case: {sorted(more)}"
    out = folder / "case.out"
    names = {path.name for path in out.iterdir()} if out.is_dir() else set()
    if names - {"log.txt"} != ({"geometry.h5"} if code == 0 else set()):
        yield f"in case.out: {sorted(names)}"
    elif code == 0:
        read_model(out / "geometry.h5")
    if left := [process.pid for process in psutil.process_iter(["cmdline"]) if _is_of(process, folder)]:
        yield f"processes: {left}"


def _is_of(process: psutil.Process, folder: Path) -> bool:
    """Whether a process was started for a run in a folder."""
    return any(str(folder) in word for word in process.info["cmdline"] or ())


def _limited() -> None:
    """Bound the memory of a process and of those that it starts."""
    os.environ |= {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES, MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def endings(numbers: Sequence[int], workers: int) -> Iterator[tuple[int, Ending]]:
    """Run mutants in processes beside this one; after a crash the rest goes on in fresh ones."""
    left = list(numbers)
    while left:
        with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _limited) as pool:
            for number, future in [(number, pool.submit(attempted, number)) for number in left]:
                left.remove(number)
                try:
                    yield number, future.result()
                except BrokenProcessPool:
                    yield number, Ending(-1, "", ("crashed, or one beside it did",))
                    break


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the mutants; return 1 where one was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=500, help="number of mutants")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--workers", type=int, default=1, help="processes at a time")
    parser.add_argument("--show", action="store_true", help="print every message")
    options = parser.parse_args(arguments)
    wrong, codes = [], Counter[int]()
    for number, ending in endings(range(options.first, options.first + options.count), options.workers):
        codes[ending.code] += 1
        if ending.wrong:
            wrong.append(number)
        if ending.wrong or options.show:
            how = "; ".join(ending.wrong) or "well"
            print(f"{number}: {mutant(number).name}, exit {ending.code}, {how}\n    {ending.text!r}", flush=True)
    found = ", ".join(f"{number} exit {code}" for code, number in sorted(codes.items()))
    print(f"{sum(codes.values())} mutants: {found}; {len(wrong)} wrong{': ' if wrong else ''}{wrong or ''}")
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
