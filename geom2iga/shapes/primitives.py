"""Bodies that a few numbers describe, as exact patches: cylinder, pipe, ball, hemisphere, domed block, sweeps.

Every function takes lengths [length] and angles [degrees], builds around the origin of space and returns a `Part`;
`placed` moves it. Its patches are named after the body, those of several "name/1", "name/2" and so on; they are
right-handed, nothing is collapsed, and the Jacobian is positive up to the boundary.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from math import fmod, radians, sin
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from geom2iga.bspline import Array
from geom2iga.errors import GeometryError
from geom2iga.model import SIDES, Part
from geom2iga.patch import Face, Patch
from geom2iga.shapes.domes import CORE, ORIGIN, Bottom, ball_blocks, domed_surface, half_ball_blocks, quarter_of
from geom2iga.shapes.profile import profile
from geom2iga.shapes.sweeps import arc, equal_angles, extruded, quadrilateral, revolved, ruled, turned
from geom2iga.spline import Spline

LARGEST_CORE = 135.0  # what a corner of a core may take up around the axis [degrees]
WHOLE = 360.0  # [degrees]
BLURRED = 1e-6  # distance of neighbouring coordinates that is too much, in thicknesses of a body
THINNEST = 1e-3  # sector or slit [degrees]
EXTRUDED = ("front", "right", "back", "left")  # sides of a profile in the sequence of its corners
REVOLVED = ("bottom", "outer", "top", "inner")

Places = Mapping[str, Sequence[tuple[int, int, int]]]  # of named faces: number of the patch, axis, side


def cylinder(name: str, radius: float, height: float, angle: float = WHOLE) -> Part:
    """Make a solid cylinder that stands on the origin, or a sector of one.

    The whole is a square core with four patches around it. A sector of at most 135 degrees is a core with one corner
    on the axis and two patches outside; a larger one is cut into two or three of these.

    Parameters
    ----------
    angle :
        Of the sector, counter-clockwise from the x axis, up to 360.

    Returns
    -------
    Part
        Faces "side", "bottom", "top", of a sector also "start" and "end".
    """
    _check_angle(angle)
    sections, places = _whole_disc(radius) if angle == WHOLE else _sector(radius, angle)
    numbers = range(len(sections))
    ends = {"bottom": [(k, 2, 0) for k in numbers], "top": [(k, 2, 1) for k in numbers]}
    return _part(name, [extruded(section, (0, 0, height)) for section in sections], {**places, **ends})


def pipe(name: str, inner: float, outer: float, height: float, angle: float = WHOLE) -> Part:
    """Make a hollow cylinder that stands on the origin, or a sector of one: a patch for every 90 degrees or less.

    Parameters
    ----------
    inner, outer :
        Radii.
    angle :
        Of the sector, counter-clockwise from the x axis, up to 360.

    Returns
    -------
    Part
        Faces "inner", "outer", "bottom", "top", of a sector also "start" and "end".
    """
    if not inner < outer:
        raise GeometryError(f"the inner radius {inner:g} of a pipe must be less than its outer radius {outer:g}")
    return revolution(name, [(inner, 0), (outer, 0), (outer, height), (inner, height)], angle=angle)


def sphere(name: str, radius: float) -> Part:
    """Make a ball about the origin: a cube with a cap on each face, as Cobb (1988) tiles the sphere.

    Returns
    -------
    Part
        Seven patches; face "outside".
    """
    return _part(name, ball_blocks(radius), {"outside": [(k, 2, 1) for k in range(1, 7)]})


def hemisphere(name: str, radius: float, height: float = 0.0, flat: Literal["up", "down"] = "up") -> Part:
    """Make half a ball about the origin, on demand with a cylindrical shank on its flat side, as a punch.

    Half a cube with five caps, and the shank the five patches of a cylinder.

    Parameters
    ----------
    height :
        Of the shank; 0: none.
    flat :
        Which way the flat side looks.

    Returns
    -------
    Part
        6 or 11 patches; faces "outside", on the sphere, "flat", and with a shank "side".
    """
    volumes = half_ball_blocks(radius)
    places = {"outside": [(k, 2, 1) for k in range(1, 6)], "flat": [(0, 2, 1), *((k, 1, 1) for k in range(2, 6))]}
    if height > 0:
        tops = [volumes[0].end(2, 1), *(volume.end(1, 1).transposed() for volume in volumes[2:])]
        places |= {"flat": [(k, 2, 1) for k in range(6, 11)], "side": [(k, 0, 1) for k in range(7, 11)]}
        volumes += [extruded(top, (0, 0, height)) for top in tops]
    turn = Rotation.from_euler("x", 0.0 if flat == "up" else 180.0, degrees=True)
    return _part(name, [turned(volume, turn) for volume in volumes], places)


def domed_block(
    name: str, size: Sequence[float], radius: float, bottom: Bottom = "sphere", quarter: bool = False
) -> Part:
    """Make a block with plane sides and a convex bottom whose lowest point is the origin.

    Parameters
    ----------
    size : (3,)
        Its edges along x and y, and its height above the lowest point.
    radius :
        Of curvature at the lowest point.
    bottom :
        A sphere, a cylinder about a line along y, or the paraboloid z = (x² + y²) / (2 radius).
    quarter :
        Only what lies over positive x and y, as wide and deep as `size` says, for a model with two planes of symmetry.

    Returns
    -------
    Part
        One patch; faces "left" ... "top" as those of a block.
    """
    times = 2 if quarter else 1
    low, rise = domed_surface(times * size[0], times * size[1], radius, bottom)
    low = quarter_of(low) if quarter else low
    if size[2] <= rise:
        raise GeometryError(
            f"the height {size[2]:g} of a block must be more than the {rise:g} by which its bottom rises"
        )
    flattened = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, size[2]]])
    places = {side: [(0, k // 2, k % 2)] for k, side in enumerate(SIDES)}
    return _part(name, [ruled(low, low.moved(flattened))], places)


def extrusion(
    name: str, points: ArrayLike, vector: Sequence[float], through: Mapping[str, Sequence[float]] | None = None
) -> Part:
    """Move a four-sided profile in the plane of x and y along a vector.

    Parameters
    ----------
    points : (4, 2)
        Corners of the profile, counter-clockwise.
    vector : (3,)
        With a positive z.
    through : side to (2,)
        Points that the sides "front" (from the first corner to the second), "right", "back" and "left" go through as
        arcs; other sides are straight.

    Returns
    -------
    Part
        One patch; faces "front", "right", "back", "left", "bottom" and "top".
    """
    if not vector[2] > 0:
        raise GeometryError(f"an extrusion must rise: the z of its vector must be positive, found {vector[2]:g}")
    places = {side: [(0, k // 2, k % 2)] for k, side in enumerate(SIDES)}
    return _part(name, [extruded(profile(points, through or {}, EXTRUDED), vector)], places)


def revolution(
    name: str, points: ArrayLike, through: Mapping[str, Sequence[float]] | None = None, angle: float = WHOLE
) -> Part:
    """Turn a four-sided profile about the z axis, counter-clockwise from the plane of x and z.

    Parameters
    ----------
    points : (4, 2)
        Corners of the profile as (distance from the axis, z), counter-clockwise.
    through : side to (2,)
        Points that the sides "bottom" (from the first corner to the second), "outer", "top" and "inner" go through
        as arcs; other sides are straight.
    angle :
        Up to 360.

    Returns
    -------
    Part
        A patch for every 90 degrees or less; faces named after the sides, with less than 360 also "start" and "end".
    """
    _check_angle(angle)
    surface = profile(points, through or {}, REVOLVED)
    nearest = (surface.coefficients[..., 0] / surface.coefficients[..., 3]).min()
    if nearest <= 0:
        raise GeometryError(
            f"a profile that is revolved must keep off the axis, found {nearest:g} as the distance of a control point"
        )
    upright = surface.moved(np.array([[1.0, 0, 0, 0], [0, 0, 0, 0], [0, 1, 0, 0]]))
    at = equal_angles(angle)
    volumes = [revolved(upright, low, high) for low, high in pairwise(at)]
    numbers = range(len(volumes))
    sides = {"bottom": (2, 0), "top": (2, 1), "inner": (0, 0), "outer": (0, 1)}
    places = {side: [(k, *place) for k in numbers] for side, place in sides.items()}
    cuts = {} if angle == WHOLE else {"start": [(0, 1, 0)], "end": [(len(volumes) - 1, 1, 1)]}
    return _part(name, volumes, {**places, **cuts})


def placed(
    part: Part,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    axis: ArrayLike = (0.0, 0.0, 1.0),
    angle: float = 0.0,
    about: ArrayLike | None = None,
) -> Part:
    """Move a part so that its reference point comes to an origin, then rotate it about an axis.

    Parameters
    ----------
    angle :
        Right-handed [degrees].
    about : (3,)
        A point of the axis; left out, the origin.

    Raises
    ------
    GeometryError
        So far away that rounding there blurs the shape.
    """
    centre = np.asarray(origin if about is None else about, dtype=float)
    direction = np.asarray(axis, dtype=float) / np.abs(axis).max()  # its length may be beyond what can be squared
    turn = Rotation.from_rotvec(radians(fmod(angle, WHOLE)) * direction / np.linalg.norm(direction)).as_matrix()
    start = np.asarray(origin, dtype=float) - centre
    patches = [replace(p, control_points=(p.control_points + start) @ turn.T + centre) for p in part.patches]
    _check_distance(part, patches, turn)
    return Part(tuple(patches), part.faces)


def _check_distance(part: Part, patches: Sequence[Patch], turn: Array) -> None:
    """Raise GeometryError where patches, turned, lie so far away that rounding there blurs what they were before."""
    thickness = np.min([np.ptp(patch.control_points, axis=(0, 1, 2)) for patch in part.patches], axis=0)
    farthest = np.max([np.abs(patch.control_points).max(axis=(0, 1, 2)) for patch in patches], axis=0)
    blur = (np.abs(turn) * np.spacing(farthest)[:, None]).max(axis=0)
    worst = int(np.argmax(blur / thickness))
    if not blur[worst] <= BLURRED * thickness[worst]:
        raise GeometryError(
            f"it is {thickness[worst]:.3g} thick and reaches {farthest.max():.3g} far from the zero point, where "
            f"coordinates are {blur[worst]:.1g} apart: move the model nearer to the zero point"
        )


def _part(name: str, volumes: Sequence[Spline], places: Places) -> Part:
    """Name the patches and faces of a body."""
    names = [name] if len(volumes) == 1 else [f"{name}/{number}" for number in range(1, len(volumes) + 1)]
    patches = tuple(volume.patch(each) for volume, each in zip(volumes, names, strict=True))
    faces = {face: tuple(Face(names[k], axis, side) for k, axis, side in at) for face, at in places.items()}
    return Part(patches, faces)


def _check_angle(angle: float) -> None:
    """Raise GeometryError unless an angle lies in (0, 360] and leaves no sector or slit too thin to tell its sides."""
    if not 0 < angle <= WHOLE:
        raise GeometryError(f"an angle must be more than 0 and at most 360 degrees, found {angle:g}")
    if angle < THINNEST or 0 < WHOLE - angle < THINNEST:
        raise GeometryError(
            f"an angle of {angle!r} degrees leaves less than {THINNEST:g} of a sector or a slit: round it"
        )


def _around(radius: float, angles: ArrayLike) -> Array:
    """Points (n, 3) at angles from the x axis [degrees]."""
    turns = np.radians(angles)
    return radius * np.column_stack([np.cos(turns), np.sin(turns), np.zeros(len(turns))])


def _ring(corners: Array, radius: float, angles: Array) -> list[Spline]:
    """Surfaces between a line through points (n + 1, 3) and the circle at angles (n + 1,): outward, then around."""
    ends = zip(corners[:-1], corners[1:], angles[:-1], angles[1:], strict=True)
    return [
        ruled(quadrilateral([[a, b]] * 2).end(0, 0), arc(ORIGIN, radius, low, high), axis=0) for a, b, low, high in ends
    ]


def _whole_disc(radius: float) -> tuple[list[Spline], Places]:
    """Square core and the four surfaces around it."""
    angles = np.array([-135.0, -45, 45, 135, 225])
    corners = _around(CORE * radius, angles)
    corners[4] = corners[0]
    core = quadrilateral([[corners[0], corners[3]], [corners[1], corners[2]]])
    return [core, *_ring(corners, radius, angles)], {"side": [(k, 0, 1) for k in range(1, 5)]}


def _sector(radius: float, angle: float) -> tuple[list[Spline], Places]:
    """Cores with a corner on the axis, each with two surfaces outside.

    Opposite the axis, core and outer surfaces meet at 120 degrees each.
    """
    at = equal_angles(angle, LARGEST_CORE)
    surfaces = []
    for low, high in pairwise(at):
        angles = np.array([low, (low + high) / 2, high])
        corners = _around(CORE * radius, angles)
        corners[1] *= sin(radians(120 - (high - low) / 2)) / sin(radians(60))
        surfaces += [quadrilateral([[ORIGIN, corners[2]], [corners[0], corners[1]]]), *_ring(corners, radius, angles)]
    last = len(surfaces) - 1
    side = [(k, 0, 1) for k in range(len(surfaces)) if k % 3]
    return surfaces, {"side": side, "start": [(0, 1, 0), (1, 1, 0)], "end": [(last - 2, 0, 0), (last, 1, 1)]}
