"""The volume of a patch, found in two ways that share nothing: inside, and over its six faces."""

from collections.abc import Callable
from dataclasses import replace
from math import ceil, prod, sqrt

import numpy as np

from geom2iga.bspline import Array
from geom2iga.patch import CHUNK, Face, Patch, chunks, surface
from geom2iga.quality import bernstein

DOUBLINGS = 3  # of the Gauss points per direction, at most

Density = Callable[[Array, Array], Array]


def volume(patch: Patch) -> float:
    """Integrate det J over a volume [length³]; negative for a left-handed one."""
    return _integral(_centred(patch), lambda x, tangents: np.linalg.det(tangents))


def enclosed_volume(patch: Patch) -> float:
    """Integrate x·n / 3 over the six faces of a volume [length³], which is the same by the divergence theorem."""
    centred = _centred(patch)
    faces = [Face(patch.name, axis, side) for axis in range(3) for side in range(2)]
    return sum(face.outward * _integral(surface(centred, face), _flux) for face in faces)


def middle(patch: Patch) -> tuple[Array, float]:
    """Centre (3,) of the box around the control points, and half its longest edge, never quite zero [length]."""
    points = patch.control_points.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, max(float((high - low).max()) / 2, np.finfo(float).tiny)


def _centred(patch: Patch) -> Patch:
    """Move a patch to the origin of space, where little cancels."""
    return replace(patch, control_points=patch.control_points - middle(patch)[0])


def _flux(x: Array, tangents: Array) -> Array:
    """One third of the flux of x through a surface, per unit of its parameters."""
    return np.einsum("...i,...i", x, np.cross(tangents[..., 0], tangents[..., 1])) / 3


def _integral(patch: Patch, density: Density) -> float:
    """Integrate a density of positions and tangents over the unit cubes of all spans.

    For equal weights the integrand is a polynomial of degrees 3 p - 1, for which ceil(3 p / 2) Gauss points are exact.
    Else Gauss rules converge geometrically, the faster the farther the zeros of w: twice the points square the error.
    So the points are doubled until two results agree to the root of what is wanted.
    """
    pieces = bernstein.bezier(patch)
    counts = [ceil(3 * degree / 2) for degree in patch.degrees]
    total, size = _gauss(pieces, density, counts)
    if np.all(patch.weights == patch.weights.flat[0]):
        return total
    for doubling in range(1, DOUBLINGS + 1):
        before = total
        total, size = _gauss(pieces, density, [count * 2**doubling for count in counts])
        if abs(total - before) <= sqrt(np.finfo(float).eps) * size:
            break
    return total


def _gauss(pieces: Patch, density: Density, counts: list[int]) -> tuple[float, float]:
    """Integrate a density, and its absolute value, with so many Gauss points per direction and span."""
    rules = [np.polynomial.legendre.leggauss(count) for count in counts]
    tables = [bernstein.values(p, (at + 1) / 2, 1) for p, (at, _) in zip(pieces.degrees, rules, strict=True)]
    shares = np.ones(())
    for _, weights in rules:
        shares = shares[..., None] * weights / 2
    total = size = 0.0
    spans = prod(len(at) - 1 for at in pieces.breaks)
    for part in chunks(spans, max(1, CHUNK // (4 * len(counts) * shares.size))):
        coefficients = bernstein.elements(pieces, part)[0]
        values = density(*_positions(coefficients, tables)) * shares
        total += float(values.sum())
        size += float(np.abs(values).sum())
    return total, size


def _positions(coefficients: Array, tables: list[Array]) -> tuple[Array, Array]:
    """Positions (e, ..., 3) and tangents (e, ..., 3, d) on a grid.

    Parameters
    ----------
    coefficients : (e, 4, p_1 + 1, ..., p_d + 1)
        Homogeneous.
    tables : (2, q, p + 1) each
        Bernstein polynomials and their derivatives at the points of each direction.
    """

    def evaluated(direction: int | None) -> Array:
        """Evaluate on the grid, differentiated along one direction: (e, ..., 4)."""
        result = coefficients
        for d, table in enumerate(tables):
            result = bernstein.along(table[int(d == direction)], result, d + 2)
        return np.moveaxis(result, 1, -1)

    total = evaluated(None)
    x = total[..., :3] / total[..., 3:]
    slopes = [evaluated(direction) for direction in range(len(tables))]
    return x, np.stack([(s[..., :3] - s[..., 3:] * x) / total[..., 3:] for s in slopes], axis=-1)
