"""Curves and surfaces of a boundary representation as exact splines, and distances from them."""

from collections.abc import Callable
from math import ceil, pi

import numpy as np

from geom2iga.bspline import Array
from geom2iga.cad.brep import Elementary, Free
from geom2iga.errors import GeometryError
from geom2iga.projection import closest_points
from geom2iga.spline import Spline, interpolated, restricted

SINGLE_ARC = 2 * pi / 3 + 1e-9  # longer arcs are split into quarters or less: weights of one piece come down to 1/2
Record = Elementary | Free


def curve_spline(curve: Record, low: float, high: float) -> Spline:
    """Turn a curve between two parameters into a homogeneous spline that runs from the one to the other.

    Raises
    ------
    GeometryError
        An offset curve, which no NURBS can represent.
    """
    if isinstance(curve, Free):
        degree, knots = curve.degrees[0], curve.knots[0]
        coefficients = curve.coefficients
        if curve.periodic[0]:
            knots, coefficients = _unrolled(degree, knots, coefficients, low, high)
        knots, coefficients = restricted(degree, knots, coefficients, low, high)
        return Spline((degree,), (knots,), coefficients)
    match curve.kind:
        case "line":
            origin, direction = curve.vectors
            return straight(origin + low * direction, origin + high * direction)
        case "circle" | "ellipse":
            origin, _, x, y = curve.vectors
            return conic(origin, curve.numbers[0] * x, curve.numbers[-1] * y, low, high)
        case "hyperbola":
            origin, _, x, y = curve.vectors
            return conic(origin, curve.numbers[0] * x, curve.numbers[1] * y, low, high, np.cosh, np.sinh)
        case "parabola":
            origin, _, x, y = curve.vectors
            at = np.array([low, (low + high) / 2, high])[:, None]
            return _parabola(origin + at**2 / (4 * curve.numbers[0]) * x + at * y)
        case "trimmed":
            return curve_spline(curve.basis, low, high)
    raise GeometryError(f"an {curve.kind} curve is no NURBS: replace it by a B-spline in the CAD program")


def plane_curve(curve: Record, low: float, high: float) -> Spline:
    """Turn a curve in a parameter plane between two parameters into a homogeneous spline, (n, 3)."""
    if isinstance(curve, Elementary) and len(curve.vectors):
        flat = np.insert(curve.vectors, len(curve.vectors[0]), 0.0, axis=1)
        if curve.kind != "line":
            flat = np.insert(flat, 1, [0.0, 0, 1], axis=0)
        curve = Elementary(curve.kind, flat, curve.numbers)
    elif isinstance(curve, Elementary):
        return plane_curve(curve.basis, low, high)
    else:
        curve = Free(
            curve.kind, curve.degrees, curve.knots, np.insert(curve.coefficients, 2, 0.0, axis=1), curve.periodic
        )
    spline = curve_spline(curve, low, high)
    return Spline(spline.degrees, spline.knots, np.delete(spline.coefficients, 2, axis=1))


def straight(start: Array, end: Array) -> Spline:
    """Make a straight line."""
    return Spline((1,), (np.array([0.0, 0, 1, 1]),), np.column_stack([[start, end], [1, 1]]))


def _parabola(points: Array) -> Spline:
    """Make the parabola through three points, the second one half way in the parameter."""
    values = np.column_stack([points, np.ones(3)])
    return interpolated(values, [(2, np.array([0.0, 0, 0, 1, 1, 1]))])


def conic(
    origin: Array,
    x: Array,
    y: Array,
    low: float,
    high: float,
    even: Callable[[Array], Array] = np.cos,
    odd: Callable[[Array], Array] = np.sin,
) -> Spline:
    """Make the curve origin + even(t) x + odd(t) y, an arc of an ellipse or a hyperbola, as a rational quadratic.

    A piece of half width h has the weights 1, even(h), 1 (Piegl & Tiller 1997, section 7.3); its middle control point
    lies where the tangents of its ends meet, at the curve's formula for t in the middle, divided by even(h).
    """
    sweep = abs(high - low)
    pieces = 1 if sweep <= SINGLE_ARC else ceil(sweep / (pi / 2) - 1e-9)
    ends = np.linspace(low, high, pieces + 1)
    at = np.linspace(low, high, 2 * pieces + 1)
    weights = np.ones(len(at))
    weights[1::2] = even(np.diff(ends) / 2)
    points = weights[:, None] * origin + np.outer(even(at), x) + np.outer(odd(at), y)
    knots = np.concatenate([[0.0], np.repeat(np.linspace(0, 1, pieces + 1), 2), [1.0]])
    return Spline((2,), (knots,), np.column_stack([points, weights]))


def _unrolled(degree: int, knots: Array, coefficients: Array, low: float, high: float) -> tuple[Array, Array]:
    """Write a periodic spline over all periods that a range touches; its knots are no longer open.

    Knots and coefficients repeat with the period; the first coefficient belongs to the function whose knots begin
    degree + 1 - m knots before the start of the period, m the multiplicity there (OpenCASCADE, BSplCLib).
    """
    period = knots[-1] - knots[0]
    multiplicity = int(np.count_nonzero(knots == knots[0]))
    once = knots[: len(knots) - multiplicity]
    more = -(-(degree + 1) // len(once))  # periods that hold the knots beyond the ends
    turns = np.arange(np.floor((low - knots[0]) / period) - more, np.ceil((high - knots[0]) / period) + more)
    every = (once + period * turns[:, None]).ravel()
    functions = np.arange(len(every) - degree - 1) + degree + 1 - multiplicity
    return every, coefficients[functions % len(once)]


def surface_spline(surface: Record, ranges: Array) -> Spline:
    """Turn the rectangle of a surface between parameters into a homogeneous spline of two directions.

    Parameters
    ----------
    ranges : (2, 2)
        Lower and upper parameter of either direction.

    Raises
    ------
    GeometryError
        An offset surface, which no NURBS can represent.
    """
    (u0, u1), (v0, v1) = ranges
    if isinstance(surface, Free):
        return _free_surface(surface, ranges)
    match surface.kind:
        case "plane":
            origin, _, x, y = surface.vectors
            return _swept(straight(origin + u0 * x, origin + u1 * x), v0 * y, v1 * y)
        case "cylinder" | "cone" | "sphere" | "torus":
            origin, axis, x, y = surface.vectors
            return _revolved(_meridian(surface, v0, v1), origin, axis, x, y, u0, u1)
        case "revolution":
            origin, axis = surface.vectors
            x = np.linalg.svd(axis[None])[2][1]
            return _revolved(curve_spline(surface.basis, v0, v1), origin, axis, x, np.cross(axis, x), u0, u1)
        case "extrusion":
            return _swept(curve_spline(surface.basis, u0, u1), v0 * surface.vectors[0], v1 * surface.vectors[0])
        case "trimmed":
            return surface_spline(surface.basis, ranges)
    raise GeometryError(f"an {surface.kind} surface is no NURBS: replace it by a B-spline in the CAD program")


def _free_surface(surface: Free, ranges: Array) -> Spline:
    knots, coefficients = list(surface.knots), surface.coefficients
    for axis, (low, high) in enumerate(ranges):
        rows = np.moveaxis(coefficients, axis, 0)
        flat = rows.reshape(len(rows), -1)
        if surface.periodic[axis]:
            knots[axis], flat = _unrolled(surface.degrees[axis], knots[axis], flat, low, high)
        knots[axis], flat = restricted(surface.degrees[axis], knots[axis], flat, low, high)
        coefficients = np.moveaxis(flat.reshape(-1, *rows.shape[1:]), 0, axis)
    return Spline(surface.degrees, tuple(knots), coefficients)


def _swept(curve: Spline, start: Array, end: Array) -> Spline:
    """Move a curve along a straight line, from one shift (3,) to another."""
    weights = curve.coefficients[:, 3:]
    shifted = [curve.coefficients + np.column_stack([weights * shift, 0 * weights]) for shift in (start, end)]
    return Spline((*curve.degrees, 1), (*curve.knots, np.array([0.0, 0, 1, 1])), np.stack(shifted, axis=1))


def _meridian(surface: Elementary, low: float, high: float) -> Spline:
    """Make the curve at angle zero of a cylinder, cone, sphere or torus."""
    origin, axis, x, _ = surface.vectors
    radius = surface.numbers[0]
    match surface.kind:
        case "cylinder":
            return straight(origin + radius * x + low * axis, origin + radius * x + high * axis)
        case "cone":
            slope = np.sin(surface.numbers[1]) * x + np.cos(surface.numbers[1]) * axis
            return straight(origin + radius * x + low * slope, origin + radius * x + high * slope)
        case "sphere":
            return conic(origin, radius * x, radius * axis, low, high)
    return conic(origin + radius * x, surface.numbers[1] * x, surface.numbers[1] * axis, low, high)


def _revolved(curve: Spline, origin: Array, axis: Array, x: Array, y: Array, low: float, high: float) -> Spline:
    """Turn a curve about an axis; angles count from x towards y.            Piegl & Tiller 1997, section 8.5"""
    circle = conic(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), low, high).coefficients
    offset = curve.coefficients[:, :3] - curve.coefficients[:, 3:] * origin
    along, out, across = (offset @ vector for vector in (axis, x, y))
    weights = circle[:, 3]
    turned_x = np.outer(circle[:, 0], out) - np.outer(circle[:, 1], across)
    turned_y = np.outer(circle[:, 1], out) + np.outer(circle[:, 0], across)
    flat = turned_x[..., None] * x + turned_y[..., None] * y + np.outer(weights, along)[..., None] * axis
    everywhere = np.outer(weights, curve.coefficients[:, 3])[..., None]
    knots = conic(np.zeros(3), x, y, low, high).knots
    return Spline(
        (2, *curve.degrees), (*knots, *curve.knots), np.concatenate([flat + everywhere * origin, everywhere], axis=2)
    )


def distances(surface: Record, points: Array, ranges: Array) -> Array:
    """Measure how far points (q, 3) lie from a surface, (q,) [length].

    In closed form where there is one, else from the closest point on the rectangle of the surface between parameters
    `ranges` (2, 2).
    """
    if isinstance(surface, Elementary) and surface.kind in ("plane", "cylinder", "cone", "sphere", "torus"):
        origin, axis, _, _ = surface.vectors
        offset = points - origin
        height = offset @ axis
        if surface.kind == "plane":
            return np.abs(height)
        radius = np.linalg.norm(offset - np.outer(height, axis), axis=1)
        match surface.kind:
            case "cylinder":
                return np.abs(radius - surface.numbers[0])
            case "cone":
                angle = surface.numbers[1]
                return np.abs((radius - surface.numbers[0]) * np.cos(angle) - height * np.sin(angle))
            case "sphere":
                return np.abs(np.hypot(radius, height) - surface.numbers[0])
        return np.abs(np.hypot(radius - surface.numbers[0], height) - surface.numbers[1])
    spline = surface_spline(surface, ranges).patch("surface")
    return np.linalg.norm(closest_points(spline, points).points - points, axis=1)
