"""What all peers' scripts share: reading the job, timing phases, taking memory, printing what was found.

A job is a .npz file as prepare.py writes it, so that all solve the same space. Runs in the interpreter of any peer:
needs numpy alone, and Linux for the memory.
"""

import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

TOLERANCE = 1e-8  # residual over load


class Job(NamedTuple):
    """One patch under a body force, its face at the beginning of the third direction clamped.

    `control_points` (n0, n1, n2, 3), `weights` (n0, n1, n2) or None where all are 1, `knots` open, from 0 to 1.
    """

    degrees: tuple[int, ...]
    knots: tuple[Any, ...]
    control_points: Any
    weights: Any
    young: float
    poisson: float
    force: Any  # per volume
    load: Any  # (n0, n1, n2, 3), its integrals against the functions
    solves: bool  # False: only the matrix is wanted

    @property
    def shape(self) -> tuple[int, ...]:
        """Control points in each direction."""
        return self.control_points.shape[:3]

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's constants lambda and mu."""
        young, poisson = self.young, self.poisson
        return young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 + 2 * poisson)

    @property
    def clamped(self) -> Any:
        """Which control points (n0, n1, n2) do not move."""
        clamped = np.zeros(self.shape, dtype=bool)
        clamped[:, :, 0] = True
        return clamped


def read_job() -> Job:
    """Read the job named on the command line."""
    with np.load(sys.argv[1]) as held:
        rational = np.ptp(held["weights"]) > 1e-12
        return Job(
            tuple(int(p) for p in held["degrees"]),
            tuple(held[f"knots{direction}"] for direction in range(3)),
            held["control_points"],
            held["weights"] if rational else None,
            float(held["young"]),
            float(held["poisson"]),
            held["force"],
            held["load"],
            "assembly" not in sys.argv[2:],
        )


def since_start() -> float:
    """Seconds since this process began, to some hundredths."""
    fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
    return time.clock_gettime(time.CLOCK_BOOTTIME) - int(fields[19]) / os.sysconf("SC_CLK_TCK")


def memory(field: str) -> int:
    """Return VmRSS or VmHWM of this process [bytes]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line.split()[1] for line in lines if line.startswith(field)))


class Measured:
    """Seconds and growth of memory by phase, and whatever else is found."""

    def __init__(self, package: str, job: Job) -> None:
        unknowns = 3 * int(np.count_nonzero(~job.clamped))
        self.found: dict[str, Any] = {"version": version(package), "unknowns": unknowns}
        self.found |= {"seconds": {}, "growth": {}, "peak": 0}
        self.found["seconds"]["imports"] = since_start()

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Time what happens inside, and see how far the memory grows above where it began."""
        self.found["peak"] = max(self.found["peak"], memory("VmHWM"))
        Path("/proc/self/clear_refs").write_text("5")  # the high-water mark starts anew
        held, began = memory("VmRSS"), time.perf_counter()
        yield
        self.found["seconds"][name] = time.perf_counter() - began
        self.found["growth"][name] = memory("VmHWM") - held
        self.found["peak"] = max(self.found["peak"], memory("VmHWM"))

    def matrix(self, matrix: Any) -> None:
        """Note the size of a scipy csr matrix, rows that do not matter included."""
        self.found["matrix"] = matrix.data.nbytes + matrix.indices.nbytes + matrix.indptr.nbytes

    def solve(self, matrix: Any, load: Any) -> Any:
        """Solve by conjugate gradients of scipy with the diagonal, for peers that leave solving to their user."""
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import cg

        residuals: list[float] = []
        with self.phase("solve"):
            inverse = diags_array(1 / matrix.diagonal())
            solution, failed = cg(matrix, load, rtol=TOLERANCE, atol=0, M=inverse, callback=residuals.append)
        if failed:
            raise RuntimeError("conjugate gradients did not converge")
        self.found |= {"energy": load @ solution / 2, "iterations": len(residuals), "solver": "CG, diagonal"}
        return solution

    def report(self, **found: Any) -> None:
        """Print all as the last line."""
        print(json.dumps({**self.found, **found}), flush=True)


def skip(reason: str) -> None:
    """End: this peer cannot do this job."""
    print(json.dumps({"skipped": reason}), flush=True)
    sys.exit(0)
