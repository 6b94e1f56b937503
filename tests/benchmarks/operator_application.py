"""How long one application of the stiffness takes: ours, which stores no matrix, against scipy's product with one.

OMP_NUM_THREADS=1 python -m tests.benchmarks.operator_application
OMP_NUM_THREADS=1 python -m tests.benchmarks.operator_application --degrees 2 --spans 16

One patch, all degrees of freedom, all ways in one process in turns. The matrix is ours, in compressed rows with 32-bit
column numbers, as scipy multiplies it fastest. Not measured: how long either takes to set up (see assembly.py), several
patches, other libraries' products.
"""

import argparse
import statistics
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix

import geom2iga
from geom2iga.model import Model
from geom2iga.threads import thread_count
from solve.case import SolveCase
from solve.elasticity import assemble_stiffness
from solve.material import find_materials
from solve.operator import Stiffness
from solve.rules import exact_rules, smooth_rules
from solve.space import number_control_points
from tests.benchmarks import harness
from tests.benchmarks.bulk_elasticity import GEOMETRIES, jobs
from tests.benchmarks.peers.case_elasticity import elasticity_case

HEADER = ("application", "ms", "matrix product / ours", "off by", "MB stored")
LEAST = 0.5  # seconds of each way in all


def ways(model: Model, case: dict[str, Any]) -> Iterator[tuple[str, Any, int]]:
    """Name, operator and bytes of the arrays, where these are a matrix, of each way; the matrix first."""
    space = number_control_points(model)
    materials = find_materials(model, SolveCase.model_validate({"solve": case["solve"]}).solve)
    matrix = assemble_stiffness(space, materials)
    small = csr_matrix((matrix.data, matrix.indices.astype(np.int32), matrix.indptr.astype(np.int64)), matrix.shape)
    del matrix
    single = csr_matrix((small.data.astype(np.float32), small.indices, small.indptr), small.shape)
    yield "scipy's product with the matrix", small, stored(small)
    yield "the same in single precision", single, stored(single)
    yield "ours, points for smooth splines", Stiffness(space, materials, smooth_rules(space)), 0
    yield "ours, the same in single precision", Stiffness(space, materials, smooth_rules(space), np.float32), 0
    yield "ours, exact points", Stiffness(space, materials, exact_rules(space)), 0


def stored(matrix: csr_matrix) -> int:
    """Bytes of the arrays of a matrix."""
    return matrix.data.nbytes + matrix.indices.nbytes + matrix.indptr.nbytes


def rows(held: list[tuple[str, Any, int]]) -> Iterator[list[str]]:
    """What each way took, the median over rounds, and of the ratios in each round."""
    vector = np.random.default_rng(0).normal(size=held[0][1].shape[0])
    exact = held[0][1] @ vector
    off = [float(np.linalg.norm(each @ vector - exact) / np.linalg.norm(exact)) for _, each, _ in held]
    taken = measured([partial(each.__matmul__, vector.astype(each.dtype)) for _, each, _ in held])
    for (name, _, size), error, seconds in zip(held, off, taken, strict=True):
        ratio = statistics.median(one / other for one, other in zip(taken[0], seconds, strict=True))
        yield [
            name,
            f"{1e3 * statistics.median(seconds):.1f}",
            f"{ratio:.1f}",
            f"{error:.0e}",
            f"{size / 1e6:.0f}" if size else "",
        ]


def measured(calls: list[Callable[[], Any]]) -> list[list[float]]:
    """Seconds of each call in each round, at least five."""
    seconds: list[list[float]] = [[] for _ in calls]
    while len(seconds[0]) < 5 or sum(map(sum, seconds)) < LEAST * len(calls):
        for call, each in zip(calls, seconds, strict=True):
            began = time.perf_counter()
            call()
            each.append(time.perf_counter() - began)
    return seconds


def section(geometry: str, degree: int, spans: int) -> str:
    """Heading and table of one size."""
    case = elasticity_case(geometry, degree, spans)
    held = list(ways(geom2iga.build(case), case))
    heading = f"**{geometry}, degree {degree}, {spans}³ spans, {held[0][1].shape[0]} degrees of freedom**"
    return f"{heading}\n\n{harness.markdown(HEADER, rows(held))}"


def main() -> None:
    """Print the tables, and put them into a file where one is named."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--geometries", nargs="+", default=["cube"], choices=GEOMETRIES)
    parser.add_argument("--degrees", nargs="+", type=int, default=[2, 3])
    parser.add_argument("--spans", nargs="+", type=int, default=[16, 32])
    parser.add_argument("--write", help="put the tables between their marks in this file, too")
    options = parser.parse_args()
    text = "\n\n".join([f"{harness.machine(thread_count())}.", *(section(*job) for job in jobs(options))])
    harness.publish(text, "operator application", options.write)


if __name__ == "__main__":
    main()
