"""Polynomials in Bernstein form: those of the Bézier elements of a patch, multiplied, halved, evaluated.

The Bernstein coefficients of a polynomial on a box bound it from both sides, those at the corners are its values there.
Products and halves are convex combinations of what they are made of, so that rounding stays as small as it began.
"""

from collections.abc import Sequence
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from geom2iga import bspline
from geom2iga.bspline import Array
from geom2iga.patch import Patch, refined


def bezier(patch: Patch) -> Patch:
    """Repeat every inner knot until its multiplicity is the degree: each span has control points of its own."""
    inserted = []
    for knots, degree in zip(patch.knots, patch.degrees, strict=True):
        inner, counts = np.unique(knots[degree + 1 : -degree - 1], return_counts=True)
        inserted.append(np.repeat(inner, degree - counts))
    return refined(patch, knots=inserted) if any(map(len, inserted)) else patch


def elements(patch: Patch, part: slice) -> tuple[Array, Array, Array]:
    """Cut elements out of a patch that is `bezier`.

    Parameters
    ----------
    part : slice
        Of the spans in flat numbering, the last direction fastest.

    Returns
    -------
    coefficients : (e, 4, p_1 + 1, ..., p_d + 1)
        Homogeneous Bernstein coefficients (w x, w y, w z, w).
    start, size : (e, d)
        Lower corner and edges of the span in xi.
    """
    spans = tuple(len(at) - 1 for at in patch.breaks)
    numbers = np.unravel_index(np.arange(np.prod(spans))[part], spans)
    index = []
    for d, (number, degree) in enumerate(zip(numbers, patch.degrees, strict=True)):
        local = number[:, None] * degree + np.arange(degree + 1)
        index.append(local.reshape(len(number), *(degree + 1 if k == d else 1 for k in range(patch.directions))))
    each = list(zip(patch.breaks, numbers, strict=True))
    start = np.stack([at[number] for at, number in each], axis=1)
    end = np.stack([at[number + 1] for at, number in each], axis=1)
    return np.moveaxis(patch.homogeneous[tuple(index)], -1, 1), start, end - start


def scaled(coefficients: Array, directions: int) -> Array:
    """Multiply coefficient i of degree n by n over i, in the last directions: products become convolutions."""
    return coefficients * _binomials(coefficients.shape[-directions:])


def unscaled(coefficients: Array, directions: int) -> Array:
    """Undo `scaled`."""
    return coefficients / _binomials(coefficients.shape[-directions:])


def product(first: Array, second: Array) -> Array:
    """Multiply scaled polynomials of three directions and add up the products.        Farouki & Rajan 1988

    Parameters
    ----------
    first, second : (..., c, m_1, m_2, m_3), (..., c, n_1, n_2, n_3)

    Returns
    -------
    (..., m_1 + n_1 - 1, m_2 + n_2 - 1, m_3 + n_3 - 1)
    """
    if first.size < second.size:  # fewer shifts
        first, second = second, first
    held, shifts = first.shape[-3:], second.shape[-3:]
    flat = first.reshape(*first.shape[:-3], -1)
    total = np.zeros((*first.shape[:-4], *(m + n - 1 for m, n in zip(held, shifts, strict=True))))
    for i, j, k in np.ndindex(shifts):
        part = (second[..., None, :, i, j, k] @ flat).reshape(*first.shape[:-4], *held)
        total[..., i : i + held[0], j : j + held[1], k : k + held[2]] += part
    return total


def along(matrix: Array, array: Array, axis: int) -> Array:
    """Apply a matrix (m, n) along one axis of an array, whose length there goes from n to m."""
    return np.moveaxis(np.moveaxis(array, axis, -1) @ matrix.T, -1, axis)


def slope(coefficients: Array, axis: int) -> Array:
    """Differentiate along one axis over the unit interval; the degree falls by one."""
    return (coefficients.shape[axis] - 1) * np.diff(coefficients, axis=axis)


def halves(degree: int) -> Array:
    """Coefficients on the lower and on the upper half, (2, n + 1, n + 1), from those on the whole (de Casteljau)."""
    lower = np.array([[comb(k, i) / 2**k for i in range(degree + 1)] for k in range(degree + 1)])
    return np.stack([lower, lower[::-1, ::-1]])


def values(degree: int, at: ArrayLike, order: int = 0) -> Array:
    """Evaluate the Bernstein polynomials of the unit interval: derivatives 0 ... order, (order + 1, q, n + 1)."""
    return bspline.basis(bspline.open_knots([0, 1], degree), degree, at, order)[1]


def _binomials(shape: Sequence[int]) -> Array:
    """Product over the directions of n over i."""
    total = np.ones(())
    for count in shape:
        total = total[..., None] * np.array([comb(count - 1, i) for i in range(count)], dtype=float)
    return total
