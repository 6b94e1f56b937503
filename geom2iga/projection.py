"""Closest points on NURBS surfaces."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from geom2iga import bounding
from geom2iga.bspline import Array, Indices, Mask, applied, basis, find_spans
from geom2iga.patch import Patch, chunks, evaluate, resolution

MOST_PASSES = 80
ROUNDING = 1e-13  # a step of this fraction of the parameter range is the last one
ENOUGH = 1e-8  # as is a Newton step of this fraction, after which the error is its square
FLAT = 1e-10  # smallest curvature of the squared distance that a step relies on, of a plane's
NORMAL = 1e-9  # largest cosine of the connecting line with a tangent, its length in sizes of the surface
TURNED = 1e-12  # the same, its length in units of itself: what rounding in the parameters turns it by
VANISHING = 1e-6  # a tangent shorter than this fraction of the other has no direction, as at a pole
SEARCHED = 16_384  # points at a time
MOVED = 4_096  # points at a time
CORNERS = 0.77 * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])  # starts in a leaf that may hold several minima
ASIDE = np.array([0.11, 0.07])  # start in any other: off its centre, where symmetry could hold a start on a crest


class Foot(NamedTuple):
    """Closest points of a surface."""

    xi: Array  # (q, 2)
    points: Array  # (q, 3) [length]
    inside: Mask  # (q,) bool: the connecting line is normal to the surface, so the foot is no mere border point


def closest_points(surface: Patch, points: Array, start: Array | None = None) -> Foot:
    """Project points onto a surface: minimise d(xi) = |x - S(xi)|.               paper, eqs. (9), (10)

    Newton's method on d²/2, all points at once, held inside the parameter range.

    Parameters
    ----------
    points : (q, 3)
        Positions [length].
    start : (q, 2)
        Where to begin, for the nearest minimum downhill; left out, the foot is the closest of all points of the
        surface.
    """
    if start is None:
        return closest_on([surface], points)[1]
    low, high = (np.array([knots[end] for knots in surface.knots]) for end in (0, -1))
    limits = np.broadcast_to(np.stack([low, high]), (len(points), 2, 2))
    (near,), places = _about_origin([surface], points)
    xi, _ = _descend(_expand(near), places, np.clip(start, low, high), limits, high - low)
    return _feet([surface], np.zeros(len(points), dtype=np.int64), points, xi)


def closest_on(surfaces: Sequence[Patch], points: Array) -> tuple[Indices, Foot]:
    """Project points onto several surfaces together: the closest of all their points.

    A first descent, from the nearest leaf of the surfaces' trees, bounds the distance. Every leaf that may hold a
    nearer point, by bounds that hold everywhere, is a start of its own. Kinks are treated as borders of what lies on
    either side.

    Parameters
    ----------
    points : (q, 3)
        Positions [length].

    Returns
    -------
    which : (q,)
        Index of the surface.
    foot : Foot
        Where on it.
    """
    near, places = _about_origin(surfaces, points)
    forest = bounding.plant(near)
    expansions = [_expand(surface) for surface in near]
    tree = cKDTree(forest.leaves.centre)
    which, xi = np.zeros(len(points), dtype=np.int64), np.zeros((len(points), 2))
    for part in chunks(len(points), SEARCHED):
        which[part], xi[part] = _search(forest, expansions, tree, places[part])
    return which, _feet(surfaces, which, points, xi)


def _about_origin(surfaces: Sequence[Patch], points: Array) -> tuple[list[Patch], Array]:
    """Move surfaces and points so that the surfaces lie about the origin: a place far away costs no digits."""
    corner = surfaces[0].control_points[0, 0]
    origin = corner + np.mean([(s.control_points - corner).mean(axis=(0, 1)) for s in surfaces], axis=0)
    return [replace(s, control_points=s.control_points - origin) for s in surfaces], points - origin


def _feet(surfaces: Sequence[Patch], which: Indices, points: Array, xi: Array) -> Foot:
    """Evaluate feet, and tell those inside."""
    feet, inside = np.zeros((len(points), 3)), np.zeros(len(points), dtype=bool)
    for number, surface in enumerate(surfaces):
        own = np.flatnonzero(which == number)
        feet[own], tangents = evaluate(surface, xi[own], 1)
        offset = feet[own] - points[own]
        slope = np.abs(np.einsum("qk,qkd->qd", offset, tangents))
        size = np.max(np.ptp(surface.control_points.reshape(-1, 3), axis=0))
        length = np.linalg.norm(tangents, axis=1)
        length = np.maximum(length, VANISHING * length.max(axis=1, keepdims=True))
        rounded = resolution(surface.control_points) + resolution(points[own])
        off = NORMAL * size + TURNED * np.linalg.norm(offset, axis=1) + rounded
        inside[own] = np.all(slope <= off[:, None] * length, axis=1)
    return Foot(xi, feet, inside)


def _search(
    forest: bounding.Forest, expansions: Sequence["Expansion"], tree: cKDTree, points: Array
) -> tuple[Indices, Array]:
    """Find the surface (q,) and the place (q, 2) of the closest points."""
    leaf = tree.query(points)[1]
    xi, distance = _descend_from(forest, expansions, points, leaf, ASIDE)
    point, other = bounding.candidates(forest, points, distance)
    known, convex = bounding.beside(forest, points, leaf, xi, point, other)
    pair = np.concatenate([np.flatnonzero(~known & convex), np.repeat(np.flatnonzero(~known & ~convex), len(CORNERS))])
    single = int(np.count_nonzero(~known & convex))
    aside = np.concatenate([np.tile(ASIDE, (single, 1)), np.tile(CORNERS, ((len(pair) - single) // len(CORNERS), 1))])
    point, other = point[pair], other[pair]
    more, further = _descend_from(forest, expansions, points[point], other, aside)
    index = np.concatenate([np.arange(len(points)), point])
    leaves, places = np.concatenate([leaf, other]), np.concatenate([xi, more])
    order = np.lexsort((np.concatenate([distance, further]), index))
    best = order[np.searchsorted(index[order], np.arange(len(points)))]
    return forest.leaves.surface[leaves[best]], places[best]


def _descend_from(
    forest: bounding.Forest, expansions: Sequence["Expansion"], points: Array, leaf: Indices, aside: Array
) -> tuple[Array, Array]:
    """Descend from leaves, starting at a fraction (2,) or (q, 2) of their half widths off their centres."""
    xi, distance = np.zeros((len(points), 2)), np.zeros(len(points))
    for number, expansion in enumerate(expansions):
        own = np.flatnonzero(forest.leaves.surface[leaf] == number)
        if not own.size:
            continue
        start, limits = bounding.start(forest, leaf[own], aside if aside.ndim == 1 else aside[own])
        reach = 2 * np.array([np.diff(at).max() for at in forest.edges[number]])
        xi[own], distance[own] = _descend(expansion, points[own], start, limits, reach)
    return xi, distance


class Expansion(NamedTuple):
    """The polynomials of a surface, span by span, in powers of what runs from -1 to 1 over the span."""

    breaks: tuple[Array, ...]
    coefficients: Array  # (p_1 + 1, p_2 + 1, 4, spans) of (w x, w y, w z, w)
    scale: Array  # (2,) change of xi that moves a point by about one unit of length


def _expand(surface: Patch) -> Expansion:
    """Expand every span about its middle."""
    values = surface.homogeneous
    for axis, (knots, degree, at) in enumerate(zip(surface.knots, surface.degrees, surface.breaks, strict=True)):
        nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
        xi = (at[:-1, None] + at[1:, None]) / 2 + np.diff(at)[:, None] / 2 * nodes
        spans = find_spans(knots, degree, at[:-1])
        first, functions = basis(knots, degree, xi.ravel(), 0, np.repeat(spans, degree + 1))
        dense = np.zeros((xi.size, len(knots) - degree - 1))
        np.put_along_axis(dense, first[:, None] + np.arange(degree + 1), functions[0], axis=1)
        powers = np.linalg.inv(nodes[:, None] ** np.arange(degree + 1))
        pieces = powers @ dense.reshape(len(spans), degree + 1, -1)
        values = applied(pieces.reshape(xi.size, -1), values, axis)
    one, two = (p + 1 for p in surface.degrees)
    values = values.reshape(-1, one, values.shape[1] // two, two, 4)
    coefficients = np.ascontiguousarray(values.transpose(1, 3, 4, 0, 2)).reshape(one, two, 4, -1)
    place = coefficients[0, 0, :3] / coefficients[0, 0, 3]
    widths = np.stack(np.meshgrid(*(np.diff(at) / 2 for at in surface.breaks), indexing="ij")).reshape(2, -1)
    slopes = np.stack([coefficients[1, 0], coefficients[0, 1]])
    tangents = (slopes[:, :3] - slopes[:, 3:] * place) / coefficients[0, 0, 3]
    length = (np.linalg.norm(tangents, axis=1) / widths).mean(axis=1)
    return Expansion(surface.breaks, coefficients, 1 / np.where(length > 0, length, 1.0))


def _squared_distance(expansion: Expansion, points: Array, xi: Array, spans: Indices) -> tuple[Array, Array, Array]:
    """Distance (q,), slopes (2, q) and bends (3, q) of d²/2 by xi / scale, for points (3, q), xi and spans (2, q)."""
    ends = [(at[span], at[span + 1]) for at, span in zip(expansion.breaks, spans, strict=True)]
    u, v = ((2 * x - low - high) / (high - low) for x, (low, high) in zip(xi, ends, strict=True))
    factors = [2 * step / (high - low) for step, (low, high) in zip(expansion.scale, ends, strict=True)]
    flat = spans[0] * (len(expansion.breaks[1]) - 1) + spans[1]
    local = expansion.coefficients[..., flat] if expansion.coefficients.shape[-1] > 1 else expansion.coefficients
    value, slope, bend = _horner(local, u, 2)
    s, s_v, s_vv = _horner(value, v, 2)
    s_u, s_uv = _horner(slope, v, 1)
    (s_uu,) = _horner(bend, v, 0)
    weight = s[3]
    offset = s[:3] / weight
    place, one, two = offset, (s_u[:3] - s_u[3] * offset) / weight, (s_v[:3] - s_v[3] * offset) / weight
    offset = place - points

    def along(vector: Array) -> Array:
        return (offset * vector).sum(axis=0)

    to_one, to_two, to_place = along(one), along(two), along(place)
    bends = [
        (along(s_uu[:3]) - 2 * s_u[3] * to_one - s_uu[3] * to_place) / weight + (one * one).sum(axis=0),
        (along(s_vv[:3]) - 2 * s_v[3] * to_two - s_vv[3] * to_place) / weight + (two * two).sum(axis=0),
        (along(s_uv[:3]) - s_u[3] * to_two - s_v[3] * to_one - s_uv[3] * to_place) / weight + (one * two).sum(axis=0),
    ]
    f, g = factors
    return np.sqrt(along(offset)), np.stack([f * to_one, g * to_two]), np.stack(bends) * [f * f, g * g, f * g]


def _horner(coefficients: Array, at: Array, order: int) -> tuple[Array, ...]:
    """Values and derivatives of polynomials, coefficients (p + 1, ..., q) by powers, at (q,)."""
    results = [coefficients[-1]] + [np.zeros_like(coefficients[-1])] * order
    for coefficient in coefficients[-2::-1]:
        for k in range(order, 0, -1):
            results[k] = results[k] * at + results[k - 1]
        results[0] = results[0] * at + coefficient
    if order > 1:
        results[2] = 2 * results[2]
    return tuple(results)


def _descend(expansion: Expansion, points: Array, xi: Array, limits: Array, reach: Array) -> tuple[Array, Array]:
    """Descend from xi (q, 2) within limits (q, 2, 2) to a minimum of the distance, by steps no longer than reach (2,).

    Returns
    -------
    xi : (q, 2)
    distance : (q,)
    """
    found, distance = np.empty(xi.shape), np.empty(len(xi))
    for part in chunks(len(xi), MOVED):
        low, high = limits[part, 0].T, limits[part, 1].T
        place, distance[part] = _descend_part(expansion, points[part].T, xi[part].T, low, high, reach[:, None])
        found[part] = place.T
    return found, distance


def _descend_part(
    expansion: Expansion, points: Array, xi: Array, low: Array, high: Array, reach: Array
) -> tuple[Array, Array]:
    """As `_descend`, with the components first."""
    span_limits = (
        np.stack([np.searchsorted(at, low[d], side="right") - 1 for d, at in enumerate(expansion.breaks)]),
        np.stack([np.searchsorted(at, high[d]) - 1 for d, at in enumerate(expansion.breaks)]),
    )
    xi, trial, step = xi.copy(), xi.copy(), np.zeros(xi.shape)
    distance = np.full(xi.shape[1], np.inf)
    spread = np.array([[at[-1] - at[0]] for at in expansion.breaks])
    slack = ROUNDING * np.abs(points).max(axis=0, initial=0.0)
    active = np.arange(xi.shape[1])
    for _ in range(MOST_PASSES):
        if not active.size:
            break
        span = np.stack(
            [np.searchsorted(at, trial[d, active], side="right") - 1 for d, at in enumerate(expansion.breaks)]
        )
        span = np.clip(span, span_limits[0][:, active], span_limits[1][:, active])
        found, slope, bend = _squared_distance(expansion, points[:, active], trial[:, active], span)
        nearer = found <= distance[active] * (1 + ROUNDING) + slack[active]
        moved, stayed = active[nearer], active[~nearer]
        xi[:, moved], distance[moved] = trial[:, moved], found[nearer]
        step[:, moved], sure = _newton_step(
            slope[:, nearer], bend[:, nearer], xi[:, moved], low[:, moved], high[:, moved], reach, expansion.scale
        )
        step[:, stayed] /= 2
        enough = np.full(xi.shape[1], ROUNDING)
        enough[moved[sure]] = ENOUGH
        trial[:, active] = _held(xi[:, active] + step[:, active], low[:, active], high[:, active])
        done = (np.abs(step[:, active]) <= enough[active] * spread).all(axis=0)
        xi[:, active[done & nearer]] = trial[:, active[done & nearer]]
        active = active[~done]
    return xi, distance


def _held(xi: Array, low: Array, high: Array) -> Array:
    """Places (2, q) within limits; what rounding alone parts from a limit lies on it."""
    border = ROUNDING * (high - low)
    return np.where(xi <= low + border, low, np.where(xi >= high - border, high, xi))


def _newton_step(
    slope: Array, bend: Array, xi: Array, low: Array, high: Array, reach: Array, scale: Array
) -> tuple[Array, Array]:
    """One step (2, q) downhill; a direction that pushes out of the range at its end is left out.

    Negative curvatures count as positive, as in saddle-free Newton methods: the step leads away from crests.

    Returns
    -------
    step : (2, q)
    sure : (q,)
        Whether it is the full step of Newton's method on a convex function.
    """
    border = ROUNDING * (high - low)
    at_low, at_high = xi <= low + border, xi >= high - border
    slope, bend = slope.copy(), bend.copy()
    stuck = (at_low & (slope > 0)) | (at_high & (slope < 0))
    for _ in range(3):  # a step of both directions together may push out where the slope alone does not
        slope[stuck] = 0.0
        bend[2, stuck.any(axis=0)] = 0.0
        middle, half = (bend[0] + bend[1]) / 2, (bend[0] - bend[1]) / 2
        apart = np.hypot(half, bend[2])
        upper, lower = np.maximum(np.abs(middle + apart), FLAT), np.maximum(np.abs(middle - apart), FLAT)
        share = np.where(apart > 0, (upper - lower) / np.where(apart > 0, 2 * apart, 1.0), 1.0)
        shift = upper - share * (middle + apart)
        one, two, mixed = shift + share * bend[0], shift + share * bend[1], share * bend[2]
        step = np.stack([mixed * slope[1] - two * slope[0], mixed * slope[0] - one * slope[1]])
        step *= scale[:, None] / (upper * lower)
        stuck = (at_low & (step < 0)) | (at_high & (step > 0))
        if not stuck.any():
            break
    room = np.minimum(np.where(step > 0, high - xi, xi - low), reach)  # shortened, not bent: that could lead away
    whole = np.abs(step) <= room
    cut = np.where(whole, 1.0, room / np.where(step != 0, np.abs(step), 1.0)).min(axis=0)
    return step * cut, whole.all(axis=0) & (middle > apart)
