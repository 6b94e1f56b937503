"""Round surfaces and what lies under them: balls in blocks, bottoms of blocks that are domes."""

from collections.abc import Sequence
from math import asin, degrees, hypot, sqrt
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from geom2iga.bspline import Array, open_knots
from geom2iga.errors import GeometryError
from geom2iga.patch import Patch
from geom2iga.shapes.sweeps import arc, extruded, quadrilateral, ruled, shifted, turned
from geom2iga.sphere import closing_angle, spherical_patch
from geom2iga.spline import Spline, restricted

Bottom = Literal["sphere", "cylinder", "paraboloid"]

CORE = 0.5  # distance of the corners of a core from the centre or the axis, in radii
SIGNS = -1.0, 1.0
ORIGIN = np.zeros(3)
HALF_WAY = 0.5  # the parameter of the lines of symmetry of a dome


def ball_blocks(radius: float) -> list[Spline]:
    """Cut a ball about the origin into a cube and the caps on its faces, their third direction outward."""
    corner = radius / sqrt(3)
    upper = np.array([[(x, y, corner) for y in (-corner, corner)] for x in (-corner, corner)])
    cap = ruled(quadrilateral(CORE * upper), _spherical(upper, radius))
    core = extruded(quadrilateral(CORE * upper * (1, 1, -1)), (0, 0, 2 * CORE * corner))
    turns = [*_quarters("x", range(4)), *_quarters("y", (1, 3))]
    return [core, *(turned(cap, turn) for turn in turns)]


def half_ball_blocks(radius: float) -> list[Spline]:
    """Cut the lower half of a ball into half a cube, the cap below it, and the halves of four caps around it.

    The third direction of the caps is outward, the second of the halves of caps upward. Their edges on the equator
    have no turn and remain quadratic.
    """
    corner, equator = radius / sqrt(3), radius / sqrt(2)
    lower = np.array([[(x, y, -corner) for y in (-corner, corner)] for x in (corner, -corner)])  # seen from outside
    around = np.array([[(corner, s * corner, -corner), (equator, s * equator, 0)] for s in SIGNS])
    inner = np.array([[(corner, s * corner, -corner), (corner, s * corner, 0)] for s in SIGNS])
    below = closing_angle(_arcs(lower, ORIGIN), ORIGIN, radius) / 4
    beside = (closing_angle(_arcs(around, ORIGIN), ORIGIN, radius) - below) / 2
    core = extruded(quadrilateral(CORE * lower[::-1]), (0, 0, CORE * corner))
    cap = ruled(quadrilateral(CORE * lower), _spherical(lower, radius))
    half = ruled(quadrilateral(CORE * inner), _spherical(around, radius, [below, 0, beside, beside]))
    return [core, cap, *(turned(half, turn) for turn in _quarters("z", range(4)))]


def domed_surface(width: float, depth: float, radius: float, kind: Bottom) -> tuple[Spline, float]:
    """Make a surface over a rectangle about the origin, its lowest point, that is convex to below.

    Returns
    -------
    surface : Spline
        Its edges lie in the vertical planes over the edges of the rectangle.
    rise : float
        Height of its highest points [length].

    Raises
    ------
    GeometryError
        A rectangle that reaches beyond the sphere or the cylinder.
    """
    out = width / 2 if kind == "cylinder" else hypot(width, depth) / 2
    if kind == "paraboloid":
        return _paraboloid(width / 2, depth / 2, radius), out**2 / (2 * radius)
    if out >= radius:
        raise GeometryError(
            f"the bottom of a block reaches {out:g} to the side, its {kind} only {radius:g}: choose a larger radius"
        )
    rise = out**2 / (radius + sqrt(radius**2 - out**2))
    if kind == "sphere":
        corners = np.array([[(x * width / 2, y * depth / 2, rise) for y in SIGNS] for x in SIGNS])
        offsets = np.array([*((0, y * depth / 2, 0) for y in SIGNS), *((x * width / 2, 0, 0) for x in SIGNS)])
        return _spherical(corners, radius, centre=np.array([0, 0, radius]), offsets=offsets), rise
    half = degrees(asin(out / radius))
    upright = arc(ORIGIN, radius, -90 - half, -90 + half).moved(
        np.array([[1.0, 0, 0, 0], [0, 0, 0, 0], [0, 1, 0, radius]])
    )
    return ruled(shifted(upright, (0, -depth / 2, 0)), shifted(upright, (0, depth / 2, 0))), rise


def quarter_of(surface: Spline) -> Spline:
    """Cut out the upper half in both directions of a surface."""
    for axis in range(2):
        front = np.moveaxis(surface.coefficients, axis, 0)
        knots, half = restricted(
            surface.degrees[axis], surface.knots[axis], front.reshape(len(front), -1), HALF_WAY, 1.0
        )
        coefficients = np.moveaxis(half.reshape(-1, *front.shape[1:]), 0, axis)
        each = tuple(knots if d == axis else given for d, given in enumerate(surface.knots))
        surface = Spline(surface.degrees, each, coefficients)
    return surface


def _paraboloid(half_width: float, half_depth: float, radius: float) -> Spline:
    """Surface z = (x² + y²) / (2 radius): the coefficients of t² on (-1, 1) are 1, -1, 1."""
    x, y = np.meshgrid([-half_width, 0, half_width], [-half_depth, 0, half_depth], indexing="ij")
    square = np.array([1.0, -1, 1])
    z = (half_width**2 * square[:, None] + half_depth**2 * square) / (2 * radius)
    return Spline((2, 2), (open_knots([0, 1], 2),) * 2, np.stack([x, y, z, np.ones((3, 3))], axis=-1))


def _spherical(
    corners: Array, radius: float, turns: ArrayLike | None = None, centre: Array = ORIGIN, offsets: Array = ORIGIN
) -> Spline:
    """Surface on a sphere between arcs through corners (2, 2, 3), with turns (4,), in planes off the centre (4, 3)."""
    patch = spherical_patch(_arcs(corners, centre + offsets), centre, radius, turns)
    return Spline(patch.degrees, patch.knots, patch.homogeneous)


def _arcs(corners: Array, centres: Array) -> list[Patch]:
    """Arcs about centres (4, 3) between corners (2, 2, 3), in the sequence that `spherical_patch` takes."""
    ends = (corners[:, 0], corners[:, 1], corners[0], corners[1])
    return [_arc_about(about, *pair) for about, pair in zip(np.broadcast_to(centres, (4, 3)), ends, strict=True)]


def _arc_about(centre: Array, start: Array, end: Array) -> Patch:
    """Make an arc of less than 180 degrees about a point, (3,) each."""
    middle = (start + end) / 2 - centre
    share = float(middle @ middle / ((start - centre) @ (start - centre)))  # the squared cosine of half its angle
    points = np.array([start, centre + middle / share, end])
    return Patch("arc", (2,), (open_knots([0, 1], 2),), points, np.array([1, sqrt(share), 1]))


def _quarters(axis: str, counts: Sequence[int]) -> list[Rotation]:
    """Turns by so many right angles about an axis."""
    return [Rotation.from_euler(axis, 90.0 * count, degrees=True) for count in counts]
