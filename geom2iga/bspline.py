"""Univariate B-splines: basis functions, knot insertion, degree elevation.

Everything here is one recursion. The blossom of a spline's polynomial piece is the symmetric multi-affine function
that equals the spline where all arguments agree; a repeated argument gives Cox-de Boor's basis functions, new knots as
arguments give the coefficients after knot insertion, means of blossoms those after degree elevation (Ramshaw 1989).
"""

from math import factorial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array, eye_array

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]


def blossom(knots: Array, degree: int, spans: Indices, arguments: Array, derivatives: int = 0) -> Array:
    """Evaluate the blossoms of the basis functions that are nonzero on given spans.

    Cox-de Boor's recursion with an argument of its own at every level; the last `derivatives` levels
    differentiate instead.                                                          paper, eqs. (2), (3)

    Parameters
    ----------
    knots : (n + degree + 1,)
        Open knot vector.
    spans : (q,)
        Index s of the nonempty interval [knots[s], knots[s + 1]) whose polynomial piece is meant.
    arguments : (q, degree - derivatives)
        Arguments of the blossom; its value does not depend on their sequence.

    Returns
    -------
    (q, degree + 1)
        Blossoms of the functions s - degree ... s.
    """
    values = np.ones((len(spans), 1))
    for level in range(1, degree + 1):
        first = spans[:, None] + np.arange(1 - level, 1)
        left, right = knots[first], knots[first + level]
        if level > degree - derivatives:
            rising = 1.0 / (right - left)
            falling = -rising
        else:
            argument = arguments[:, level - 1, None]
            rising = (argument - left) / (right - left)
            falling = (right - argument) / (right - left)
        raised = np.zeros((len(spans), level + 1))
        raised[:, 1:] = rising * values
        raised[:, :-1] += falling * values
        values = raised
    return values * (factorial(degree) / factorial(degree - derivatives))


def basis(
    knots: Array, degree: int, xi: ArrayLike, order: int = 0, spans: Indices | None = None
) -> tuple[Indices, Array]:
    """Evaluate the nonzero basis functions and their derivatives at points.    paper, eqs. (1)-(3)

    Parameters
    ----------
    xi : (q,)
        Points; beyond the ends of the knot vector the first or last polynomial continues.
    order : int
        Highest derivative.
    spans : (q,)
        Whose polynomial to evaluate; left out, the span that holds the point, the one to its right at a knot.

    Returns
    -------
    first : (q,)
        Index of the first nonzero function.
    values : (order + 1, q, degree + 1)
        Derivatives 0 ... order of the functions first ... first + degree.

    Examples
    --------
    >>> first, values = basis(np.array([0.0, 0, 0, 1, 2, 2, 2]), 2, [0.5, 2.0])
    >>> first.tolist(), values[0].tolist()
    ([0, 1], [[0.25, 0.625, 0.125], [0.0, 0.0, 1.0]])
    """
    points = np.asarray(xi, dtype=float)
    spans = find_spans(knots, degree, points) if spans is None else spans
    values = np.zeros((order + 1, len(points), degree + 1))
    for derivative in range(min(order, degree) + 1):
        arguments = np.broadcast_to(points[:, None], (len(points), degree - derivative))
        values[derivative] = blossom(knots, degree, spans, arguments, derivative)
    return spans - degree, values


def find_spans(knots: Array, degree: int, xi: ArrayLike) -> Indices:
    """Find the index s with knots[s] <= xi < knots[s + 1], the last nonempty one at the right end."""
    spans = np.searchsorted(knots, xi, side="right") - 1
    return np.clip(spans, degree, len(knots) - degree - 2)


def insertion(knots: Array, degree: int, inserted: ArrayLike) -> tuple[Array, csr_array]:
    """Insert knots.

    New coefficient i is the blossom at the new knots i+1 ... i+degree (Oslo algorithm, Cohen, Lyche & Riesenfeld 1980).

    Parameters
    ----------
    inserted : (k,)
        Knots to add, repeated as often as they are to be added.

    Returns
    -------
    refined : (n + k + degree + 1,)
        The knot vector with the new knots in it.
    matrix : (n + k, n)
        New coefficients from old ones.
    """
    refined = np.sort(np.concatenate([knots, np.asarray(inserted, dtype=float)]))
    count = len(refined) - degree - 1
    windows = np.lib.stride_tricks.sliding_window_view(refined, degree + 1)[:count]
    spans = find_spans(knots, degree, windows[:, 0])
    values = blossom(knots, degree, spans, windows[:, 1:])
    return refined, _banded(spans - degree, values, len(knots) - degree - 1)


def extraction(knots: Array, degree: int) -> csr_array:
    """Take the coefficients of a spline to Bernstein's of all spans (Borden, Scott, Evans & Hughes 2011).

    Returns
    -------
    (degree s + 1, n)
        For s spans; the last coefficient of one is the first of the next.
    """
    inner, counts = np.unique(knots[degree + 1 : -degree - 1], return_counts=True)
    return insertion(knots, degree, np.repeat(inner, np.maximum(degree - counts, 0)))[1]


def elevation(knots: Array, degree: int, times: int = 1) -> tuple[Array, csr_array]:
    """Raise the degree, keeping the function and its smoothness.

    The blossom of the raised spline is the mean of the old blossoms with one argument left out in turn.

    Parameters
    ----------
    times : int
        By how many degrees.

    Returns
    -------
    elevated : (n + multiplicities,)
        The knot vector, every distinct knot repeated `times` more.
    matrix : (m, n)
        New coefficients from old ones.
    """
    count = len(knots) - degree - 1
    matrix = csr_array(eye_array(count))
    for _ in range(times):
        elevated = np.sort(np.concatenate([knots, np.unique(knots)]))
        windows = np.lib.stride_tricks.sliding_window_view(elevated, degree + 2)[: len(elevated) - degree - 2]
        spans = find_spans(knots, degree, windows[:, 0])
        values = np.mean(
            [blossom(knots, degree, spans, np.delete(windows[:, 1:], k, axis=1)) for k in range(degree + 1)],
            axis=0,
        )
        matrix = _banded(spans - degree, values, len(knots) - degree - 1) @ matrix
        knots, degree = elevated, degree + 1
    return knots, matrix


def applied(matrix: csr_array | Array, values: Array, axis: int) -> Array:
    """Multiply a matrix (m, n) into one axis of an array."""
    front = np.moveaxis(values, axis, 0)
    product = (matrix @ front.reshape(front.shape[0], -1)).reshape(-1, *front.shape[1:])
    return np.moveaxis(product, 0, axis)


def greville(knots: Array, degree: int) -> Array:
    """Average `degree` consecutive knots: the coefficients (n,) of the identity map."""
    return np.lib.stride_tricks.sliding_window_view(knots[1:-1], degree).mean(axis=1)


def breaks(knots: Array) -> Array:
    """Return the distinct knots (s + 1,)."""
    return np.unique(knots)


def open_knots(at: ArrayLike, degree: int) -> Array:
    """Make the open knot vector of highest smoothness over increasing breaks.

    >>> open_knots([0, 0.5, 1], 2).tolist()
    [0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0]
    """
    at = np.asarray(at, dtype=float)
    return np.concatenate([np.repeat(at[0], degree), at, np.repeat(at[-1], degree)])


def sharp_breaks(knots: Array, degree: int) -> Array:
    """Distinct knots where splines need not be smooth, both ends among them.

    >>> sharp_breaks(np.array([0.0, 0, 0, 1, 2, 2, 3, 3, 3]), 2).tolist()
    [0.0, 2.0, 3.0]
    """
    at, counts = np.unique(knots, return_counts=True)
    return at[counts >= degree]


def check_knots(knots: Array, degree: int) -> None:
    """Raise ValueError unless the knot vector is open, non-decreasing, finite and at least continuous inside."""
    if knots.ndim != 1 or len(knots) < 2 * degree + 2:
        raise ValueError(f"a knot vector of degree {degree} needs at least {2 * degree + 2} knots, found {knots.size}")
    if not np.all(np.isfinite(knots)):
        raise ValueError("knots must be finite numbers")
    falls = np.flatnonzero(np.diff(knots) < 0)
    if falls.size:
        raise ValueError(f"knots must not decrease, found {knots[falls[0]]:g} before {knots[falls[0] + 1]:g}")
    values, counts = np.unique(knots, return_counts=True)
    if len(values) < 2:
        raise ValueError(f"all knots equal {values[0]:g}: there is no span")
    if counts[0] != degree + 1 or counts[-1] != degree + 1:
        raise ValueError(
            f"the knot vector is not open: of degree {degree}, its first and last knots must stand "
            f"{degree + 1} times, found {counts[0]} and {counts[-1]}"
        )
    if counts[1:-1].max(initial=0) > degree:
        worst = values[1:-1][np.argmax(counts[1:-1])]
        raise ValueError(f"knot {worst:g} stands more than {degree} times: the spline would be torn there")


def _banded(first: Indices, values: Array, columns: int) -> csr_array:
    """Sparse matrix whose row i holds values[i] from column first[i] on."""
    rows, width = values.shape
    indices = first[:, None] + np.arange(width)
    matrix = csr_array((values.ravel(), indices.ravel(), np.arange(rows + 1) * width), shape=(rows, columns))
    matrix.eliminate_zeros()
    return matrix
