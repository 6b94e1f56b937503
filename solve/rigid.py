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


class Piece(NamedTuple):
    """A body, or what hangs together of one whose patches are not all glued to each other."""

    name: str
    control_points: Indices  # global numbers


def find_pieces(space: Space) -> tuple[Piece, ...]:
    """Find what can move by itself, body by body."""
    patches = list(space.model.patches)
    glued = [[patches.index(face.patch) for face in (pair.first, pair.second)] for pair in space.model.glued]
    numbers, _ = united(np.array(glued, dtype=np.int64).reshape(-1, 2).T, len(patches))
    clusters = dict(zip(patches, numbers.tolist(), strict=True))
    pieces = []
    for body, names in space.model.bodies.items():
        for cluster in dict.fromkeys(clusters[name] for name in names):
            inside = [name for name in names if clusters[name] == cluster]
            apart = f'the piece of body "{body}" with patch "{inside[0]}", not glued to the rest of the body,'
            of_piece = np.unique(np.concatenate([space.numbers[name] for name in inside]))
            pieces.append(Piece(f'body "{body}"' if len(inside) == len(names) else apart, of_piece))
    return tuple(pieces)


def rigid_modes(space: Space) -> Array:
    """Make the rigid displacements (dofs, 6 pieces): 3 slides and 3 turns about the centre of each, of size 1."""
    pieces, points = find_pieces(space), space.control_points
    modes = np.zeros((space.size, 3, 6 * len(pieces)))
    for number, (_, of_piece) in enumerate(pieces):
        arm = points[of_piece] - points[of_piece].mean(axis=0)
        arm /= np.linalg.norm(arm, axis=1).max()
        for i, axis in enumerate(np.eye(3)):
            modes[of_piece, :, 6 * number + i] = axis
            modes[of_piece, :, 6 * number + 3 + i] = np.cross(axis, arm)
    return modes.reshape(space.dofs, -1)


def unsupported(modes: Array, conditions: Conditions) -> Array:
    """Combine rigid modes (dofs, k) to those (dofs, f) that the supports do not resist."""
    return modes @ kernel(_prescribed(modes, conditions))


def _prescribed(modes: Array, conditions: Conditions) -> Array:
    """Components (c, k) of modes (dofs, k) that the supports prescribe."""
    at = modes.reshape(-1, 3, modes.shape[1])[conditions.control_points]
    return np.einsum("ci,cik->ck", conditions.directions, at)


def check_held(space: Space, conditions: Conditions, mortar: Mortar) -> None:
    """Raise CaseError that names the bodies and their free motions, contact taken as closed and tied."""
    modes = rigid_modes(space)
    supported = _prescribed(modes, conditions)
    free = kernel(np.concatenate([supported, (mortar.gap_operator @ modes) / mortar.area[:, None]]))
    sentences = []
    for number, piece in enumerate(find_pieces(space)):
        motions = _describe(free[6 * number : 6 * number + 6])
        if motions:
            sentences.append(f"{piece.name} can {motions}")
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
        motion = (rigid @ found.x).reshape(-1, 3)
        moved = max(find_pieces(space), key=lambda piece: np.abs(motion[piece.control_points]).max())
        raise CaseError(
            f"the loads pull {moved.name} off its contact and nothing else holds it: turn the loads or add a support"
        )


def kernel(matrix: Array) -> Array:
    """Orthonormal basis (k, f) of the vectors that a matrix (r, k) takes to zero."""
    columns = matrix.shape[1]
    if columns == 0:
        return np.empty((0, 0))
    triangle = np.linalg.qr(matrix, mode="r") if len(matrix) > columns else matrix
    _, values, rows = np.linalg.svd(np.concatenate([triangle, np.zeros((columns, columns))]))
    return rows[values <= NEGLIGIBLE * max(values[0], 1.0)].T


def _describe(motions: Array) -> str:
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
