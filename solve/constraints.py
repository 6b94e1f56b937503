"""Supports and prescribed displacements as one affine map u = map @ free + offset."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array

from geom2iga.bspline import Array, Indices, Mask
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
    points, places = np.unique(conditions.control_points, return_inverse=True)
    normal, right = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
    np.add.at(normal, places, np.einsum("ci,cj->cij", conditions.directions, conditions.directions))
    np.add.at(right, places, conditions.directions * conditions.values[:, None])
    strength, axes = np.linalg.eigh(normal)
    held = strength > PARALLEL
    inverse = np.where(held, 1 / np.where(held, strength, 1), 0)
    offset = np.zeros((space.size, 3))
    offset[points] = np.einsum("nik,nk,njk,nj->ni", axes, inverse, axes, right)
    _check_compatible(space, conditions, supports, offset)
    return AffineMap(_free_directions(space, points, axes, ~held), offset.ravel())


def _free_directions(space: Space, points: Indices, axes: Array, free: Mask) -> csr_array:
    """Which of the axes (c, 3, 3), as columns, of some control points (c,) are free (c, 3); of all others all are."""
    counts = np.full(space.size, 3)
    counts[points] = free.sum(axis=1)
    first = np.cumsum(counts) - counts
    others = np.delete(np.arange(space.size), points)
    place, axis = np.nonzero(free)
    rank = (np.cumsum(free, axis=1) - 1)[place, axis]
    rows = [3 * others[:, None] + np.arange(3), 3 * points[place, None] + np.arange(3)]
    columns = [first[others, None] + np.arange(3), np.repeat(first[points[place], None] + rank[:, None], 3, axis=1)]
    values = [np.ones(3 * len(others)), axes[place, :, axis].ravel()]
    where = tuple(np.concatenate([part.ravel() for part in parts]) for parts in (rows, columns))
    matrix = coo_array((np.concatenate(values), where), shape=(space.dofs, int(counts.sum()))).tocsr()
    matrix.eliminate_zeros()
    return matrix


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
