"""Fast diagonalisation: the inverse of a patch's stiffness, for a map straightened out, in closed form.

In a frame that turns with the map, each displacement component of an orthotropic block has a stiffness of the form
K1 x M2 x M3 + M1 x K2 x M3 + M1 x M2 x K3. Three small generalised eigenproblems diagonalise it (Lynch, Rice & Thomas
1964; for splines Sangalli & Tani 2016). The map and the coupling of the components are left to conjugate gradients.
"""

from collections.abc import Callable, Sequence
from math import prod
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike
from scipy.linalg import eigh

from geom2iga.bspline import Array, Mask, greville
from geom2iga.patch import Face, Patch, evaluate
from solve.bricks import Floats, line
from solve.material import Material
from solve.rules import gauss_rule

SAMPLED = 12  # places per direction where the map is looked at
LEAST = 1e-6  # coefficients below this fraction of their mean are those of degenerate places
RIGID = 1e-9  # eigenvalues below this fraction of the largest are those of motions without energy
FLOATING = 0.5  # value given to motions without energy, over the smallest one with energy


class Diagonal(NamedTuple):
    """One component of a patch: its stiffness is diagonal in the bases of the three directions."""

    bases: tuple[Floats, Floats, Floats]  # (n_d, k_d), functions to modes; rows of fixed functions are zero
    values: Floats  # (k_1, k_2, k_3), positive

    def rounded(self, precision: DTypeLike) -> "Diagonal":
        """The same in another precision."""
        first, second, third = (basis.astype(precision) for basis in self.bases)
        return Diagonal((first, second, third), self.values.astype(precision))

    def modes(self, forces: Floats) -> Floats:
        """Displacements in modes, (k_1, k_2, k_3), under forces (n_1, n_2, n_3)."""
        return _transformed(forces, [basis.T for basis in self.bases]) / self.values

    def displacements(self, modes: Floats) -> Floats:
        """Displacements (n_1, n_2, n_3) from modes."""
        return _transformed(modes, self.bases)

    def pushed(self, face: Face, forces: Floats) -> Floats:
        """Displacements in modes under forces (n_a, n_b) on the control points of a face."""
        ends = [end.T for end in self._ends(face)]
        return _transformed(np.expand_dims(forces, face.axis), ends, (*face.axes, face.axis)) / self.values

    def traced(self, face: Face, modes: Floats) -> Floats:
        """Displacements (n_a, n_b) of the control points of a face from modes."""
        return _transformed(modes, self._ends(face), (face.axis, *face.axes)).squeeze(face.axis)

    def between(self, one: Face, other: Face) -> Array:
        """Displacements of the control points of one face under unit forces on those of another, or the same, dense."""
        rows, columns = self._ends(one), self._ends(other)
        found = np.einsum("ijk,ai,bj,ck,di,ej,fk->abcdef", 1 / self.values, *rows, *columns, optimize="greedy")
        return found.reshape(prod(found.shape[:3]), prod(found.shape[3:]))

    def face_modes(self, face: Face) -> "FaceModes":
        """Modes of a face."""
        first, second = (self.bases[axis] for axis in face.axes)
        across = np.moveaxis(1 / self.values, face.axis, -1)
        return FaceModes(first, second, across @ self.bases[face.axis][-face.side] ** 2)

    def _ends(self, face: Face) -> list[Floats]:
        """Bases, of the direction across a face only the row of its functions."""
        return [b[-face.side][None] if d == face.axis else b for d, b in enumerate(self.bases)]


class FaceModes(NamedTuple):
    """Modes of a face of a patch, orthonormal in its mass matrix."""

    first: Floats  # (n_a, k_a)
    second: Floats  # (n_b, k_b)
    mobility: Floats  # (k_a, k_b) what a force in a mode moves it by

    def softened(self, softness: float) -> "FaceModes":
        """With springs between two such faces, of a softness [length/stress]."""
        return self._replace(mobility=(softness + 2 * self.mobility).astype(self.mobility.dtype))

    def solved(self, gap: Floats) -> Floats:
        """Forces (n_a n_b,) that close gaps (n_a n_b,) of mean values."""
        modes = self.first.T @ gap.reshape(len(self.first), -1) @ self.second
        return (self.first @ (modes / self.mobility) @ self.second.T).ravel()


def _transformed(grid: Floats, matrices: Sequence[Floats], sequence: Sequence[int] = (0, 1, 2)) -> Floats:
    """Multiply a matrix into each axis of a grid, in the given sequence."""
    for axis in sequence:
        matrix = matrices[axis]
        if axis == 0:
            rest = grid.shape[1:]
            grid = (matrix @ grid.reshape(grid.shape[0], prod(rest))).reshape(len(matrix), *rest)
        else:
            grid = np.matmul(matrix, grid) if axis == 1 else np.matmul(grid, matrix.T)
    return grid


class Line(NamedTuple):
    """Matrices of one direction."""

    stiffness: Array  # (n, n)
    mass: Array  # (n, n)


def straightened(patch: Patch, material: Material) -> list[list[Line]]:
    """Matrices of each component and direction; products of functions of one direction replace the coefficients."""
    count = 1 if patch.is_affine else SAMPLED
    at = [np.linspace(b[0], b[-1], 2 * count + 1)[1::2] for b in patch.breaks]
    return [_lines(patch, at, logs) for logs in np.log(_coefficients(patch, material, at))]


def _coefficients(patch: Patch, material: Material, at: Sequence[Array]) -> Array:
    """What multiplies (du_i/dxi_α)² in the energy, on a grid of points in the local frame: (3, 3, n_1, n_2, n_3)."""
    jacobians = _jacobians(patch, at)
    inverse = np.linalg.pinv(np.swapaxes(rotations(jacobians), -1, -2) @ jacobians)  # (..., α, i)
    lame, shear = material.lame
    lengths = np.sum(inverse**2, axis=-1)[..., :, None]
    volume = np.abs(np.linalg.det(jacobians))[..., None, None]
    found = np.moveaxis(((lame + shear) * inverse**2 + shear * lengths) * volume, (-1, -2), (0, 1))
    return np.maximum(found, LEAST * found.mean(axis=(2, 3, 4), keepdims=True))


def _lines(patch: Patch, at: Sequence[Array], logs: Array) -> list[Line]:
    """Matrices of the three directions of a component from the logarithms of its coefficients."""
    means, lines = logs.mean(axis=(1, 2, 3)), []
    for d in range(3):
        deviations = logs.mean(axis=tuple(1 + other for other in range(3) if other != d)) - means[:, None]
        piece = line(patch.knots[d], patch.degrees[d], gauss_rule(patch.knots[d], patch.degrees[d] + 1))
        stiffness = _gram(piece.slopes, piece.weights, np.interp(piece.points, at[d], means[d] + deviations[d]))
        mass = np.delete(deviations, d, axis=0).mean(axis=0)
        lines.append(Line(stiffness, _gram(piece.values, piece.weights, np.interp(piece.points, at[d], mass))))
    return lines


def diagonal_of(lines: Sequence[Line], fixed: Mask, typical: Callable[[Sequence[float]], float] = min) -> Diagonal:
    """Diagonalise a component.

    Parameters
    ----------
    lines : three Line
        Matrices of the directions.
    fixed : (3, 2) bool
        Whether it is fixed at the ends of each direction.
    typical : function
        What motions cost that have no energy: of the directions' smallest energies.
    """
    bases: list[Array] = []
    values: list[Array] = []
    least: list[float] = []
    for matrices, (first, last) in zip(lines, fixed, strict=True):
        size = len(matrices.stiffness)
        free = slice(int(first), size - int(last))
        count = len(matrices.stiffness[free])
        found, modes = eigh(*(matrix[free, free] for matrix in matrices)) if count else (np.empty(0), np.empty((0, 0)))
        bases.append(np.zeros((size, count)))
        bases[-1][free] = modes
        values.append(found)
        least.extend(found[:2][found[:2] > RIGID * found[-1:]][:1])
    total = values[0][:, None, None] + values[1][:, None] + values[2]
    return Diagonal((bases[0], bases[1], bases[2]), np.maximum(total, FLOATING * typical(least or [1.0])))


def _gram(tables: Floats, weights: Floats, logs: Array) -> Array:
    """Integrals (n, n) of products of functions (q, n), times a coefficient whose logarithms (q,) are given."""
    return (tables.T * (weights * np.exp(logs))) @ tables


def _jacobians(patch: Patch, at: Sequence[Array]) -> Array:
    """Jacobians on a grid of parametric points, (n_1, n_2, n_3, 3, 3)."""
    xi = np.stack(np.meshgrid(*at, indexing="ij"), axis=-1)
    return evaluate(patch, xi.reshape(-1, 3), 1)[1].reshape(*xi.shape, 3)


def local_frames(patch: Patch) -> Array:
    """Rotations (n, 3, 3) that follow the map at the Greville points of the control points, (1, 3, 3) for all of a box.

    Column i points along parametric direction i.
    """
    if patch.is_affine:
        at = [breaks[:1] for breaks in patch.breaks]
    else:
        at = [greville(*along) for along in zip(patch.knots, patch.degrees, strict=True)]
    return rotations(_jacobians(patch, at)).reshape(-1, 3, 3)


def rotations(jacobians: Array) -> Array:
    """Rotations nearest to Jacobians (..., 3, 3) whose columns are scaled to length 1."""
    lengths = np.linalg.norm(jacobians, axis=-2, keepdims=True)
    left, _, right = np.linalg.svd(jacobians / np.where(lengths > 0, lengths, 1.0))
    return left @ right
