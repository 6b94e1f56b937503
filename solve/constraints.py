"""Supports and prescribed displacements as one affine map u = map @ free + offset."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array

from geom2iga.bspline import Array, Indices
from geom2iga.errors import CaseError
from geom2iga.patch import Face
from solve.case import Support
from solve.face import CurvedError, find_plane, surface_of
from solve.space import Space

PARALLEL = 1e-12  # squared sine below which two prescribed directions are one


@dataclass(frozen=True, eq=False)
class Conditions:
    """Prescribed displacement components: direction·u = value at a control point.

    Parameters
    ----------
    control_points : (c,)
        Global numbers; one may stand several times, with other directions.
    directions : (c, 3)
        Unit vectors.
    values : (c,)
        [length]
    sources : (c,)
        Number of the support that asks for it.
    """

    control_points: Indices
    directions: Array
    values: Array
    sources: Indices


@dataclass(frozen=True, eq=False)
class AffineMap:
    """u = matrix @ free + offset: all displacements that the supports allow.

    Parameters
    ----------
    matrix : (dofs, free)
        Orthonormal columns.
    offset : (dofs,)
        Prescribed part [length].
    """

    matrix: csr_array
    offset: Array

    @property
    def size(self) -> int:
        """Number of free unknowns."""
        return self.matrix.shape[1]


def find_conditions(space: Space, supports: Sequence[Support]) -> Conditions:
    """Collect what the supports prescribe.

    Raises
    ------
    CaseError
        An unknown face; a normal support on a curved face.
    """
    points, directions, values, sources = [], [], [], []
    for number, support in enumerate(supports):
        try:
            for face in space.model.faces(support.on):
                numbers = space.face_numbers(face)
                prescribed = list(zip(np.eye(3), (support.ux, support.uy, support.uz), strict=True))
                if support.normal is not None:
                    prescribed.append((_plane_normal(space, face), support.normal))
                for direction, value in prescribed:
                    if value is not None:
                        points.append(numbers)
                        directions.append(np.broadcast_to(direction, (len(numbers), 3)))
                        values.append(np.full(len(numbers), value))
                        sources.append(np.full(len(numbers), number))
        except CaseError as error:
            raise CaseError(f"solve.support[{number}]: {error}") from None
    if not points:
        return Conditions(np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty(0), np.empty(0, dtype=np.int64))
    return Conditions(*(np.concatenate(part) for part in (points, directions, values, sources)))


def _plane_normal(space: Space, face: Face) -> Array:
    """Outward unit normal (3,) of a plane face."""
    try:
        return find_plane(surface_of(space.model, face)).normal
    except CurvedError as error:
        raise CaseError(f"{error}, but a normal support needs plane faces: prescribe ux, uy or uz there") from None


def constrain(space: Space, conditions: Conditions, supports: Sequence[Support]) -> AffineMap:
    """Solve the conditions of each control point: its normal equations' kernel stays free.

    Raises
    ------
    CaseError
        Two supports that ask for different displacements of one control point.
    """
    normal = np.zeros((space.size, 3, 3))
    right = np.zeros((space.size, 3))
    np.add.at(
        normal,
        conditions.control_points,
        np.einsum("ci,cj->cij", conditions.directions, conditions.directions),
    )
    np.add.at(right, conditions.control_points, conditions.directions * conditions.values[:, None])
    strength, axes = np.linalg.eigh(normal)
    held = strength > PARALLEL
    inverse = np.where(held, 1 / np.where(held, strength, 1), 0)
    offset = np.einsum("nik,nk,njk,nj->ni", axes, inverse, axes, right)
    _check_compatible(space, conditions, supports, offset)
    point, axis = np.nonzero(~held)
    rows = (3 * point[:, None] + np.arange(3)).ravel()
    columns = np.repeat(np.arange(len(point)), 3)
    matrix = coo_array((axes[point, :, axis].ravel(), (rows, columns)), shape=(space.dofs, len(point))).tocsr()
    matrix.eliminate_zeros()
    return AffineMap(matrix, offset.ravel())


def _check_compatible(space: Space, conditions: Conditions, supports: Sequence[Support], offset: Array) -> None:
    """Raise CaseError where the prescribed displacements contradict each other."""
    miss = np.abs(np.sum(conditions.directions * offset[conditions.control_points], axis=1) - conditions.values)
    if miss.max(initial=0.0) > 1e-9 * np.abs(conditions.values).max(initial=0.0):
        worst = np.argmax(miss)
        point = conditions.control_points[worst]
        along = np.abs(conditions.directions @ conditions.directions[worst]) > 1e-9
        numbers = np.unique(conditions.sources[(conditions.control_points == point) & along])
        names = " and ".join(f'solve.support[{n}] on "{supports[n].on}"' for n in numbers)
        at = ", ".join(f"{x:.4g}" for x in space.control_points[point])
        verb = "ask" if len(numbers) > 1 else "asks"
        raise CaseError(f"{names} {verb} for different displacements of the control point at ({at})")
