"""Which spans of the two sides may touch."""

from typing import Any, NamedTuple

import numpy as np
import shapely

from geom2iga.bspline import Array, Indices, find_spans
from geom2iga.patch import Patch
from geom2iga.projection import closest_points
from solve.face import Surface, area_vectors, halved

WIDE = 1.4  # angle of normals beyond which nothing is known, in radians
MARGIN = 0.5  # by how much the feet of some points of a span may miss those of the others, in their extent


class Spans(NamedTuple):
    """All spans of a face, the last direction running fastest."""

    low: Array  # (s, 2) parametric corners
    high: Array  # (s, 2)
    numbers: Indices  # (s, 2) knot indices


def spans_of(patch: Patch) -> Spans:
    """List the spans of a face."""
    starts, ends = ([at[own] for at in patch.breaks] for own in (slice(-1), slice(1, None)))
    numbers = [find_spans(k, p, at) for k, p, at in zip(patch.knots, patch.degrees, starts, strict=True)]
    return Spans(_grid(*starts), _grid(*ends), _grid(*numbers))


def find_box_pairs(low: Array, high: Array, other_low: Array, other_high: Array) -> tuple[Indices, Indices]:
    """Find the pairs of rectangles along the axes that meet.

    Parameters
    ----------
    low, high : (k, 2)
    other_low, other_high : (l, 2)

    Returns
    -------
    numbers, other_numbers : (n,)
        Sorted by the first.
    """
    tree = shapely.STRtree(shapely.box(*other_low.T, *other_high.T))
    numbers, others = tree.query(shapely.box(*low.T, *high.T))
    order = np.lexsort((others, numbers))
    return numbers[order], others[order]


def may_lie_opposite(secondary: Surface, primary: Surface) -> bool:
    """Say whether normals of the primary may meet the secondary side, by boxes around both and a cone of the normals.

    Where x_s = x_m + g n and n is no farther than an angle from an axis, the two points lie no farther apart across the
    axis than along it times the tangent of the angle.
    """
    cone, points = primary.cone, [side.patch.control_points.reshape(-1, 3) for side in (secondary, primary)]
    if cone.angle >= WIDE:
        return True
    frame = np.linalg.svd(cone.axis[None])[2]  # the axis, then two directions across it
    low, high = (np.array([end(values @ frame.T, axis=0) for values in points]) for end in (np.min, np.max))
    apart = np.maximum(0, np.maximum(low[0] - high[1], low[1] - high[0]))
    along = max(high[0, 0] - low[1, 0], high[1, 0] - low[0, 0])
    return bool(np.linalg.norm(apart[1:]) <= along * np.tan(cone.angle))


class Opposite(NamedTuple):
    """Where on the primary side spans of the secondary side may lie opposite."""

    low: Array  # (k, 2) rectangles in the primary's parameter plane, one per span
    high: Array  # (k, 2)
    feet: Array  # (n, 2) points there that do lie opposite


def find_opposite(secondary: Surface, primary: Surface, reach: float | None = None) -> Opposite:
    """Find where on the primary side the spans of the secondary side may lie opposite.

    Nine points of each span are projected. Spans that nowhere look at the primary side, or that are farther away than
    the reach all over, are left out.

    Parameters
    ----------
    reach : float
        Largest gap that is looked at [length]; left out, any.
    """
    patch = secondary.patch
    axes = halved(patch)
    shape = tuple(len(at) for at in axes)
    at, normal, _ = area_vectors(secondary, _grid(*axes))
    foot = closest_points(primary.patch, at)
    opposed = np.einsum("qk,qk->q", normal, area_vectors(primary, foot.xi)[1]) < 0
    nines = [_nines(values.reshape(*shape, -1)) for values in (at, foot.xi, foot.points - at, opposed)]
    points, feet, way, looks = nines
    away = np.linalg.norm(way, axis=2).min(axis=1)
    radius = np.linalg.norm(points - points[:, 4:5], axis=2).max(axis=1)
    kept = looks.any(axis=(1, 2)) & (away <= np.inf if reach is None else away <= reach + radius)
    low, high = feet[kept].min(axis=1), feet[kept].max(axis=1)
    margin = MARGIN * (high - low)
    return Opposite(low - margin, high + margin, foot.xi[opposed & foot.inside])


def _nines(values: Array) -> Array:
    """Values at the nine points of each span, (s, 9, k), of those at breaks and in between (2 n + 1, 2 m + 1, k)."""
    windows = np.lib.stride_tricks.sliding_window_view(values, (3, 3), axis=(0, 1))[::2, ::2]
    return np.moveaxis(windows, 2, -1).reshape(-1, 9, values.shape[2])


def _grid(*axes: Any) -> Any:
    """All pairs (n, 2), the last direction running fastest."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
