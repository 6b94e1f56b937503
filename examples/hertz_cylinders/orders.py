"""Observed orders of convergence with a free edge of contact, degrees 1 to 3, for a table of Markdown.

python examples/hertz_cylinders/orders.py

Blocks of one by one with the round bottoms of the case, pushed together by a distance, so that 0.41 of the width is in
contact. The spans are equal and do not match. The exact solution is replaced by a mesh that is graded to the edge of
contact, where its spans are a twentieth of those of the finest mesh that is compared with it.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

import geom2iga
import solve
from geom2iga.bspline import Array
from geom2iga.patch import evaluate
from solve.material import VOIGT
from solve.space import gauss_points

CASE = geom2iga.read_case(Path(__file__).with_name("case.toml"))
APPROACH = 0.04  # of the two ends [length]
EDGE = 0.409  # where contact ends, roughly [length]
FINER, GROWTH, LARGEST = 20, 1.3, 1 / 32  # spans of the reference: they grow away from the edge of contact
MIDDLE = np.array([[0.0, 0.5]])  # parametric point of the bottom


class Errors(NamedTuple):
    """Relative errors in the energy norm, and of the pressure in the middle."""

    energy: float
    pressure: float


def meshed(degree: int, *meshes: dict[str, list]) -> solve.Result:
    """Solve with the given spans or breaks of the two bodies."""
    turned = {"origin": [0.0, 0.1, 0.0], "rotate": {"axis": [1, 0, 0], "angle": 180}}
    shape = {"size": [1.0, 0.1, 1.0], "radius": 8.0, "bottom": "cylinder", "quarter": True}
    bodies = [{"name": "upper", **shape, **meshes[0]}, {"name": "lower", **shape, **turned, **meshes[-1]}]
    case = CASE.changed(
        {
            "geometry": {"degree": [max(degree, 2), 1, max(degree, 2)], "domed_block": bodies},
            "solve.load": [{"on": "upper/top", "pressure": 0.0}],
            f"solve.support.{len(CASE.tables['solve']['support'])}": {"on": "upper/top", "uz": -APPROACH},
            "solve.contact.0.enforcement": "lagrange",
        }
    )
    model = geom2iga.build(case)
    return solve.solve(geom2iga.faceted(model) if degree == 1 else model, case)


def graded(edge: float, smallest: float) -> list[float]:
    """Break points of [0, 1] that are dense at one point."""
    away = np.cumsum(np.minimum(smallest * GROWTH ** np.arange(100), LARGEST))
    inner = np.concatenate([edge - away, [edge], edge + away])
    within = (inner > smallest / 2) & (inner < 1 - smallest / 2)
    return [0.0, *np.sort(inner[within]).tolist(), 1.0]


def reference(smallest: float) -> solve.Result:
    """Solve on a mesh that is graded to the edge of contact, with a smallest span there [length]."""
    return meshed(2, {"breaks": [graded(EDGE, smallest), [0.0, 1.0], graded(0.0, smallest)]})


def errors(found: solve.Result, exact: solve.Result) -> Errors:
    """Compare two results, with the quadrature of the second."""
    error, size = np.sum([_squares(found, exact, name) for name in exact.model.patches], axis=0)
    return Errors(float(np.sqrt(error / size)), abs(_pressure(found) / _pressure(exact) - 1))


def _squares(found: solve.Result, exact: solve.Result, name: str) -> tuple[float, float]:
    """Twice the strain energy in one body of the difference, and of the exact solution."""
    gauss = gauss_points(exact.model.patches[name])
    slope = _gradient(exact, name, gauss.xi)
    volume = gauss.weights * np.linalg.det(evaluate(exact.model.patches[name], gauss.xi, 1)[1])
    return tuple(
        float(volume @ _density(exact, name, each)) for each in (_gradient(found, name, gauss.xi) - slope, slope)
    )


def _gradient(result: solve.Result, name: str, xi: Array) -> Array:
    """Displacement gradients (q, 3, 3)."""
    patch = result.model.patches[name]
    slope = evaluate(patch, xi, 1, result.displacement_of(name))[1]
    return slope @ np.linalg.inv(evaluate(patch, xi, 1)[1])


def _density(result: solve.Result, name: str, gradient: Array) -> Array:
    """Stress times strain (q,)."""
    stress = result.materials[name].stress(gradient)
    strain = np.stack([gradient[:, i, j] + gradient[:, j, i] * (i != j) for i, j in VOIGT], axis=1)
    return np.sum(stress * strain, axis=1)


def _pressure(result: solve.Result) -> float:
    (face,) = result.model.faces("upper/bottom")
    return float(result.pressure_at(result.pairs[0], face, MIDDLE)[0])


def main(degrees: tuple[int, ...] = (1, 2, 3), spans: tuple[int, ...] = (8, 16, 32, 64)) -> dict[int, Errors]:
    """Print the table and return the orders, slopes of straight lines through all meshes."""
    exact = reference(1 / (FINER * max(spans)))
    print("| degree | spans | energy norm | order | pressure in the middle | order |")
    print("| --- | --- | --- | --- | --- | --- |")
    orders = {}
    for degree in degrees:
        found = [
            errors(meshed(degree, *({"spans": [n, 1, n]} for n in (count, 3 * count // 4))), exact) for count in spans
        ]
        rates = np.diff(np.log(found), axis=0) / -np.diff(np.log(spans))[:, None]
        for count, each, rate in zip(spans, found, [None, *rates], strict=True):
            before = ["", ""] if rate is None else [f"{r:.1f}" for r in rate]
            print(f"| {degree} | {count} | {each.energy:.1e} | {before[0]} | {each.pressure:.1e} | {before[1]} |")
        orders[degree] = Errors(*-np.polyfit(np.log(spans), np.log(found), 1)[0])
        print(f"| {degree} | all | | {orders[degree].energy:.2f} | | {orders[degree].pressure:.2f} |", flush=True)
    return orders


if __name__ == "__main__":
    main()
