"""Bounds of surfaces in a tree: which pieces of a set of faces may hold the closest point.

Every face is cut into leaves over which its tangents turn little; neighbouring leaves are joined in twos and twos, up
to one root. What excludes a piece are bounds by Bernstein coefficients, which hold everywhere, not only at samples.
How many descents a leaf then needs is told by samples of the Hessians, with a margin.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geom2iga.bspline import Array, Indices, Mask
from geom2iga.leaves import Level, bound, cut, local
from geom2iga.patch import Patch

PAIRS = 200_000  # of a point and a node, tested at a time


class Leaves(NamedTuple):
    """The pieces of all surfaces."""

    surface: Indices  # (l,)
    place: Indices  # (l, 2) row and column on its surface
    rectangle: Array  # (l, 2, 2) lower and upper corner
    smooth: Indices  # (l, 2, 2) first and last row and column that no kink parts from this one
    limits: Array  # (l, 2, 2) lower and upper corner of those
    centre: Array  # (l, 3) [length]
    hessians: Array  # (l, 21) bounds of the Hessian of half the squared distance: see `leaves`


class Forest(NamedTuple):
    """Trees over all surfaces; the leaves come first among the nodes."""

    leaves: Leaves
    edges: list[tuple[Array, Array]]  # of the leaves of every surface
    nodes: Array  # (n, 16) centre, half sides, bend, four bounds of slopes, two turns
    children: Indices  # (n, 4), -1 where there is none
    roots: Indices


def plant(surfaces: Sequence[Patch]) -> Forest:
    """Make the trees of surfaces."""
    grown = [_grow(number, surface) for number, surface in enumerate(surfaces)]
    leaf_counts = np.array([len(tree.leaves.surface) for tree in grown])
    node_counts = np.array([len(tree.nodes) for tree in grown])
    leaf_shift = np.cumsum(leaf_counts) - leaf_counts
    node_shift = leaf_counts.sum() + np.cumsum(node_counts - leaf_counts) - node_counts  # of inner nodes
    children, roots = [], []
    for tree, count, low, high in zip(grown, leaf_counts, leaf_shift, node_shift, strict=True):
        moved = tree.children + np.where(tree.children < count, low, high)
        children.append(np.where(tree.children < 0, -1, moved))
        roots.append(tree.roots + np.where(tree.roots < count, low, high))

    def leaves_first(parts: Sequence[NDArray]) -> NDArray:
        ends = list(zip(parts, leaf_counts, strict=True))
        return np.concatenate([part[:count] for part, count in ends] + [part[count:] for part, count in ends])

    return Forest(
        Leaves(*(np.concatenate(parts) for parts in zip(*(tree.leaves for tree in grown), strict=True))),
        [edges for tree in grown for edges in tree.edges],
        leaves_first([tree.nodes for tree in grown]),
        leaves_first(children),
        np.concatenate(roots),
    )


def candidates(forest: Forest, points: Array, distance: Array) -> tuple[Indices, Indices]:
    """Find the leaves that may hold a point nearer than a distance.

    A node is left out where it lies too far away, or where the distance falls throughout towards a side beyond which
    the surface goes on smoothly.

    Parameters
    ----------
    points : (q, 3)
    distance : (q,)
        Known upper bounds of the distances [length].

    Returns
    -------
    point, leaf : (pairs,)
    """
    found = [(np.empty(0, dtype=np.int64),) * 2]
    pending = [(np.repeat(np.arange(len(points)), len(forest.roots)), np.tile(forest.roots, len(points)))]
    leaf_count = len(forest.leaves.surface)
    while pending:
        point, node = pending.pop()
        if len(point) > PAIRS:
            pending += [(point[:PAIRS], node[:PAIRS]), (point[PAIRS:], node[PAIRS:])]
            continue
        kept = _may_hold(forest.nodes[node], points[point], distance[point])
        point, node = point[kept], node[kept]
        leaf = node < leaf_count
        found.append((point[leaf], node[leaf]))
        below = forest.children[node[~leaf]]
        if below.size:
            row, column = np.nonzero(below >= 0)
            pending.append((point[~leaf][row], below[row, column]))
    return np.concatenate([part[0] for part in found]), np.concatenate([part[1] for part in found])


def _may_hold(nodes: Array, points: Array, distance: Array) -> Mask:
    """(pairs,) whether a node may hold a minimum of the distance to a point that lies below a bound."""
    table = np.ascontiguousarray(nodes.T)
    offset = table[:3] - points.T
    away = np.sqrt(np.einsum("kq,kq->q", offset, offset))
    slopes = np.stack([np.einsum("kq,kq->q", offset, table[3:6]), np.einsum("kq,kq->q", offset, table[6:9])])
    reach = np.abs(slopes).sum(axis=0) / np.where(away > 0, away, 1.0)  # half its width, seen from the point
    near = away - reach - table[9] < distance
    turn = away * table[14:16]
    falls = (slopes > table[10:12] + turn) | (-slopes > table[12:14] + turn)
    return near & ~falls.any(axis=0)


def _is_convex(hessians: Array, points: Array) -> Mask:
    """(q,) whether the squared distance to a point is convex over a leaf, one of each for each point."""
    offset = hessians[:, :3] - points
    away = np.linalg.norm(offset, axis=1)
    middle = hessians[:, 3:6] + np.einsum("qak,qk->qa", hessians[:, 9:18].reshape(-1, 3, 3), offset)
    spread = hessians[:, 6:9] + away[:, None] * hessians[:, 18:21]
    low = middle[:, :2] - spread[:, :2]
    return (low > 0).all(axis=1) & (low[:, 0] * low[:, 1] > (np.abs(middle[:, 2]) + spread[:, 2]) ** 2)


def _grow(number: int, surface: Patch) -> Forest:
    """Make the tree of one surface."""
    edges = (cut(surface, 0), cut(surface, 1))
    scale = np.array([np.diff(at).mean() / 2 for at in edges])
    level, hessians = bound(surface, edges, scale)
    place = _grid(*(np.arange(len(at) - 1) for at in edges))
    smooth = np.stack([_smooth_ranges(level.hard[d])[place[:, d]] for d in range(2)], axis=2)
    leaves = Leaves(
        np.full(len(place), number),
        place,
        np.stack([_grid(edges[0][:-1], edges[1][:-1]), _grid(edges[0][1:], edges[1][1:])], axis=1),
        smooth,
        np.stack([edges[d][smooth[:, :, d] + [0, 1]] for d in range(2)], axis=2),
        level.centre.reshape(-1, 3),
        hessians,
    )
    nodes, children, first = [_table(level, scale)], [np.full((len(place), 4), -1)], 0
    while level.bend.size > 1:
        children.append(_children(level.bend.shape, first))
        first += level.bend.size
        level = _joined(level, scale)
        nodes.append(_table(level, scale))
    return Forest(
        leaves,
        [edges],
        np.concatenate(nodes),
        np.concatenate(children),
        np.array([first]),
    )


def _grid(first: NDArray, second: NDArray) -> NDArray:
    """(n m, 2) all pairs of entries."""
    return np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)


def _smooth_ranges(hard: Mask) -> Indices:
    """(m, 2) first and last piece that no hard side parts from each piece."""
    first, last = np.flatnonzero(hard[:, 0]), np.flatnonzero(hard[:, 1])
    number = np.cumsum(hard[:, 0]) - 1
    return np.stack([first[number], last[number]], axis=1)


def _joined(level: Level, scale: Array) -> Level:
    """Bounds over twos and twos of neighbours; where their number is odd, the last stays alone."""
    edges = (_every_other(level.edges[0]), _every_other(level.edges[1]))
    hard = (_any_of_two(level.hard[0]), _any_of_two(level.hard[1]))
    pairs = [np.minimum(np.stack([np.arange(0, n, 2), np.arange(1, n + 1, 2)]), n - 1) for n in level.bend.shape]
    parts = [np.ix_(row, column) for row in pairs[0] for column in pairs[1]]
    middles = [(at[:-1] + at[1:]) / 2 for at in level.edges]
    centres = _grid(*((at[:-1] + at[1:]) / 2 for at in edges)).reshape(len(edges[0]) - 1, -1, 2)
    tangents = np.mean([level.tangents[part] for part in parts], axis=0)

    def offset(part: tuple[Indices, ...]) -> Array:
        at = np.stack(np.broadcast_arrays(middles[0][part[0]], middles[1][part[1]]), axis=-1)
        return (at - centres) / scale

    centre = np.mean(
        [level.centre[part] - np.einsum("ijd,ijdk->ijk", offset(part), tangents) for part in parts], axis=0
    )
    halves = [np.diff(at) / 2 / step for at, step in zip(level.edges, scale, strict=True)]
    turn, bend = np.zeros(tangents.shape[:3]), np.zeros(tangents.shape[:2])
    for part in parts:
        apart = np.linalg.norm(level.tangents[part] - tangents, axis=-1)
        gap = level.centre[part] - centre - np.einsum("ijd,ijdk->ijk", offset(part), tangents)
        lost = apart[..., 0] * halves[0][part[0]] + apart[..., 1] * halves[1][part[1]]
        turn = np.maximum(turn, apart + level.turn[part])
        bend = np.maximum(bend, np.linalg.norm(gap, axis=-1) + lost + level.bend[part])
    return Level(edges, hard, centre, tangents, turn, bend)


def _every_other(edges: Array) -> Array:
    return np.append(edges[:-1:2], edges[-1])


def _any_of_two(sides: Mask) -> Mask:
    return np.logical_or.reduceat(sides, np.arange(0, len(sides), 2), axis=0)


def _children(shape: tuple[int, ...], first: int) -> Indices:
    """Numbers (n, 4) of the nodes that `_joined` joins, -1 where there is none."""
    numbers = np.full([n + n % 2 for n in shape], -1)
    numbers[: shape[0], : shape[1]] = first + np.arange(shape[0] * shape[1]).reshape(shape)
    half = [n // 2 for n in numbers.shape]
    return numbers.reshape(half[0], 2, half[1], 2).transpose(0, 2, 1, 3).reshape(-1, 4)


def _table(level: Level, scale: Array) -> Array:
    """What `_may_hold` asks of nodes (n, 16)."""
    sides = local(level.tangents, level.edges, scale)
    length = np.linalg.norm(sides, axis=-1)
    halves = local(np.ones((*level.bend.shape, 2, 1)), level.edges, scale)[..., 0]
    turn = level.turn * halves
    cross = np.abs(np.einsum("ijk,ijk->ij", sides[:, :, 0], sides[:, :, 1]))[..., None]
    radius = length.sum(axis=-1) + level.bend
    slope = length**2 + cross + level.bend[..., None] * length + radius[..., None] * turn
    hard = np.stack(
        [
            np.broadcast_to(level.hard[0][:, None], (*level.bend.shape, 2)),
            np.broadcast_to(level.hard[1][None], (*level.bend.shape, 2)),
        ],
        axis=2,
    )
    bounds = np.where(hard, np.inf, slope[..., None])  # lower and upper side, direction by direction
    parts = [level.centre, sides, level.bend, bounds[..., 0], bounds[..., 1], turn]
    return np.concatenate([part.reshape(level.bend.size, -1) for part in parts], axis=1)


def start(forest: Forest, leaf: Indices, aside: Array) -> tuple[Array, Array]:
    """Place starts (q, 2) a fraction of half a leaf off its centre; and limits (q, 2, 2): the kinks around it."""
    leaves = forest.leaves
    low, high = leaves.rectangle[leaf, 0], leaves.rectangle[leaf, 1]
    return (low + high) / 2 + aside * (high - low) / 2, leaves.limits[leaf]


def beside(
    forest: Forest, points: Array, leaf: Indices, xi: Array, point: Indices, other: Indices
) -> tuple[Mask, Mask]:
    """Tell which leaves need no start of their own.

    The squared distance is convex over a rectangle of leaves where it is over each, as long as no kink parts them.

    Parameters
    ----------
    points : (q, 3)
    leaf : (q,)
        Where a descent began.
    xi : (q, 2)
        Where it ended, with no kink between.
    point, other : (pairs,)
        Leaves that may hold something nearer.

    Returns
    -------
    known : (pairs,)
        Whether the leaf holds no minimum but that found.
    convex : (pairs,)
        Whether it holds one minimum at most.
    """
    leaves = forest.leaves
    place = np.empty_like(xi, dtype=np.int64)
    for number, edges in enumerate(forest.edges):
        own = leaves.surface[leaf] == number
        place[own] = np.stack([np.searchsorted(edges[d], xi[own, d], side="right") - 1 for d in range(2)], axis=1)
    place = np.clip(place, leaves.smooth[leaf, 0], leaves.smooth[leaf, 1])
    columns = np.array([len(edges[1]) - 1 for edges in forest.edges])[leaves.surface[leaf]]
    rows, along = (place - leaves.place[leaf]).T
    foot = (leaf + rows * columns + along)[point]
    convex = _is_convex(leaves.hessians[other], points[point])
    known = (leaves.surface[foot] == leaves.surface[other]) & convex
    known &= (leaves.smooth[foot] == leaves.smooth[other]).all(axis=(1, 2))
    known &= (np.abs(leaves.place[foot] - leaves.place[other]) <= 1).all(axis=1)
    near = np.flatnonzero(known)
    across = leaves.place[other[near], 1] - leaves.place[foot[near], 1]
    for corner in (foot[near], foot[near] + across, other[near] - across):  # with `other` itself, a rectangle
        known[near] &= _is_convex(leaves.hessians[corner], points[point[near]])
    return known, convex
