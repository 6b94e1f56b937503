"""Newton steps and force balance over penalties of 1e1 to 1e9 E/h: `python -m tests.verification.penalty_sweep`."""

from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import geom2iga
import solve
from tests.cases import patch_test_case

YOUNG = 1000.0
EXPONENTS = range(1, 10)
MESHES = {"matching": ((3, 3, 1), (3, 3, 1)), "not matching": ((4, 3, 1), (2, 3, 1))}
STARTS = ("open", "closed", "partly closed")
HEIGHT = {"open": 1.01, "closed": 0.99, "partly closed": 1.0}
WAYS = {"penalty": EXPONENTS, "augmented-lagrange": EXPONENTS[::2], "lagrange": (None,)}


class Run(NamedTuple):
    """One analysis and what came of it."""

    degree: int
    mesh: str
    start: str
    enforcement: str
    exponent: int | None  # of the penalty in E/h
    status: solve.Status
    steps: int
    imbalance: float  # over the forces


def case_of(degree: int, mesh: str, start: str, enforcement: str, exponent: int | None) -> dict[str, Any]:
    """A block pushed by 0.02 onto another; it starts 0.01 above it, 0.01 inside it, or tilted across its face."""
    lower, upper = MESHES[mesh]
    case = patch_test_case(degree, lower, upper)
    block = case["geometry"]["block"][1]
    block["origin"][2] = HEIGHT[start]
    if start == "partly closed":
        block["rotate"] = {"axis": [0, 1, 0], "angle": 0.3, "about": [1.0, 1.0, 1.0]}
    penalty = "auto" if exponent is None else 10.0**exponent * YOUNG * upper[0]
    held, pushed = dict.fromkeys(("ux", "uy", "uz"), 0.0), {"ux": 0.0, "uy": 0.0, "uz": -0.02}
    case["solve"]["support"] = [{"on": "lower/bottom", **held}, {"on": "upper/top", **pushed}]
    case["solve"]["load"] = []
    case["solve"]["contact"][0] |= {"enforcement": enforcement, "penalty": penalty}
    return case


def run(*settings: Any) -> Run:
    """Analyse one case."""
    case = case_of(*settings)
    result = solve.solve(geom2iga.build(case), case)
    return Run(*settings, result.status, len(result.history), result.statistics["equilibrium_error"])


def all_settings() -> Iterator[tuple[Any, ...]]:
    """Yield degree, mesh, start, enforcement and exponent of 360 runs."""
    for degree, mesh, start in product((1, 2, 3, 4), MESHES, STARTS):
        for enforcement, exponents in WAYS.items():
            yield from ((degree, mesh, start, enforcement, exponent) for exponent in exponents)


def main() -> None:
    """Run all and print a line per degree and enforcement."""
    runs = [run(*settings) for settings in all_settings()]
    print("| degree | enforcement | runs | converged | most steps | largest imbalance |")
    print("| --- | --- | --- | --- | --- | --- |")
    for degree, way in product((1, 2, 3, 4), WAYS):
        own = [r for r in runs if (r.degree, r.enforcement) == (degree, way)]
        converged = sum(r.status is solve.Status.CONVERGED for r in own)
        steps, imbalance = max(r.steps for r in own), max(r.imbalance for r in own)
        print(f"| {degree} | {way} | {len(own)} | {converged} | {steps} | {imbalance:.0e} |")


if __name__ == "__main__":
    main()
