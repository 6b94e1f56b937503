"""Surfaces and volumes by moving: ruled, extruded, revolved; all in homogeneous coordinates."""

from math import ceil, radians

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from geom2iga.bspline import Array
from geom2iga.cad.exact import conic
from geom2iga.spline import Spline, adapted, united

LINEAR = 1, np.array([0.0, 0, 1, 1])  # degree and knots of what is linear
LARGEST_ARC = 90.0  # of a patch [degrees]
ROUNDING = 1e-12  # of an angle, in arcs


def arc(centre: ArrayLike, radius: float, low: float, high: float) -> Spline:
    """Make an arc of a circle in a plane z = constant, between two angles from the x axis [degrees]."""
    x, y = radius * np.eye(3)[:2]
    return conic(np.asarray(centre, dtype=float), x, y, radians(low), radians(high))


def equal_angles(angle: float, largest: float = LARGEST_ARC) -> Array:
    """Cut an angle into equal parts that are not larger than a given one: their ends (n + 1,) [degrees]."""
    return np.linspace(0, angle, max(1, ceil(angle / largest - ROUNDING)) + 1)


def quadrilateral(corners: ArrayLike) -> Spline:
    """Make the bilinear surface with corners (2, 2, 3)."""
    points = np.asarray(corners, dtype=float)
    return Spline((1, 1), (LINEAR[1],) * 2, np.concatenate([points, np.ones((2, 2, 1))], axis=-1))


def ruled(first: Spline, second: Spline, axis: int = -1) -> Spline:
    """Blend linearly between two splines along a new direction, the last one or `axis`."""
    spaces = [
        united([(first.degrees[d], first.knots[d]), (second.degrees[d], second.knots[d])])
        for d in range(len(first.degrees))
    ]
    axis = axis % (len(spaces) + 1)
    ends = [adapted(each, spaces).coefficients for each in (first, second)]
    spaces.insert(axis, LINEAR)
    return Spline(tuple(p for p, _ in spaces), tuple(k for _, k in spaces), np.stack(ends, axis=axis))


def shifted(spline: Spline, vector: ArrayLike) -> Spline:
    """Move a homogeneous spline."""
    return spline.moved(np.column_stack([np.eye(3), np.asarray(vector, dtype=float)]))


def turned(spline: Spline, turn: Rotation) -> Spline:
    """Turn a homogeneous spline about the origin of space."""
    return spline.moved(np.column_stack([turn.as_matrix(), np.zeros(3)]))


def extruded(surface: Spline, vector: ArrayLike) -> Spline:
    """Move a surface along a vector: a volume, the new direction the last."""
    return ruled(surface, shifted(surface, vector))


def revolved(surface: Spline, low: float, high: float) -> Spline:
    """Turn a surface in the plane of x and z about the z axis, between two angles [degrees]: the new one is the second.

    Weights are products of those of the surface and of the circle (Piegl & Tiller 1997, section 8.5).
    """
    circle = arc(np.zeros(3), 1.0, low, high)
    held, around = surface.coefficients[:, None], circle.coefficients[:, None]
    coefficients = held[..., [0, 0, 2, 3]] * around[..., [0, 1, 3, 3]]
    degrees = surface.degrees[0], circle.degrees[0], surface.degrees[1]
    return Spline(degrees, (surface.knots[0], circle.knots[0], surface.knots[1]), coefficients)
