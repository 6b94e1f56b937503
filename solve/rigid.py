"""Rigid motions: which of them supports and contact leave free."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from geom2iga.bspline import Array, Indices
from geom2iga.errors import CaseError
from solve.constraints import Conditions
from solve.contact.mortar import Mortar
from solve.space import Space, united

NEGLIGIBLE = 1e-9  # singular values below this fraction of the largest, or of 1, count as zero


class Pieces(NamedTuple):
    """What can move by itself: a body, or what hangs together of one whose patches are not all glued to each other."""

    names: tuple[str, ...]
    owner: Indices  # (n,) piece of each control point
    arm: Array  # (n, 3) from the centre of the piece, in units of the longest


def find_pieces(space: Space) -> Pieces:
    """Find what can move by itself, body by body."""
    patches = list(space.model.patches)
    glued = [[patches.index(face.patch) for face in (pair.first, pair.second)] for pair in space.model.glued]
    numbers, _ = united(np.array(glued, dtype=np.int64).reshape(-1, 2).T, len(patches))
    clusters = dict(zip(patches, numbers.tolist(), strict=True))
    pieces, owner = list[str](), np.zeros(space.size, dtype=np.int64)
    for body, names in space.model.bodies.items():
        for cluster in dict.fromkeys(clusters[name] for name in names):
            inside = [name for name in names if clusters[name] == cluster]
            apart = f'the piece of body "{body}" with patch "{inside[0]}", not glued to the rest of the body,'
            for name in inside:
                owner[space.numbers[name]] = len(pieces)
            pieces.append(f'body "{body}"' if len(inside) == len(names) else apart)
    points, size = space.control_points, np.zeros(len(pieces))
    centre = np.stack([np.bincount(owner, x) for x in points.T], axis=1) / np.bincount(owner)[:, None]
    arm = points - centre[owner]
    np.maximum.at(size, owner, np.linalg.norm(arm, axis=1))
    return Pieces(tuple(pieces), owner, arm / size[owner, None])


def rigid_modes(pieces: Pieces, points: Indices) -> Array:
    """Make the rigid displacements (k, 3, 6 pieces) of some control points (k,).

    For each piece 3 slides and 3 turns about its centre, of size 1.
    """
    modes = np.zeros((len(points), 3, len(pieces.names), 6))
    own, arm = pieces.owner[points], pieces.arm[points]
    for i, axis in enumerate(np.eye(3)):
        modes[np.arange(len(points)), :, own, i] = axis
        modes[np.arange(len(points)), :, own, 3 + i] = np.cross(axis, arm)
    return modes.reshape(len(points), 3, 6 * len(pieces.names))


def unsupported(space: Space, conditions: Conditions) -> Array:
    """Find the rigid motions (dofs, f) that the supports do not resist."""
    pieces = find_pieces(space)
    free = kernel(_prescribed(pieces, conditions))
    motions = np.empty((space.size, 3, free.shape[1]))
    for number, shares in enumerate(free.T):
        slides, turns = np.moveaxis(shares.reshape(-1, 2, 3), 1, 0)
        motions[:, :, number] = slides[pieces.owner] + np.cross(turns[pieces.owner], pieces.arm)
    return motions.reshape(space.dofs, free.shape[1])


def _prescribed(pieces: Pieces, conditions: Conditions) -> Array:
    """Components (c, 6 pieces) of the rigid motions that the supports prescribe."""
    return np.einsum("ci,cik->ck", conditions.directions, rigid_modes(pieces, conditions.control_points))


def check_held(space: Space, conditions: Conditions, mortar: Mortar) -> None:
    """Raise CaseError that names the bodies and their free motions, contact taken as closed and tied."""
    pieces, operator = find_pieces(space), mortar.gap_operator
    touched = np.unique(operator.indices)
    modes = rigid_modes(pieces, touched // 3)[np.arange(len(touched)), touched % 3]
    opening = (operator[:, touched] @ modes) / mortar.area[:, None]
    free = kernel(np.concatenate([_prescribed(pieces, conditions), opening]))
    sentences = []
    for number, name in enumerate(pieces.names):
        motions = describe(free[6 * number : 6 * number + 6])
        if motions:
            sentences.append(f"{name} can {motions}")
    if sentences:
        raise CaseError(f"{'; '.join(sentences)}: add a support")


def check_pressed(space: Space, rigid: Array, mortar: Mortar, load: Array) -> None:
    """Raise CaseError where the loads (dofs,) drive a body along a rigid motion (dofs, k) that only opens contact.

    The energy is bounded from below if and only if no motion z that the supports leave free has G z >= 0 and
    f·z > 0; a linear program in k unknowns finds one.
    """
    if not rigid.shape[1]:
        return
    work, opening = load @ rigid, (mortar.gap_operator @ rigid) / mortar.area[:, None]
    found = linprog(-work, A_ub=-opening, b_ub=np.zeros(len(opening)), bounds=(-1, 1))
    if found.status == 0 and -found.fun > NEGLIGIBLE * np.abs(load).sum():
        motion, pieces = (rigid @ found.x).reshape(-1, 3), find_pieces(space)
        moved = pieces.names[pieces.owner[np.argmax(np.abs(motion).max(axis=1))]]
        raise CaseError(
            f"the loads pull {moved} off its contact and nothing else holds it: turn the loads or add a support"
        )


def kernel(matrix: Array) -> Array:
    """Orthonormal basis (k, f) of the vectors that a matrix (r, k) takes to zero."""
    columns = matrix.shape[1]
    if columns == 0:
        return np.empty((0, 0))
    triangle = np.linalg.qr(matrix, mode="r") if len(matrix) > columns else matrix
    _, values, rows = np.linalg.svd(np.concatenate([triangle, np.zeros((columns, columns))]))
    return rows[values <= NEGLIGIBLE * max(values[0], 1.0)].T


def describe(motions: Array) -> str:
    """Say in words what a space of motions (6, f) of a body, slides before turns, consists of."""
    slides = _span(motions @ kernel(motions[3:]))[:3]
    turns = _span(motions[3:])
    parts = [("slide along", _span(slides)), ("turn about", turns)]
    return " and ".join(f"{verb} {_axes(space)}" for verb, space in parts if space.shape[1])


def _span(vectors: Array) -> Array:
    """Orthonormal basis of the span of columns."""
    if not vectors.size:
        return vectors[:, :0]
    left, values, _ = np.linalg.svd(vectors, full_matrices=False)
    return left[:, values > 1e-6]


def _axes(space: Array) -> str:
    """Name the axes that span a space of directions (3, f): x, y, z where they do, else as vectors."""
    names = [name for name, axis in zip("xyz", np.eye(3), strict=True) if np.linalg.norm(axis @ space) > 1 - 1e-6]
    if len(names) < space.shape[1]:
        names = [f"({', '.join(f'{x:.3g}' for x in direction)})" for direction in space.T]
    return ", ".join(names[:-1]) + (" and " if len(names) > 1 else "") + names[-1]
