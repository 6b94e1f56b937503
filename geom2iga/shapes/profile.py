"""Four-sided plane profiles from corners and points that sides go through."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from geom2iga.bspline import Array, open_knots
from geom2iga.cad.exact import straight
from geom2iga.coons import coons
from geom2iga.errors import GeometryError, suggestion
from geom2iga.patch import evaluate
from geom2iga.spline import Spline

STRAIGHT = 1e-9  # half the angle of an arc that is a straight line [radians]
LARGEST_BEND = np.radians(75)  # half the angle of an arc; beyond, its middle weight is nearly zero
FLAT = 1e-3  # least area of a profile per parametric area, in largest ones
SAMPLES = 33  # along a side, where the profile is looked at


def profile(points: ArrayLike, through: Mapping[str, Sequence[float]], names: Sequence[str]) -> Spline:
    """Span a surface between four straight or circular sides in the plane z = 0.

    Parameters
    ----------
    points : (4, 2)
        Corners, counter-clockwise: (u, v) = (0, 0), (1, 0), (1, 1), (0, 1).
    through : side to (2,)
        A point between its ends that a side goes through, which makes it an arc; other sides are straight.
    names : four names
        Of the sides, each from one corner to the next.

    Raises
    ------
    GeometryError
        Unknown sides; corners that run clockwise; a surface that folds or has a corner of 180 degrees or more.
    """
    corners = np.asarray(points, dtype=float)
    for name in through:
        if name not in names:
            raise GeometryError(f'a profile has no side "{name}"; {suggestion(name, names)}')
    following = np.roll(corners, -1, axis=0)
    sides = [
        _side(name, start, end, through.get(name)) for name, start, end in zip(names, corners, following, strict=True)
    ]
    low, right, high, left = sides
    surface = coons([(left.backwards(0), right), (low, high.backwards(0))])
    _check_unfolded(surface)
    return surface


def _side(name: str, start: Array, end: Array, through: Sequence[float] | None) -> Spline:
    """Make a straight side, or the arc of a circle through a point."""
    if through is None:
        return straight(np.append(start, 0), np.append(end, 0))
    point, chord = np.asarray(through, dtype=float), end - start
    first, second = point - start, end - point
    bend = np.arctan2(first[0] * second[1] - first[1] * second[0], first @ second)  # half the angle of the arc
    if abs(bend) <= STRAIGHT:
        raise GeometryError(f'side "{name}" goes straight through ({point[0]:g}, {point[1]:g}): leave the point out')
    if abs(bend) >= LARGEST_BEND:
        raise GeometryError(
            f'side "{name}" is an arc of {np.degrees(2 * abs(bend)):.4g} degrees, a side can have '
            f"{np.degrees(2 * LARGEST_BEND):.4g}: split the profile"
        )
    middle = (start + end) / 2 + np.tan(bend) / 2 * np.array([chord[1], -chord[0]])
    points = np.column_stack([[start, middle, end], np.zeros(3), np.ones(3)])
    weights = np.array([1, np.cos(bend), 1])
    return Spline((2,), (open_knots([0, 1], 2),), points * weights[:, None])


def _check_unfolded(surface: Spline) -> None:
    """Raise GeometryError where the area per parametric area is not positive at a grid of points."""
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, SAMPLES)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    points, slopes = evaluate(surface.patch("profile"), grid, 1)
    area = np.linalg.det(slopes[:, :2])
    if np.all(area < 0):
        raise GeometryError("the corners of the profile run clockwise: list them the other way round")
    if area.min() <= FLAT * area.max():
        x, y, _ = points[np.argmin(area)]
        raise GeometryError(
            f"the profile folds or is flat near ({x:g}, {y:g}): give it four corners of clearly less than 180 degrees "
            "and less curved sides"
        )
