"""Bounds of the pieces of a surface, its leaves: where they lie, how their tangents turn, how the distance curves.

What bounds places and tangents are Bernstein coefficients, which hold everywhere, not only at samples. The Hessians of
the squared distance, which only tell how many descents a leaf needs, are samples with a margin.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from geom2iga.bspline import Array, Mask, applied, basis, find_spans, open_knots, sharp_breaks
from geom2iga.patch import Patch

TURN = 0.25  # of the tangents along a leaf, as a fraction of their mean length
MOST_CUTS = 32  # leaves per span and direction
MARGIN = 1.25  # of the range of a Hessian over a leaf, beyond that of its samples
TINY = np.finfo(float).tiny ** 0.25  # a shorter tangent counts as none
ENTRIES = ((0, 0), (0, 1), (1, 1))  # of a symmetric matrix


class Level(NamedTuple):
    """Bounds over a grid of rectangles of one surface; tangents are taken by xi / scale."""

    edges: tuple[Array, Array]  # (m_1 + 1,), (m_2 + 1,)
    hard: tuple[Mask, Mask]  # (m_1, 2), (m_2, 2): the lower or upper side may hold a minimum that is no critical point
    centre: Array  # (m_1, m_2, 3) [length]
    tangents: Array  # (m_1, m_2, 2, 3) [length]
    turn: Array  # (m_1, m_2, 2): all tangents, stretched by factors > 0, lie this near those above [length]
    bend: Array  # (m_1, m_2): largest distance from the plane map of centre and tangents [length]


def cut(surface: Patch, axis: int) -> Array:
    """Edges of the leaves in one direction: knots, and between them as many cuts as the tangents' turn asks for."""
    values = _at_nodes(surface, surface.breaks, ((0, 0), (1, 0), (0, 1)))
    weight = values[0][..., 3:]
    place = values[0][..., :3] / weight
    most = np.zeros(len(surface.breaks[axis]) - 1)
    for slope in values[1:]:
        tangent = (slope[..., :3] - slope[..., 3:] * place) / weight
        mean = np.linalg.norm(tangent, axis=-1).mean()
        turn = np.linalg.norm(np.ptp(tangent, axis=2 * axis + 1), axis=-1)  # one axis fewer
        most = np.maximum(most, turn.max(axis=(1, 2) if axis == 0 else (0, 1)) / (mean if mean > 0 else 1.0))
    cuts = np.clip(np.ceil(most / TURN).astype(int), 1, MOST_CUTS)
    at = surface.breaks[axis]
    parts = [
        np.linspace(low, high, count, endpoint=False) for low, high, count in zip(at[:-1], at[1:], cuts, strict=True)
    ]
    return np.concatenate([*parts, at[-1:]])


def bound(surface: Patch, edges: tuple[Array, Array], scale: Array) -> tuple[Level, Array]:
    """Bound the leaves, and the Hessians over them."""
    value, *slopes = _at_nodes(surface, edges, ((0, 0), (1, 0), (0, 1)))
    middle = (slice(None), surface.degrees[0], slice(None), surface.degrees[1])  # of the nodes
    weight = value[..., 3:] / value[middle][:, None, :, None, 3:]
    place = value[..., :3] / value[..., 3:]
    centre = place[middle]
    stretched = [
        (slope[..., :3] - slope[..., 3:] * place) * (step * weight**2 / value[..., 3:])
        for slope, step in zip(slopes, scale, strict=True)
    ]  # tangents times the square of the weight: polynomials
    balls = [_ball(_bernstein(field)) for field in stretched]
    tangents, turn = (np.stack(parts, axis=2) for parts in zip(*balls, strict=True))
    sides = local(tangents, edges, scale)
    s, t = (np.linspace(-1, 1, 2 * p + 1) for p in surface.degrees)
    plane = (
        centre[:, None, :, None]
        + sides[:, None, :, None, 0] * s[:, None, None, None]
        + sides[:, None, :, None, 1] * t[:, None]
    )
    away = np.linalg.norm(_bernstein(weight * (place - plane)), axis=-1).max(axis=(1, 3))
    bend = away / _bernstein(weight).min(axis=(1, 3, 4))
    hard = (_hard_sides(surface, edges, 0), _hard_sides(surface, edges, 1))
    return Level(edges, hard, centre, tangents, turn, bend), _hessians(surface, edges, scale, centre)


def _hessians(surface: Patch, edges: tuple[Array, Array], scale: Array, centre: Array) -> Array:
    """Ranges (l, 21), for `_is_convex`, of the entries 11, 22, 12 of Hessians over leaves.

    With c the centre: c; middles and radii of S_a·S_b + (S - c)·S_ab; centres and radii of the S_ab. Derivatives are
    taken along directions that are orthonormal in the middle of the leaf.
    """
    orders = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    value, one, two, *second = _at_nodes(surface, edges, orders)
    weight = value[..., 3:]
    place = value[..., :3] / weight
    tangents, bends = _derivatives(place, weight, (one, two), second, scale)
    turned = _upright(tangents.mean(axis=(1, 3)))[:, None, :, None]
    tangents = turned @ tangents
    bends = np.einsum("...ab,...bck,...dc->...adk", turned, bends[..., [[0, 1], [1, 2]], :], turned)
    entries = np.einsum("...ak,...bk->...ab", tangents, tangents)
    entries += np.einsum("...k,...abk->...ab", place - centre[:, None, :, None], bends)
    parts = [(*_ball(entries[..., a, b, None]), *_ball(bends[..., a, b, :])) for a, b in ((0, 0), (1, 1), (0, 1))]
    middle, radius, curve, spread = zip(*parts, strict=True)
    columns = [centre, *middle, *(MARGIN * r for r in radius), *curve, *(MARGIN * r for r in spread)]
    return np.concatenate([part.reshape(centre[..., 0].size, -1) for part in columns], axis=1)


def _derivatives(
    place: Array, weight: Array, first: Sequence[Array], second: Sequence[Array], scale: Array
) -> tuple[Array, Array]:
    """First (..., 2, 3) and second (..., 3, 3) derivatives by xi / scale from homogeneous ones; see ENTRIES."""
    slopes = np.stack([part * step for part, step in zip(first, scale, strict=True)], axis=-2) / weight[..., None]
    tangents = slopes[..., :3] - slopes[..., 3:] * place[..., None, :]
    seconds = np.stack([part * scale[a] * scale[b] for part, (a, b) in zip(second, ENTRIES, strict=True)], axis=-2)
    seconds /= weight[..., None]
    bends = seconds[..., :3] - seconds[..., 3:] * place[..., None, :]
    for k, (a, b) in enumerate(ENTRIES):
        bends[..., k, :] -= slopes[..., a, 3:] * tangents[..., b, :] + slopes[..., b, 3:] * tangents[..., a, :]
    return tangents, bends


def _upright(tangents: Array) -> Array:
    """Matrices (..., 2, 2) that make pairs of vectors (..., 2, 3) orthonormal, where these are independent."""
    one, two = (np.maximum(np.linalg.norm(tangents[..., d, :], axis=-1), TINY) for d in range(2))
    cosine = np.clip((tangents[..., 0, :] * tangents[..., 1, :]).sum(axis=-1) / (one * two), -0.999, 0.999)
    sine = np.sqrt(1 - cosine**2)
    rows = [
        np.stack([1 / one, np.zeros_like(one)], axis=-1),
        np.stack([-cosine / one, 1 / two], axis=-1) / sine[..., None],
    ]
    return np.stack(rows, axis=-2)


def _at_nodes(surface: Patch, edges: Sequence[Array], orders: Sequence[tuple[int, int]]) -> list[Array]:
    """Derivatives of homogeneous (m_1, k_1, m_2, k_2, 4) points at k = 2 p + 1 even nodes per piece."""
    matrices = []
    for at, knots, degree in zip(edges, surface.knots, surface.degrees, strict=True):
        count, width = len(at) - 1, 2 * degree + 1
        nodes = at[:-1, None] + np.diff(at)[:, None] * np.linspace(0, 1, width)
        spans = np.repeat(find_spans(knots, degree, at[:-1]), width)
        first, values = basis(knots, degree, nodes.ravel(), 2, spans)
        dense = np.zeros((3, count * width, len(knots) - degree - 1))
        columns = np.broadcast_to(first[:, None] + np.arange(degree + 1), values.shape)
        np.put_along_axis(dense, columns, values, axis=2)
        matrices.append(dense)
    shape = tuple(n for at, p in zip(edges, surface.degrees, strict=True) for n in (len(at) - 1, 2 * p + 1))
    along = [applied(matrix, surface.homogeneous, 0) for matrix in matrices[0]]
    return [applied(matrices[1][second], along[first], 1).reshape(*shape, 4) for first, second in orders]


def _bernstein(values: Array) -> Array:
    """Bernstein coefficients, of the shape (m_1, k_1, m_2, k_2, c) of values at even nodes."""
    for axis in (1, 3):
        degree = values.shape[axis] - 1
        nodes = np.linspace(0, 1, degree + 1)
        values = applied(np.linalg.inv(basis(open_knots([0, 1], degree), degree, nodes)[1][0]), values, axis)
    return values


def _ball(coefficients: Array) -> tuple[Array, Array]:
    """Centre (m_1, m_2, 3) and radius (m_1, m_2) of a ball around vectors (m_1, k_1, m_2, k_2, 3) of each piece."""
    middle = (coefficients.max(axis=(1, 3)) + coefficients.min(axis=(1, 3))) / 2
    return middle, np.linalg.norm(coefficients - middle[:, None, :, None], axis=-1).max(axis=(1, 3))


def _hard_sides(surface: Patch, edges: tuple[Array, Array], axis: int) -> Mask:
    """(m, 2) whether the lower and upper sides of the pieces lie on the border or on a kink."""
    hard = np.isin(edges[axis], sharp_breaks(surface.knots[axis], surface.degrees[axis]))
    return np.stack([hard[:-1], hard[1:]], axis=1)


def local(tangents: Array, edges: tuple[Array, Array], scale: Array) -> Array:
    """Half sides (m_1, m_2, 2, 3) of the pieces: tangents by their half widths."""
    halves = [np.diff(at) / 2 / step for at, step in zip(edges, scale, strict=True)]
    return tangents * np.stack(np.meshgrid(*halves, indexing="ij"), axis=-1)[..., None]
