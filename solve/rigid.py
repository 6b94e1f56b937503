"""Rigid motions: which of them supports and contact leave free."""

import numpy as np
from scipy.optimize import linprog

from geom2iga.bspline import Array
from geom2iga.errors import CaseError
from solve.constraints import Conditions
from solve.contact.mortar import Mortar
from solve.space import Space

NEGLIGIBLE = 1e-9  # singular values below this fraction of the largest, or of 1, count as zero


def rigid_modes(space: Space) -> Array:
    """Make the rigid displacements (dofs, 6 bodies): 3 slides and 3 turns about the centre per body, each of size 1."""
    modes = np.zeros((space.size, 3, 6 * len(space.model.bodies)))
    points = space.control_points
    for number, body in enumerate(space.model.bodies):
        of_body = space.body_numbers(body)
        arm = points[of_body] - points[of_body].mean(axis=0)
        arm /= np.linalg.norm(arm, axis=1).max()
        for i, axis in enumerate(np.eye(3)):
            modes[of_body, :, 6 * number + i] = axis
            modes[of_body, :, 6 * number + 3 + i] = np.cross(axis, arm)
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
    for number, body in enumerate(space.model.bodies):
        motions = _describe(free[6 * number : 6 * number + 6])
        if motions:
            sentences.append(f'body "{body}" can {motions}')
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
        moved = max(space.model.bodies, key=lambda body: np.abs(motion[space.body_numbers(body)]).max())
        raise CaseError(
            f'the loads pull body "{moved}" off its contact and nothing else holds it: turn the loads or add a support'
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
