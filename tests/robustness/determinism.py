"""Run cases again and again: the same bytes but for times, and with more threads the same numbers to rounding.

Each case runs three times in processes and folders of its own: twice with one thread, whose hashes of text are seeded
differently, then with two. Of the first two runs all files must be the same but for what is measured: `seconds` and
`peak_memory` in summary.json, statistics and history of solution.h5 and history.csv, log and report. Of the third,
displacement, pressure and all else that solution.h5 holds must be the same to 1e-12 of its largest value.

    python -m tests.robustness.determinism                          a few examples
    python -m tests.robustness.determinism CASE.toml ... --threads 1 2 2 4
"""

import argparse
import csv
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from geom2iga.bspline import Array

ROOT = Path(__file__).parents[2]
EXAMPLES = ("contact_patch_test", "stack", "lame_rings", "cad_patch_test", "sliding_punch")
MEASURED = ("seconds", "peak_memory")  # what no two runs have in common
SHOWING_TIMES = {"log.txt", "report.html"}  # among other text; the scene of the report is an archive besides
CLOSE = 1e-12


def run(case: Path, folder: Path, threads: int = 1, seed: int = 0) -> Path:
    """Copy the folder of a case, run all stages there in a process of its own, and return where the output lies."""
    shutil.copytree(case.parent, folder, ignore=shutil.ignore_patterns("*.out"))
    counts = {"OMP_NUM_THREADS": str(threads), "MKL_NUM_THREADS": str(threads)}
    environment = os.environ | counts | {"PYTHONHASHSEED": str(seed), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "post.pipeline", "-q", case.name, "-o", "results"]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{case} with {threads} threads: exit {done.returncode}: {done.stderr.strip()}")
    return folder / "results"


def differing(one: Path, other: Path) -> list[str]:
    """Names of the files of two folders that differ, but for what is measured."""
    names = sorted({path.name for folder in (one, other) for path in folder.iterdir()} - SHOWING_TIMES)
    return [name for name in names if not _same(one / name, other / name)]


def _same(one: Path, other: Path) -> bool:
    if not (one.is_file() and other.is_file()):
        return False
    read = READERS.get(one.name, Path.read_bytes)
    return read(one) == read(other)


def _summary(path: Path) -> str:
    """summary.json without what is measured, in its sequence."""
    found = json.loads(path.read_text(encoding="utf-8"))
    return json.dumps({key: value for key, value in found.items() if key not in MEASURED})


def _history(path: Path) -> list[dict[str, str]]:
    """history.csv without seconds."""
    with path.open(encoding="utf-8", newline="") as file:
        return [{key: value for key, value in row.items() if key not in MEASURED} for row in csv.DictReader(file)]


def _solution(path: Path) -> dict[str, Any]:
    """All arrays and attributes of solution.h5, without what is measured."""
    found: dict[str, Any] = {}

    def visit(name: str, item: Any) -> None:
        found[name] = item[()].tobytes() if isinstance(item, h5py.Dataset) and item.dtype != object else None
        found[name + " attributes"] = {key: _told(value) for key, value in item.attrs.items()}

    with h5py.File(path) as file:
        visit("", file)
        file.visititems(visit)
    return found


def _told(value: Any) -> Any:
    """An attribute; of JSON without what is measured."""
    if not isinstance(value, str) or not value.startswith(("{", "[")):
        return repr(value)
    read = json.loads(value)
    rows = read if isinstance(read, list) else [read]
    return [{k: v for k, v in r.items() if k not in MEASURED} if isinstance(r, dict) else r for r in rows]


READERS = {"summary.json": _summary, "history.csv": _history, "solution.h5": _solution}


def distance(one: Path, other: Path) -> float:
    """Largest difference of the states in two solution.h5, over the largest value of the same kind in all states.

    Gaps are compared with displacements, and moments with the forces times the size of the model: they may be zero.
    """
    first, second = _states(one / "solution.h5"), _states(other / "solution.h5")
    if {name: values.shape for name, values in first.items()} != {n: values.shape for n, values in second.items()}:
        return float("inf")
    sizes: dict[str, float] = {}
    for name, values in first.items():
        kind = name.rsplit("/", 1)[-1]
        sizes[kind] = max(sizes.get(kind, 0.0), float(np.abs(values).max(initial=0.0)))
    sizes["control_gap"] = sizes["displacement"]
    sizes["moment"] = max(sizes["moment"], sizes["force"] * sizes.get("centres", 0.0))
    apart = [
        float(np.abs(second[name] - values).max(initial=0.0)) / (sizes[name.rsplit("/", 1)[-1]] or 1.0)
        for name, values in first.items()
    ]
    return max(apart)


def _states(path: Path) -> dict[str, Array]:
    """All finite numbers of the states in solution.h5, by their place there."""
    found: dict[str, Array] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            found[name] = np.nan_to_num(np.asarray(item[()], dtype=float), posinf=0.0)

    with h5py.File(path) as file:
        file["states"].visititems(visit)
    return found


def check(case: Path, threads: Sequence[int] = (1, 1, 2)) -> tuple[list[str], float]:
    """Run a case once per number of threads: files that differ in the first two runs, and the largest distance."""
    with tempfile.TemporaryDirectory() as scratch:
        runs = [run(case, Path(scratch, f"run {n}", "case"), count, n) for n, count in enumerate(threads)]
        return differing(*runs[:2]), max(distance(runs[0], other) for other in runs[1:])


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a table and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", type=Path, help="case files; left out, some of the examples")
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 1, 2], help="of each run, the first two the same")
    options = parser.parse_args(arguments)
    cases = options.cases or [ROOT / "examples" / name / "case.toml" for name in EXAMPLES]
    wrong = 0
    for case in cases:
        files, apart = check(case.resolve(), options.threads)
        wrong += bool(files) or not apart <= CLOSE
        told = ", ".join(files) or "none"
        print(f"{case.parent.name}/{case.stem}: files that differ: {told}; with other threads {apart:.1e}", flush=True)
    print(f"{len(cases)} cases, {len(options.threads)} runs each; {wrong} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
