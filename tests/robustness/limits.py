"""Whether --max-memory, --max-time and --threads hold, seen from outside, and whether what was stopped goes on.

python -m tests.robustness.limits
python -m tests.robustness.limits --spans 8 16 --memory 0.3 1 --time 3 10

Patch tests of growing size in several load steps run under limits, as commands. Memory is that of the command and all
that it starts, looked at many times a second; time is that of the whole process. A case that was stopped is run again
without limits: its solution must be that of a run that never was. Threads are processor time over time.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil

from geom2iga.limits import BEYOND, GRACE
from solve.files import read_result
from tests.cases import patch_test_case

PAUSE = 0.01  # seconds between two looks
BASE = 0.15e9  # bytes of the program itself, and of what is touched between two of its own looks
START = 3.0  # times what the interpreter and the imports take, on a machine that others use, too
STEPS = 4
ALONE = 0.1  # by which processor time may exceed the threads asked for


class Run(NamedTuple):
    """What was seen of a command."""

    code: int
    peak: float  # [bytes]
    seconds: float
    processor: float  # seconds
    said: str  # last line


def watched(module: str, arguments: Sequence[object]) -> Run:
    """Run a command and look at it from outside."""
    began = time.perf_counter()
    command = [sys.executable, "-m", module, *map(str, arguments)]
    with tempfile.TemporaryFile("w+") as said:
        running = subprocess.Popen(command, stderr=said, stdout=subprocess.DEVNULL)
        process, peak, used = psutil.Process(running.pid), 0.0, 0.0
        while running.poll() is None:
            with suppress(psutil.Error):
                family = [process, *process.children(recursive=True)]
                peak = max(peak, sum(each.memory_info().rss for each in family))
                used = max(used, sum(sum(each.cpu_times()[:2]) for each in family))
            time.sleep(PAUSE)
        seconds = time.perf_counter() - began
        said.seek(0)
        lines = said.read().splitlines()
    return Run(running.returncode, peak, seconds, used, lines[-1] if lines else "")


def written(folder: Path, spans: int, method: str) -> Path:
    """Write a patch test, in load steps."""
    case = patch_test_case(2, (spans,) * 3, (spans - 1,) * 3, penalty="auto")
    case["solve"] |= {"linear": {"method": method}, "steps": {"count": STEPS}}
    case["post"] = {"pictures": False, "report": False}
    path = folder / f"{method}_{spans}.toml"
    path.write_text(toml(case), encoding="utf-8")
    return path


def toml(case: dict) -> str:
    """Write a case as TOML: inline tables are JSON but for the sign of equality."""
    return "\n".join(f"{key} = {_inline(value)}" for key, value in case.items())


def _inline(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_inline(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return json.dumps(value)


def same(one: Path, other: Path) -> bool:
    """Whether two solutions have the same numbers."""
    pairs = zip(read_result(one).states, read_result(other).states, strict=True)
    return all(np.array_equal(a.displacement, b.displacement) for a, b in pairs)


def tried(case: Path, limit: Sequence[str], reference: Path) -> tuple[str, bool]:
    """Run a case under a limit, and again without; return a line of the table, and whether all was right."""
    flag, value = limit
    start = START * watched("post.pipeline", ["--version"]).seconds
    with tempfile.TemporaryDirectory() as folder:
        run = watched("post.pipeline", [case, "-o", folder, "--threads", 1, flag, value])
        if flag == "--max-memory":
            held = run.peak <= BEYOND * float(value) * 1e9 + BASE and run.code in (0, 2)
        else:
            held = run.seconds <= float(value) + GRACE + start and run.code in (0, 4)
        again = watched("post.pipeline", [case, "-o", folder, "--threads", 1])
        goes_on = again.code == 0 and same(Path(folder) / "solution.h5", reference / "solution.h5")
    line = f"| {case.stem} | {flag} {value} | {run.peak / 1e6:.0f} | {run.seconds:.1f} | {run.code} | "
    return (
        f"{line}{'held' if held else 'PASSED'} | {'same' if goes_on else 'OTHER'} | {run.said[:70]} |",
        held and goes_on,
    )


def cores(case: Path, threads: int) -> tuple[str, bool]:
    """Run a case on some threads; return a line of the table, and whether no more processors were busy."""
    with tempfile.TemporaryDirectory() as folder:
        run = watched("post.pipeline", [case, "-o", folder, "--threads", threads])
    busy = run.processor / run.seconds
    good = run.code == 0 and busy <= threads + ALONE
    return f"| {case.stem} | --threads {threads} | {busy:.2f} | {'held' if good else 'PASSED'} |", good


def main() -> int:
    """Print the tables; 1 where a limit did not hold."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--spans", type=int, nargs="+", default=[8, 16, 24], help="of the lower block")
    parser.add_argument("--memory", nargs="+", default=["0.2", "0.4", "0.8"], help="limits [GB]")
    parser.add_argument("--time", nargs="+", default=["2", "5", "10"], help="limits [s]")
    options = parser.parse_args()
    limits = [("--max-memory", value) for value in options.memory] + [("--max-time", value) for value in options.time]
    found = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print("| case | limit | peak MB | s | exit code | | run again | said |\n" + "| --- " * 8 + "|")
        for method in ("direct", "iterative"):
            for case in [written(folder, spans, method) for spans in options.spans]:
                reference = folder / f"{case.stem}.out"
                watched("post.pipeline", [case, "--threads", 1])
                for limit in limits:
                    line, good = tried(case, limit, reference)
                    print(line, flush=True)
                    found.append(good)
        print("\n| case | threads | processors busy | |\n" + "| --- " * 4 + "|")
        for method in ("direct", "iterative"):
            for threads in (1, 2):
                line, good = cores(written(folder, options.spans[-1], method), threads)
                print(line, flush=True)
                found.append(good)
    print(f"{len(found)} runs: {found.count(False)} wrong")
    return int(not all(found))


if __name__ == "__main__":
    raise SystemExit(main())
