"""Where in a volume a point lies: its parametric point.

Boxes around the control points of the spans, joined in a tree, tell which spans may hold a point. Newton's method from
the nearest of them finds nearly all; for the others every span whose Bernstein coefficients do not rule it out is a
start of its own.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from itertools import product
from typing import NamedTuple

import numpy as np

from geom2iga import bspline
from geom2iga.bspline import Array, Indices, Mask, find_spans
from geom2iga.errors import CaseError, suggestion
from geom2iga.model import Model
from geom2iga.patch import Patch, chunks, evaluate, refined, resolution

TOLERANCE = 1e-9  # distance from the volume, in sizes of it, up to which a point lies in it
FEWEST = 8  # pieces per direction that a volume is cut into at least
MOST_STEPS = 30
ROUNDING = 1e-13  # a step of this fraction of the parameter range is the last one
SINGULAR = 1e-12  # singular values of a Jacobian below this fraction of the largest count as none
SEARCHED = 2_048  # points at a time
TESTED = 200_000  # Bernstein coefficients at a time


class Tree(NamedTuple):
    """The pieces of a volume: its spans, or what they are cut into."""

    patch: Patch  # cut into the pieces
    breaks: tuple[Array, ...]
    spans: tuple[Indices, ...]  # knot index of the pieces of each direction
    boxes: list[Array]  # (s_1, s_2, s_3, 2, 3) lower and upper corners, of the pieces and then of ever more together
    tolerance: float  # [length]


def locate(patch: Patch, points: Array) -> tuple[Mask, Array]:
    """Find the parametric points of points in a volume.

    Parameters
    ----------
    points : (q, 3)
        Positions [length].

    Returns
    -------
    found : (q,) bool
        Whether the volume holds the point, its border included.
    xi : (q, 3)
        Not a number where it does not.
    """
    origin = patch.control_points[0, 0, 0]  # differences from it, so that a place far away costs no digits
    tolerance, points = _tolerance(patch), points - origin
    tree = _plant(replace(patch, control_points=patch.control_points - origin), tolerance)
    found, xi = np.zeros(len(points), dtype=bool), np.full((len(points), 3), np.nan)
    for part in chunks(len(points), SEARCHED):
        found[part], xi[part] = _locate_some(tree, points[part])
    return found, xi


def find_in_model(model: Model, points: Array, body: str | None = None) -> tuple[Indices, Array]:
    """Find the first patch that holds each point, and the parametric point in it.

    Parameters
    ----------
    points : (q, 3)
        Positions [length].
    body : str
        Whose patches to look at; left out, those of all bodies.

    Returns
    -------
    number : (q,)
        Of the patch in the model's sequence; -1 where no patch holds the point.
    xi : (q, 3)
        Not a number there.

    Raises
    ------
    CaseError
        An unknown body.
    """
    if body is not None and body not in model.bodies:
        raise CaseError(f'there is no body "{body}"; {suggestion(body, model.bodies)}')
    numbers, xi = np.full(len(points), -1), np.full((len(points), 3), np.nan)
    for number, (name, patch) in enumerate(model.patches.items()):
        if body is not None and model.body_of(name) != body:
            continue
        near = np.flatnonzero((numbers < 0) & _in_box(patch, points))
        if near.size:
            found, places = locate(patch, points[near])
            numbers[near[found]], xi[near[found]] = number, places[found]
    return numbers, xi


def _tolerance(patch: Patch) -> float:
    """Distance from a volume up to which a point lies in it [length]."""
    points = patch.control_points.reshape(-1, 3)
    return TOLERANCE * float(np.ptp(points, axis=0).max()) + resolution(points)


def _in_box(patch: Patch, points: Array) -> Mask:
    """Whether points (q, 3) lie in the box around the control points."""
    corners, slack = patch.control_points.reshape(-1, 3), _tolerance(patch)
    return ((points >= corners.min(axis=0) - slack) & (points <= corners.max(axis=0) + slack)).all(axis=1)


def _plant(patch: Patch, tolerance: float) -> Tree:
    """Cut a volume into pieces, put boxes around them, and join these in twos along each direction, up to one."""
    fine = refined(patch, knots=[_cuts(at) for at in patch.breaks])
    spans = []
    lower = upper = fine.control_points
    for axis, (knots, degree, at) in enumerate(zip(fine.knots, fine.degrees, fine.breaks, strict=True)):
        spans.append(find_spans(knots, degree, at[:-1]))
        members = [spans[axis] - degree + a for a in range(degree + 1)]
        lower = reduce(np.minimum, (np.take(lower, numbers, axis=axis) for numbers in members))
        upper = reduce(np.maximum, (np.take(upper, numbers, axis=axis) for numbers in members))
    boxes = [np.stack([lower - tolerance, upper + tolerance], axis=-2)]
    while boxes[-1].size > 6:
        boxes.append(_joined(boxes[-1]))
    return Tree(fine, fine.breaks, tuple(spans), boxes, tolerance)


def _cuts(at: Array) -> Array:
    """Points that cut the spans between breaks (s + 1,) into pieces, FEWEST of them or more."""
    count = -(-FEWEST // (len(at) - 1))
    return (at[:-1, None] + np.diff(at)[:, None] * np.arange(1, count) / count).ravel()


def _joined(boxes: Array) -> Array:
    """Boxes (s_1, s_2, s_3, 2, 3) around twos of neighbours in each direction; an odd last one stays alone."""
    lower, upper = boxes[..., 0, :], boxes[..., 1, :]
    for axis in range(3):
        firsts = np.arange(0, lower.shape[axis], 2)
        lower = np.minimum.reduceat(lower, firsts, axis=axis)
        upper = np.maximum.reduceat(upper, firsts, axis=axis)
    return np.stack([lower, upper], axis=-2)


def _candidates(tree: Tree, points: Array) -> tuple[Indices, Indices]:
    """Find the pieces whose boxes hold points: point (pairs,), and the place (pairs, 3) of the piece."""
    point, place = np.arange(len(points)), np.zeros((len(points), 3), dtype=np.int64)
    corners = np.array(list(product((0, 1), repeat=3)))
    for level, boxes in enumerate(reversed(tree.boxes)):
        if level:
            point = np.repeat(point, len(corners))
            place = (2 * place[:, None] + corners).reshape(-1, 3)
            there = (place < boxes.shape[:3]).all(axis=1)
            point, place = point[there], place[there]
        box, at = boxes[tuple(place.T)], points[point]
        kept = ((box[:, 0] <= at) & (at <= box[:, 1])).all(axis=1)
        point, place = point[kept], place[kept]
    return point, place


def _locate_some(tree: Tree, points: Array) -> tuple[Mask, Array]:
    """As `locate`, for so many points that all their candidates fit into memory."""
    found, xi = np.zeros(len(points), dtype=bool), np.full((len(points), 3), np.nan)
    point, place = _candidates(tree, points)
    away = np.linalg.norm(tree.boxes[0][tuple(place.T)].mean(axis=1) - points[point], axis=1)
    order = np.lexsort((away, point))
    point, place = point[order], place[order]
    nearest = np.flatnonzero(np.diff(point, prepend=-1))
    for tries in (nearest, None):
        if tries is None:
            left = np.flatnonzero(~found[point])
            tries = left[_may_hold(tree, points[point[left]], place[left])]
        places, distance = _descend(tree, points[point[tries]], place[tries])
        hits = np.flatnonzero(distance <= tree.tolerance)[::-1]  # the nearest comes last, and stays
        found[point[tries[hits]]] = True
        xi[point[tries[hits]]] = places[hits]
    return found, xi


def _may_hold(tree: Tree, points: Array, place: Indices) -> Mask:
    """(m,) whether a piece may hold its point, by signs of Bernstein coefficients along three oblique directions.

    With w > 0, x(xi) = X means sum_a B_a w_a (P_a - X) = 0: no linear form of the w_a (P_a - X) has one sign. The three
    forms are those that make the sides of the piece a unit cube, so that they rule out nearly all that can be.
    """
    extractions = [_extraction(*pair) for pair in zip(tree.patch.knots, tree.patch.degrees, strict=True)]
    width = int(np.prod([p + 1 for p in tree.patch.degrees]))
    kept = np.zeros(len(points), dtype=bool)
    for part in chunks(len(points), max(1, TESTED // width)):
        values = _coefficients(tree, points[part], place[part], extractions)
        inner = tuple(range(1, 4))
        sides = [
            np.take(values, -1, axis=axis).mean(axis=(1, 2)) - np.take(values, 0, axis=axis).mean(axis=(1, 2))
            for axis in inner
        ]
        forms = np.linalg.pinv(np.stack([side[:, :3] for side in sides], axis=2), SINGULAR)
        along = np.einsum("mdk,mabck->mabcd", forms, values[..., :3])
        slack = tree.tolerance * np.linalg.norm(forms, axis=2) * values[..., 3].max(axis=inner)[:, None]
        kept[part] = ((along.min(axis=inner) <= slack) & (along.max(axis=inner) >= -slack)).all(axis=1)
    return kept


def _coefficients(tree: Tree, points: Array, place: Indices, extractions: Sequence[Array]) -> Array:
    """Bernstein coefficients (m, a, b, c, 4) of w (x - X) and w over pieces, one for each of the points X (m, 3)."""
    members = [tree.spans[d][place[:, d], None] + np.arange(-p, 1) for d, p in enumerate(tree.patch.degrees)]
    index = members[0][:, :, None, None], members[1][:, None, :, None], members[2][:, None, None, :]
    weights = tree.patch.weights[index][..., None]
    offset = tree.patch.control_points[index] - points[:, None, None, None]
    values = np.concatenate([offset * weights, weights], axis=-1)
    one, two, three = (matrices[place[:, d]] for d, matrices in enumerate(extractions))
    return np.einsum("mai,mbj,mck,mijkl->mabcl", one, two, three, values, optimize=True)


def _extraction(knots: Array, degree: int) -> Array:
    """Matrices (s, p + 1, p + 1) that take the coefficients of each span to Bernstein's."""
    matrix, spans = bspline.extraction(knots, degree).toarray(), find_spans(knots, degree, bspline.breaks(knots)[:-1])
    rows = degree * np.arange(len(spans))[:, None] + np.arange(degree + 1)
    columns = spans[:, None] + np.arange(-degree, 1)
    return matrix[rows[:, :, None], columns[:, None, :]]


def _descend(tree: Tree, points: Array, place: Indices) -> tuple[Array, Array]:
    """Go from the middles of pieces (m, 3) towards points (m, 3), by Gauss & Newton's steps that shorten the distance.

    Returns
    -------
    xi : (m, 3)
    distance : (m,)
        That is left [length].
    """
    low, high = (np.array([at[end] for at in tree.breaks]) for end in (0, -1))
    trial = np.stack([(at[:-1] + at[1:])[place[:, d]] / 2 for d, at in enumerate(tree.breaks)], axis=1)
    xi, step, distance = trial.copy(), np.zeros(trial.shape), np.full(len(points), np.inf)
    active = np.arange(len(points))
    for _ in range(MOST_STEPS):
        value, jacobian = evaluate(tree.patch, trial[active], 1)
        rest = points[active] - value
        away = np.linalg.norm(rest, axis=1)
        nearer = away < distance[active]
        moved, stayed = active[nearer], active[~nearer]
        xi[moved], distance[moved] = trial[moved], away[nearer]
        step[moved] = _step(jacobian[nearer], rest[nearer], xi[moved] - low, high - xi[moved])
        step[stayed] /= 2
        active = active[(np.abs(step[active]) > ROUNDING * (high - low)).any(axis=1)]
        if not active.size:
            break
        trial[active] = _held(xi[active] + step[active], low, high)
    return xi, distance


def _held(xi: Array, low: Array, high: Array) -> Array:
    """Keep parametric points (m, 3) within limits (3,); what rounding alone parts from a limit lies on it."""
    border = ROUNDING * (high - low)
    return np.where(xi <= low + border, low, np.where(xi >= high - border, high, xi))


def _step(jacobian: Array, rest: Array, below: Array, above: Array) -> Array:
    """Steps (m, 3) that take most of the rest (m, 3) away, shortened to the room (m, 3) below and above.

    A direction that pushes out where no room is left is left out.
    """
    step = np.zeros(rest.shape)
    free, turn = np.ones(rest.shape, dtype=bool), np.arange(len(rest))
    for _ in range(rest.shape[1]):
        inverse = np.linalg.pinv(jacobian[turn] * free[turn, None], SINGULAR)
        step[turn] = np.einsum("mdk,mk->md", inverse, rest[turn])
        out = np.where(step[turn] < 0, below[turn] == 0, (above[turn] == 0) & (step[turn] > 0))
        free[turn] &= ~out
        turn = turn[out.any(axis=1)]
        if not turn.size:
            break
    step[~free] = 0.0
    room = np.where(step < 0, below, above)
    return step * np.where(np.abs(step) > room, room / np.where(step == 0, 1.0, np.abs(step)), 1.0).min(axis=1)[:, None]
