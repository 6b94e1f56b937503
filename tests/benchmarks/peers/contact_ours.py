"""Ours: two blocks by splines of a degree, through the public functions.

python contact_ours.py SPANS DEGREE [METHOD]

It has as many unknowns as linear hexahedra with SPANS below and one less above. The time is that of the whole process
up to the solution; the stresses for the error are evaluated after it.
"""

import sys
from typing import Any

import numpy as np
from common import memory, since_start
from two_blocks import POISSON, PRESSURE, STRESS, YOUNG, report

import solve
from geom2iga import build

POINTS = 2000  # random points per block
TOLERANCE = 1e-10  # of the forces; the stress is to be exact within 1e-9


def two_blocks(spans: int, degree: int, method: str | None) -> dict[str, Any]:
    """The case: as many control points as the hexahedra have nodes."""
    cubes = [
        {"name": name, "origin": [0.0, 0.0, z], "size": [1.0, 1.0, 1.0], "spans": [spans - less - degree + 1] * 3}
        for name, z, less in (("lower", 0.0, 0), ("upper", 1.0, 1))
    ]
    held = ("lower/bottom", "lower/left", "lower/front", "upper/left", "upper/front")
    case: dict[str, Any] = {
        "material": [{"young": YOUNG, "poisson": POISSON}],
        "support": [{"on": face, "normal": 0.0} for face in held],
        "load": [{"on": "upper/top", "pressure": PRESSURE}],
        "contact": [{"secondary": "upper/bottom", "primary": "lower/top"}],
        "newton": {"tolerance": TOLERANCE},
        "linear": {"method": method or "auto"},
    }
    return {"geometry": {"degree": degree, "block": cubes}, "solve": case}


def largest_error(result: solve.Result) -> float:
    """Largest difference of any stress from the exact one, over the pressure, at random points."""
    from post.fields import sample_at

    random = np.random.default_rng(0)
    found = [sample_at(result, name, random.random((POINTS, 3))).stress for name in result.model.patches]
    return float(np.abs(np.concatenate(found) - STRESS).max() / PRESSURE)


def main() -> None:
    """Solve."""
    imports = since_start()
    case = two_blocks(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3] if sys.argv[3:] else None)
    result = solve.solve(build(case), case)
    seconds, peak = since_start(), memory("VmHWM")
    result.check_converged()
    statistics = result.statistics
    report(
        version=solve_version(),
        unknowns=3 * len(result.space.control_points),
        seconds={"whole": seconds},
        phases={"imports": imports, **statistics["seconds"]},
        peak=peak,
        error=largest_error(result),
        steps=statistics["newton_iterations"],
        iterations=statistics["linear_iterations"],
        solver=statistics["linear_solver"],
    )


def solve_version() -> str:
    """The version of the package."""
    from importlib.metadata import version

    return version("geom2iga")


if __name__ == "__main__":
    main()
