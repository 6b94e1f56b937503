"""Harmonic extension: displacements of glued faces continued into the patches that they belong to.

Of all continuations it has the least energy, for the straightened map of fast diagonalisation; a jump from glued faces
to the next control points would cost more the finer the patch is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike
from scipy.sparse import csr_array, hstack

from geom2iga.bspline import Indices, Mask
from solve.bricks import Floats
from solve.fastdiag import Diagonal, Line, diagonal_of
from solve.space import Space


class _Component(NamedTuple):
    """Extension of one component of a patch: with Φ the modes that are zero on all faces around, -Φ Λ^-1 Φ' K."""

    modes: Diagonal
    stiffness: tuple[Floats, ...]  # (k_d, n_d) Φ' K of each direction
    mass: tuple[Floats, ...]  # (k_d, n_d) Φ' M

    def rounded(self, precision: DTypeLike) -> "_Component":
        """The same in another precision."""
        stiffness, mass = ([part.astype(precision) for part in parts] for parts in self[1:])
        return _Component(self.modes.rounded(precision), tuple(stiffness), tuple(mass))

    def extended(self, edge: Floats) -> Floats:
        """Displacements (n_1, n_2, n_3) inside from those of the faces around."""
        (k1, k2, k3), (m1, m2, m3) = self.stiffness, self.mass
        along, across = edge @ k3.T, edge @ m3.T
        plane, other = m2 @ across, m2 @ along + k2 @ across
        return -self.modes.displacements((_first(k1, plane) + _first(m1, other)) / self.modes.values)

    def gathered(self, forces: Floats) -> Floats:
        """Transpose of `extended`."""
        (k1, k2, k3), (m1, m2, m3) = self.stiffness, self.mass
        modes = self.modes.modes(forces)
        plane, other = _first(k1.T, modes), _first(m1.T, modes)
        return -(m2.T @ other @ k3 + (m2.T @ plane + k2.T @ other) @ m3)


def _first(matrix: Floats, grid: Floats) -> Floats:
    """Multiply a matrix into the first axis of a grid."""
    return np.tensordot(matrix, grid, 1)


@dataclass(frozen=True, eq=False)
class PatchExtension:
    """Displacements inside a patch from those of its glued faces.

    Parameters
    ----------
    shape : (3,)
        Control points in each direction.
    numbers : (n,)
        Their global numbers.
    spread : (size, n)
        Adds up what they have.
    frames : (n, 3, 3) or (1, 3, 3)
        Rotations; column i is the direction of component i.
    components : three _Component
    """

    shape: tuple[int, ...]
    numbers: Indices
    spread: csr_array
    frames: Floats
    components: tuple[_Component, ...]

    def extended(self, edge: Floats) -> Floats:
        """Displacements (n, 3) inside from those (size, 3) of all control points, zero but on glued faces."""
        return self._turned([c.extended(grid) for c, grid in zip(self.components, self._local(edge), strict=True)])

    def gathered(self, forces: Floats) -> Floats:
        """Transpose of `extended`, from forces (size, 3) to forces (n, 3), right on glued faces only."""
        return self._turned([c.gathered(grid) for c, grid in zip(self.components, self._local(forces), strict=True)])

    def _local(self, values: Floats) -> Floats:
        """Components (3, n_1, n_2, n_3)."""
        return np.einsum("aji,aj->ia", self.frames, values[self.numbers]).reshape(3, *self.shape)

    def _turned(self, components: Sequence[Floats]) -> Floats:
        """Vectors (n, 3) from components."""
        return np.einsum("aij,ja->ai", self.frames, np.array(components).reshape(3, -1))


def extend(space: Space, name: str, frames: Floats, lines: Sequence[Sequence[Line]], still: Mask) -> PatchExtension:
    """Prepare the extension of a patch, in single precision.

    Parameters
    ----------
    frames : (n, 3, 3) or (1, 3, 3)
    lines : three times three Line
        Of each component and direction.
    still : (3, 3, 2) bool
        Faces on which a component of what is inside is zero.
    """
    components = []
    for directions, ends in zip(lines, still, strict=True):
        modes = diagonal_of(directions, ends)
        pairs = list(zip(modes.bases, directions, strict=True))
        stiffness, mass = ([basis.T @ line[k] for basis, line in pairs] for k in range(2))
        components.append(_Component(modes, tuple(stiffness), tuple(mass)).rounded(np.float32))
    shape, spread = space.model.patches[name].shape, space.spread(name).astype(np.float32)
    return PatchExtension(shape, space.numbers[name], spread, frames.astype(np.float32), tuple(components))


class Extension:
    """E: displacements of glued faces, and their continuation into all patches.

    Parameters
    ----------
    patches : sequence of PatchExtension
    glued : (size,) bool
        Control points of glued faces.
    """

    def __init__(self, patches: Sequence[PatchExtension], glued: Mask) -> None:
        self._patches, self._glued = patches, glued[:, None]
        self._spread = csr_array(hstack([patch.spread for patch in patches]))

    def extended(self, edge: Floats) -> Floats:
        """Displacements (size, 3) from those of glued faces, zero elsewhere."""
        return edge + self._spread @ np.concatenate([patch.extended(edge) for patch in self._patches])

    def gathered(self, forces: Floats) -> Floats:
        """Transpose: forces (size, 3) on glued faces, zero elsewhere."""
        inside = self._spread @ np.concatenate([patch.gathered(forces) for patch in self._patches])
        return (forces + inside) * self._glued
