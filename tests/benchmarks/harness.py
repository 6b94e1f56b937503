"""Runs scripts of peers as processes of their own, interleaved, and puts what they report into tables.

Imports nothing but the standard library: the memory of a child begins at that of its parent.
"""

import argparse
import json
import os
import platform
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
OURS = "gmsh"  # a module that only ours needs
QUICK = 10.0  # seconds; jobs that take longer run once
BEFORE = ("imports", "compiling")  # phases before the job
GIB = 2**30

Found = dict[str, Any]


@dataclass(frozen=True)
class Peer:
    """A program that does the job.

    Parameters
    ----------
    name : str
    script : str
        Its file in peers/.
    module : str
        What its interpreter must be able to import.
    arguments : tuple of str
        Behind those of the job.
    program : str
        What must be on the path, if anything.
    """

    name: str
    script: str
    module: str
    arguments: tuple[str, ...] = ()
    program: str = ""


@dataclass(frozen=True)
class Settings:
    """What the command line says of all jobs."""

    interpreters: dict[str, str]
    threads: int
    repeats: int
    limit: float  # seconds of one run
    memory: float  # GiB of one run
    only: tuple[str, ...]
    write: Path | None

    def interpreter(self, peer: Peer) -> str:
        """The interpreter of a peer: its own or that of all, by the command line or the environment, or this one."""
        if peer.module == OURS:
            return sys.executable
        name = peer.module.partition(".")[0]
        own = self.interpreters.get(name) or os.environ.get(f"BENCHMARK_PYTHON_{name.upper()}")
        return own or self.interpreters.get("all") or os.environ.get("BENCHMARK_PYTHON") or sys.executable


def parser(description: str) -> argparse.ArgumentParser:
    """Options that all scripts have."""
    options = argparse.ArgumentParser(
        description=description.partition("\n")[0], formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    options.add_argument(
        "--python",
        action="append",
        default=[],
        metavar="MODULE=PATH",
        help="interpreter of a peer, or of all=PATH; else BENCHMARK_PYTHON_<MODULE>, BENCHMARK_PYTHON, or this one",
    )
    options.add_argument("--threads", type=int, default=1, help="OMP_NUM_THREADS and the like")
    options.add_argument("--repeats", type=int, default=5, help=f"of what takes less than {QUICK:g} s")
    options.add_argument("--limit", type=float, default=900.0, help="seconds after which a run is ended")
    options.add_argument("--memory", type=float, default=16.0, help="GiB of address space that a run may have")
    options.add_argument("--only", nargs="+", default=[], metavar="NAME", help="codes to run; ours always does")
    options.add_argument("--write", type=Path, help="put the tables between their marks in this file, too")
    return options


def settings(options: argparse.Namespace) -> Settings:
    """Read the options that all scripts have."""
    interpreters = dict(pair.split("=", 1) for pair in options.python)
    return Settings(
        interpreters,
        options.threads,
        options.repeats,
        options.limit,
        options.memory,
        tuple(options.only),
        options.write,
    )


def installed(peers: Iterable[Peer], how: Settings) -> tuple[list[Peer], list[str]]:
    """Part the peers into those that can run and the names of those that cannot."""
    found, missing = [], []
    for peer in peers:
        if how.only and peer.name not in how.only and not peer.name.startswith("ours"):
            continue
        present = not peer.program or shutil.which(peer.program)
        if present and imports(how.interpreter(peer), peer.module):
            found.append(peer)
        else:
            missing.append(peer.name)
    return found, missing


def imports(interpreter: str, module: str) -> bool:
    """Whether an interpreter runs and finds a module."""
    test = f"import importlib.util as u, sys; sys.exit(u.find_spec({module!r}) is None)"
    try:
        return subprocess.run([interpreter, "-c", test], cwd=ROOT, capture_output=True).returncode == 0
    except OSError:
        return False


def environment(threads: int) -> dict[str, str]:
    """The environment of all runs."""
    names = ("OMP", "MKL", "OPENBLAS", "NUMBA", "NUTILS", "BLIS")
    count = {f"{name}_NUM_THREADS": str(threads) for name in names} | {"NUTILS_NPROCS": str(threads)}
    return {**os.environ, **count, "PYTHONPATH": str(ROOT), "CCX_NPROC_EQUATION_SOLVER": str(threads)}


def run(peer: Peer, job: Sequence[str], how: Settings) -> Found:
    """Run one job once; what it reports on its last line, with the seconds of the whole process."""
    command = [how.interpreter(peer), str(HERE / "peers" / peer.script), *job, *peer.arguments]
    limit = int(how.memory * GIB)

    def restrict() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))

    began = time.perf_counter()
    try:
        ended = subprocess.run(
            command,
            env=environment(how.threads),
            capture_output=True,
            text=True,
            timeout=how.limit,
            preexec_fn=restrict,
        )
    except subprocess.TimeoutExpired:
        return {"failed": f"over {how.limit:g} s", "wall": how.limit}
    wall = time.perf_counter() - began
    lines = ended.stdout.strip().splitlines()
    try:
        return json.loads(lines[-1]) | {"wall": wall}
    except (IndexError, ValueError):
        words = ended.stderr.strip().splitlines() or [f"ended with {ended.returncode}"]
        return {"failed": words[-1][:120], "wall": wall}


def interleaved(peers: Sequence[Peer], job: Sequence[str], how: Settings) -> dict[Peer, list[Found]]:
    """Run one job by all, round by round; those that fail, skip it or take long run in the first round alone."""
    runs: dict[Peer, list[Found]] = {peer: [] for peer in peers}
    for _ in range(how.repeats):
        for peer, found in runs.items():
            if not found or is_quick(found[0]):
                found.append(run(peer, job, how))
                print(f"  {peer.name}: {shown(found[-1])}", file=sys.stderr, flush=True)
    return runs


def is_quick(found: Found) -> bool:
    """Whether a run went well and its job took little time."""
    phases = found.get("seconds", {"": QUICK})
    return sum(taken for phase, taken in phases.items() if phase not in BEFORE) < QUICK


def shown(found: Found) -> str:
    """One line of what a run found."""
    if "seconds" not in found:
        return found.get("failed") or found["skipped"]
    return ", ".join(f"{phase} {seconds:.2f}" for phase, seconds in found["seconds"].items())


def reasons(runs: dict[Peer, list[Found]]) -> list[str]:
    """Why some have no numbers."""
    return [f"{peer.name}: {shown(found[0])}" for peer, found in runs.items() if "seconds" not in found[0]]


def with_numbers(runs: dict[Peer, list[Found]]) -> dict[Peer, list[Found]]:
    """Those that have numbers; runs that failed after others went well are left out."""
    held = {peer: [found for found in each if "seconds" in found] for peer, each in runs.items()}
    return {peer: each for peer, each in held.items() if each}


def seconds(found: Sequence[Found], *phases: str) -> float:
    """Median over the runs of the seconds of some phases together; nothing where no run has them."""
    return statistics.median(sum(each["seconds"].get(phase, 0.0) for phase in phases) for each in found)


def ratio(found: Sequence[Found], ours: Sequence[Found], *phases: str) -> float:
    """Median over the rounds of how many times as long as ours the phases took."""
    pairs = list(zip(found, ours, strict=False))
    return statistics.median(seconds([one], *phases) / seconds([other], *phases) for one, other in pairs)


def machine(threads: int) -> str:
    """The machine and what runs the tables."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / GIB
    python = platform.python_version()
    return f"{names[0]}, {len(names)} processors, {memory:.0f} GiB, Python {python}, threads per run: {threads}"


def not_installed(missing: Sequence[str]) -> str:
    """A sentence on the peers that are not there."""
    return f"Not installed: {'; '.join(missing)}." if missing else "All peers asked for are installed."


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table."""
    return "\n".join("| " + " | ".join(row) + " |" for row in [header, ["---"] * len(header), *rows])


def publish(text: str, name: str, path: str | Path | None) -> None:
    """Print, and put between the marks of that name in the file where one is wanted."""
    print(text)
    if path:
        marks = (f"<!-- {name} table -->", f"<!-- end of {name} table -->")
        before, rest = Path(path).read_text(encoding="utf-8").split(marks[0])
        after = rest.split(marks[1])[1]
        Path(path).write_text(f"{before}{marks[0]}\n{text}\n{marks[1]}{after}", encoding="utf-8")


def scratch() -> tempfile.TemporaryDirectory[str]:
    """A folder for the files of the jobs."""
    return tempfile.TemporaryDirectory(prefix="benchmark-")
