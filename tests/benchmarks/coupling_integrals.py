"""How the coupling integrals of segment and element cells converge on curved faces, and what segment cells cost.

OMP_NUM_THREADS=1 python -m tests.benchmarks.coupling_integrals

Does not measure the assembly of the operators, nor several faces on a side.
"""

import time
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from geom2iga.bspline import Array
from geom2iga.model import Model
from solve.contact.cells import Cells, element_cells, segment_cells
from solve.face import Surface
from tests.cases import block_patch, model_of
from tests.solve.contact.curved_faces import averages, products, rings, shells, sides, waves

TURN = Rotation.from_rotvec([0.1, 0.2, 0.5])
PAIRS: dict[str, tuple[Model, str, str]] = {
    "cylinders, degrees 2 and 3, a gap": (rings((2, 3), (3, 4), 0.1), "inner/right", "outer/left"),
    "spheres, turned, a gap": (shells((3, 4), 0.1, TURN), "inner/top", "outer/bottom"),
    "waves, degree 3, a gap": (waves(3, ((4, 4), (5, 3)), 20.0, 1.2), "upper/bottom", "lower/top"),
    "waves, degree 2, overhanging": (waves(2, ((4, 4), (5, 3)), 20.0, 2.5), "upper/bottom", "lower/top"),
}
COUNTS = range(2, 15)
FINEST = 24
BRUTE = 150  # points per span and direction
SPANS = (25, 50, 100, 200)


def integrals(cells: tuple[Cells, ...], pair: tuple[Surface, Surface]) -> tuple[Array, Array, Array]:
    """∫R_A, ∫R_A R_B and ∫R_A g over the secondary side."""
    each = averages(cells[0], pair[0])
    return each[:, 0], products(cells[0], *pair), each[:, 1]


def errors(found: tuple[Array, ...], exact: tuple[Array, ...]) -> str:
    """Largest differences, in units of the largest integral of each kind; of the gap, where there is one."""
    scales = [max(np.abs(values).max(), 1e-12) for values in exact]
    return " ".join(f"{np.abs(a - b).max() / s:10.1e}" for a, b, s in zip(found, exact, scales, strict=True))


def convergence(name: str) -> None:
    """Print the errors of one pair over the number of points."""
    model, *names = PAIRS[name]
    pair = sides(model, *names)

    def by(make: Callable[..., tuple[Cells, ...]], count: int | None) -> tuple[Array, Array, Array]:
        return integrals(make(pair[0], [pair[1]], count), pair)

    exact = by(segment_cells, FINEST)
    print(f"\n{name}: errors of the integrals of R_A, R_A R_B, R_A g")
    print("points                segment cells                     element cells")
    for count in COUNTS:
        print(f"{count:6d} {errors(by(segment_cells, count), exact)}  {errors(by(element_cells, count), exact)}")
    print(f"chosen {errors(by(segment_cells, None), exact)}")
    print(f"brute force, {BRUTE}² points a span       {errors(by(element_cells, BRUTE), exact)}")


def cost() -> None:
    """Print the seconds that segment cells take between planes and between spheres."""
    print("\nspans a side   points    seconds")
    for count in SPANS:
        lower = block_patch("lower", size=(2, 2, 1), spans=(count, count, 1))
        upper = block_patch("upper", (0, 0, 1), (2, 2, 1), spans=(count - count // 20, count + count // 20, 1))
        _print_cost(f"{count:4d} plane  ", *sides(model_of(lower, upper), "upper/bottom", "lower/top"))
    for count in SPANS[:2]:
        pair = sides(shells((count, count + count // 20), 0.0, TURN), "inner/top", "outer/bottom")
        _print_cost(f"{count:4d} sphere ", *pair)


def _print_cost(name: str, secondary: Surface, primary: Surface) -> None:
    began = time.process_time()
    (cells,) = segment_cells(secondary, [primary])
    print(f"{name} {len(cells.area):10d} {time.process_time() - began:8.2f}")


if __name__ == "__main__":
    for pair_name in PAIRS:
        convergence(pair_name)
    cost()
