"""Observed orders of convergence on two rings in contact, degrees 1 to 4, for a table of Markdown.

python examples/lame_rings/orders.py
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

import geom2iga
import solve
from geom2iga.patch import evaluate
from post.exact import NestedShells, Shell
from solve.space import gauss_points

CASE = geom2iga.read_case(Path(__file__).with_name("case.toml"))
EXACT = NestedShells(
    Shell(20, 30, 2000, 0.3, inside=25, dimension=2), Shell(30, 40, 1000, 0.2, dimension=2)
)  # no penalty: the overlap is none
SPANS = (4, 8, 16)


class Errors(NamedTuple):
    """Relative errors in L² of displacement, stress and contact pressure."""

    displacement: float
    stress: float
    pressure: float


def errors(degree: int, spans: int) -> Errors:
    """Solve with a mesh of spans x spans in one ring and 3/4 of that around in the other."""
    varied = CASE.changed(
        {
            "geometry.degree": [max(degree, 2), max(degree, 2), 1],
            "geometry.pipe.0.spans": [spans // 2, spans, 1],
            "geometry.pipe.1.spans": [spans // 2, 3 * spans // 4, 1],
            "solve.contact.0": {"secondary": "inner/outer", "primary": "outer/inner", "enforcement": "lagrange"},
        }
    )
    model = geom2iga.build(varied)
    result = solve.solve(geom2iga.faceted(model) if degree == 1 else model, varied)
    parts = [_squares(result, name, shell) for name, shell in zip(("inner", "outer"), EXACT.loaded, strict=True)]
    totals = np.sum(parts, axis=0)
    return Errors(*np.sqrt(totals[::2] / totals[1::2]), _pressure_error(result))


def _squares(result: solve.Result, name: str, shell: Shell) -> list[float]:
    """Integrals of squares over one ring: error and size of the displacement, error and size of the stress."""
    patch = result.model.patches[name]
    gauss = gauss_points(patch, [p + 3 for p in patch.degrees])
    at, jacobian = evaluate(patch, gauss.xi, 1)
    found, slope = evaluate(patch, gauss.xi, 1, result.displacement_of(name))
    volume = gauss.weights * np.linalg.det(jacobian)
    radius = np.linalg.norm(at[:, :2], axis=1)
    outward = at[:, :2] / radius[:, None]
    stress = result.materials[name].stress(slope @ np.linalg.inv(jacobian))
    in_plane = stress[:, [0, 3, 3, 1]].reshape(-1, 2, 2)
    radial = outward[:, :, None] * outward[:, None, :]
    hoop = np.eye(2) - radial
    exact_stress = shell.radial_stress(radius)[:, None, None] * radial + shell.hoop_stress(radius)[:, None, None] * hoop
    exact = shell.displacement(radius)[:, None] * outward
    squares = ((found[:, :2] - exact) ** 2, exact**2, (in_plane - exact_stress) ** 2, exact_stress**2)
    return [float(volume @ square.reshape(len(volume), -1).sum(axis=1)) for square in squares]


def _pressure_error(result: solve.Result) -> float:
    (contact,) = result.contacts
    (face,) = result.model.faces("inner/outer")
    gauss = gauss_points(result.model.surface(face))
    pressure = result.pressure_at(contact, face, gauss.xi)
    return float(np.sqrt(np.average((pressure / EXACT.pressure - 1) ** 2, weights=gauss.weights)))


def main(degrees: tuple[int, ...] = (1, 2, 3, 4), spans: tuple[int, ...] = SPANS) -> dict[int, Errors]:
    """Print the table and return the orders observed between the two finest meshes."""
    print("| degree | spans around | displacement | order | stress | order | contact pressure | order |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    orders = {}
    for degree in degrees:
        before = None
        for count in spans:
            found = errors(degree, count)
            rates = Errors(*np.log2(np.array(before) / found)) if before else None
            cells = [f"{e:.1e} | {f'{r:.1f}' if rates else ''}" for e, r in zip(found, rates or found, strict=True)]
            print(f"| {degree} | {count} | {' | '.join(cells)} |")
            before, orders[degree] = found, rates
    return orders


if __name__ == "__main__":
    main()
