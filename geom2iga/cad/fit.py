"""Surfaces that no exact way reaches: least squares over given edges."""

from collections.abc import Callable

import numpy as np

from geom2iga.bspline import Array, applied, breaks, open_knots
from geom2iga.spline import Spline, adapted, collocation, points_of, united

DEGREE = 3
PULLS = 2  # the closest points move along the surface as it does
SPANS = (4, 8, 16)
SAMPLES = np.array([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])


def within(knots: Array) -> Array:
    """Place sample points in all spans, ends included."""
    at = breaks(knots)
    return np.unique(at[:-1, None] + np.diff(at)[:, None] * SAMPLES)


def fit(start: Spline, nearest: Callable[[Array], Array], accuracy: float) -> Spline:
    """Move the inner control points of a surface until it lies on another; its edges and weights stay.

    Parameters
    ----------
    start : Spline
        Homogeneous, of two directions.
    nearest : function
        Closest points (q, 3) of the other surface to points (q, 3).
    accuracy : float
        With more and more spans until the distance [length] falls below this, or no longer falls.

    Returns
    -------
    Spline
        At least cubic.
    """
    best, least = start, np.inf
    for spans in SPANS:
        uniform = open_knots(np.linspace(0, 1, spans + 1), DEGREE)
        spaces = [united([(p, k), (DEGREE, uniform)]) for p, k in zip(start.degrees, start.knots, strict=True)]
        fitted = adapted(start, spaces)
        for _ in range(PULLS):
            fitted = _pulled(fitted, nearest)
        points = points_of(fitted.at(*[within(knots) for knots in fitted.knots])).reshape(-1, 3)
        distance = float(np.linalg.norm(nearest(points) - points, axis=1).max())
        if distance > least / 2:  # it is the edges that lie off, or the surface has a kink
            break
        best, least = fitted, distance
        if distance <= accuracy:
            break
    return best


def _pulled(spline: Spline, nearest: Callable[[Array], Array]) -> Spline:
    """Fit the inner control points to the closest points of samples, direction by direction."""
    at = [within(knots) for knots in spline.knots]
    homogeneous = spline.at(*at)
    points = points_of(homogeneous)
    missing = (nearest(points.reshape(-1, 3)).reshape(points.shape) - points) * homogeneous[..., 3:]
    for axis, (degree, knots, places) in enumerate(zip(spline.degrees, spline.knots, at, strict=True)):
        inner = collocation(knots, degree, places).toarray()[:, 1:-1]
        missing = applied(np.linalg.pinv(inner), missing, axis)
    coefficients = spline.coefficients.copy()
    coefficients[1:-1, 1:-1, :3] += missing
    return Spline(spline.degrees, spline.knots, coefficients)
