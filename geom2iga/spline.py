"""Tensor-product splines with values of any size: what curves, faces and volumes are before they become patches.

A rational map is the spline (w x, w y, w z, w) in homogeneous coordinates; whoever multiplies it by a scalar spline
gets other coefficients of the same map.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse import csr_array

from geom2iga import bspline
from geom2iga.bspline import Array, Indices, applied
from geom2iga.errors import GeometryError
from geom2iga.patch import Patch

KNOTS_AGREE = 1e-10  # knots of [0, 1] nearer than this are one


@dataclass(frozen=True, eq=False)
class Spline:
    """A spline on [0, 1]^d.

    Parameters
    ----------
    degrees : (d,)
    knots : d arrays
        Open knot vectors from 0 to 1.
    coefficients : (n_1, ..., n_d, k)
    """

    degrees: tuple[int, ...]
    knots: tuple[Array, ...]
    coefficients: Array

    def at(self, *axes: Array) -> Array:
        """Evaluate on the grid of d arrays of parameters, (m_1, ..., m_d, k)."""
        values = self.coefficients
        for axis, (knots, degree, xi) in enumerate(zip(self.knots, self.degrees, axes, strict=True)):
            values = applied(collocation(knots, degree, np.asarray(xi, dtype=float)), values, axis)
        return values

    def end(self, axis: int, side: int) -> "Spline":
        """Restrict to the lower (side 0) or upper (side 1) end of a direction."""
        kept = [d for d in range(len(self.degrees)) if d != axis]
        return Spline(
            tuple(self.degrees[d] for d in kept),
            tuple(self.knots[d] for d in kept),
            np.take(self.coefficients, -side, axis=axis),
        )

    def backwards(self, axis: int) -> "Spline":
        """Run a direction from 1 to 0."""
        knots = tuple(1 - k[::-1] if d == axis else k for d, k in enumerate(self.knots))
        return Spline(self.degrees, knots, np.flip(self.coefficients, axis))

    def transposed(self) -> "Spline":
        """Swap the two directions of a surface."""
        return Spline(self.degrees[::-1], self.knots[::-1], np.swapaxes(self.coefficients, 0, 1))

    def oriented(self, orientation: int) -> "Spline":
        """Run through a surface in one of 8 ways, numbered as in `model.Glued`."""
        spline = self.transposed() if orientation & 1 else self
        spline = spline.backwards(0) if orientation & 2 else spline
        return spline.backwards(1) if orientation & 4 else spline

    @property
    def corners(self) -> Array:
        """Coefficients at the corners, (2, ..., 2, k)."""
        return self.coefficients[np.ix_(*[[0, -1]] * len(self.degrees))]

    def moved(self, matrix: Array) -> "Spline":
        """Apply an affine map (3, 4) to a homogeneous spline."""
        full = np.vstack([matrix, [0, 0, 0, 1]])
        return Spline(self.degrees, self.knots, self.coefficients @ full.T)

    def patch(self, name: str) -> Patch:
        """Make the patch of a homogeneous spline; raise ValueError where a weight is not positive."""
        weights = self.coefficients[..., 3]
        if not weights.min() > 0:
            raise ValueError(f'patch "{name}": weights must be positive, found {weights.min():g}')
        return Patch(name, self.degrees, self.knots, self.coefficients[..., :3] / weights[..., None], weights)


def points_of(homogeneous: Array) -> Array:
    """Positions (..., 3) of homogeneous coordinates (..., 4)."""
    return homogeneous[..., :3] / homogeneous[..., 3:]


def collocation(knots: Array, degree: int, xi: Array) -> csr_array:
    """Basis functions at points as a matrix (m, n)."""
    first, values = bspline.basis(knots, degree, xi)
    columns = first[:, None] + np.arange(degree + 1)
    starts = np.arange(len(xi) + 1) * (degree + 1)
    return csr_array((values[0].ravel(), columns.ravel(), starts), shape=(len(xi), len(knots) - degree - 1))


def united(spaces: Sequence[tuple[int, Array]]) -> tuple[int, Array]:
    """Find the smallest spline space on [0, 1] that holds several: highest degree, at every knot least smoothness.

    >>> degree, knots = united([(1, np.array([0.0, 0, 0.5, 1, 1])), (2, np.array([0.0, 0, 0, 1, 1, 1]))])
    >>> degree, knots.tolist()
    (2, [0.0, 0.0, 0.0, 0.5, 0.5, 1.0, 1.0, 1.0])
    """
    degree = max(p for p, _ in spaces)
    each = [np.unique(knots[p + 1 : -p - 1], return_counts=True) for p, knots in spaces]
    at = np.concatenate([values for values, _ in each])
    smoothness = np.concatenate([p - counts for (p, _), (_, counts) in zip(spaces, each, strict=True)])
    sequence = np.argsort(at, kind="stable")
    at, smoothness = at[sequence], smoothness[sequence]
    first = np.flatnonzero(np.diff(at, prepend=-1.0) > KNOTS_AGREE)  # of those that are one
    least = np.minimum.reduceat(smoothness, first) if len(first) else smoothness
    inner = np.repeat(at[first], degree - least)
    return degree, np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])


def adaptation(degree: int, knots: Array, wanted_degree: int, wanted_knots: Array) -> csr_array:
    """Matrix (m, n) that takes coefficients to a larger space, one that `united` found."""
    return _adaptation(degree, tuple(knots.tolist()), wanted_degree, tuple(wanted_knots.tolist()))


@lru_cache(maxsize=1024)  # a model asks for the same few over and over
def _adaptation(degree: int, given: tuple[float, ...], wanted_degree: int, wanted: tuple[float, ...]) -> csr_array:
    knots, wanted_knots = np.array(given), np.array(wanted)
    near = np.abs(knots[:, None] - wanted_knots).argmin(axis=1)
    raised, elevation = bspline.elevation(wanted_knots[near], degree, wanted_degree - degree)
    values, counts = np.unique(wanted_knots, return_counts=True)
    missing = counts - np.array([np.count_nonzero(raised == value) for value in values])
    _, insertion = bspline.insertion(raised, wanted_degree, np.repeat(values, missing))
    return insertion @ elevation


def adapted(spline: Spline, spaces: Sequence[tuple[int, Array]]) -> Spline:
    """Write a spline in a larger space, one (degree, knots) per direction."""
    coefficients = spline.coefficients
    for axis, (degree, knots) in enumerate(spaces):
        matrix = adaptation(spline.degrees[axis], spline.knots[axis], degree, knots)
        coefficients = applied(matrix, coefficients, axis)
    return Spline(tuple(p for p, _ in spaces), tuple(k for _, k in spaces), coefficients)


def interpolated(values: Array, spaces: Sequence[tuple[int, Array]]) -> Spline:
    """Find the spline with given values (n_1, ..., n_d, k) at the Greville abscissae."""
    coefficients = values
    for axis, (degree, knots) in enumerate(spaces):
        matrix = collocation(knots, degree, bspline.greville(knots, degree)).toarray()
        front = np.moveaxis(coefficients, axis, 0)
        solved = np.linalg.solve(matrix, front.reshape(len(matrix), -1)).reshape(front.shape)
        coefficients = np.moveaxis(solved, 0, axis)
    return Spline(tuple(p for p, _ in spaces), tuple(k for _, k in spaces), coefficients)


def product(spline: Spline, factor: Spline) -> Spline:
    """Multiply by a scalar spline (k = 1): the same rational map in other coefficients."""
    spaces = []
    for p, k, q, m in zip(spline.degrees, spline.knots, factor.degrees, factor.knots, strict=True):
        spaces.append(united([_raised(p, k, q), _raised(q, m, p)]))
    at = [bspline.greville(knots, degree) for degree, knots in spaces]
    return interpolated(spline.at(*at) * factor.at(*at), spaces)


def _raised(degree: int, knots: Array, times: int) -> tuple[int, Array]:
    """Make the space of products with polynomials of a degree."""
    values, counts = np.unique(knots, return_counts=True)
    return degree + times, np.repeat(values, counts + times)


def restricted(degree: int, knots: Array, coefficients: Array, low: float, high: float) -> tuple[Array, Array]:
    """Cut a piece out of a spline in one direction, whose knots need not be open.

    Returns
    -------
    knots : (m + degree + 1,)
        Open, from 0 to 1.
    coefficients : (m, k)
        Blossoms at the new knots (Ramshaw 1989).

    Raises
    ------
    GeometryError
        Nothing lies between the ends.
    """
    reach = KNOTS_AGREE * (high - low)
    low, high = (
        float(knots[np.abs(knots - end).argmin()]) if np.abs(knots - end).min() < reach else end for end in (low, high)
    )
    if not low < high:
        raise GeometryError(f"a B-spline is used from parameter {low:g} to {high:g}, where nothing lies: draw it anew")
    inner = knots[(knots > low) & (knots < high)]
    wanted = np.concatenate([np.repeat(low, degree + 1), inner, np.repeat(high, degree + 1)])
    windows = np.lib.stride_tricks.sliding_window_view(wanted, degree + 1)[: len(wanted) - degree - 1]
    spans = bspline.find_spans(knots, degree, windows[:, 0])
    values = bspline.blossom(knots, degree, spans, windows[:, 1:])
    local: Indices = spans[:, None] + np.arange(-degree, 1)
    return (wanted - low) / (high - low), np.einsum("ia,iak->ik", values, coefficients[local])
