"""Diagonalised inverses of patches, in frames that follow their maps."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike
from scipy.sparse import csr_array, hstack

from geom2iga.bspline import Array, Indices
from geom2iga.patch import Face
from solve.bricks import Floats
from solve.fastdiag import Diagonal

ALIGNED = 1e-12  # parts of a gap operator below this fraction of the largest are rounding errors of the frames


class Touching(NamedTuple):
    """A face that takes part in contact, without the edges that count for another one."""

    face: Face
    within: Indices  # (n_a, n_b) control points, numbers within the patch
    own: Floats  # (n_a, n_b) 1, or 0 on edges of another face


Modes = list[Floats]  # of the three components of each patch, one patch after the other


@dataclass(frozen=True, eq=False)
class PatchInverse:
    """Displacements of a patch from forces on its control points.

    Parameters
    ----------
    shape : (3,)
        Control points in each direction.
    numbers : (n,)
        Their global numbers.
    spread : (size, n)
        Adds up what they have.
    share : (n,)
        Of the forces and displacements of control points that several patches share.
    frames : (n, 3, 3) or (1, 3, 3)
        Rotations; column i is the direction of component i.
    components : three Diagonal
    touching : tuple of Touching
    """

    shape: tuple[int, ...]
    numbers: Indices
    spread: csr_array
    share: Floats
    frames: Floats
    components: tuple[Diagonal, ...]
    touching: tuple[Touching, ...]

    def rounded(self, precision: DTypeLike) -> "PatchInverse":
        """The same in another precision."""
        components = tuple(component.rounded(precision) for component in self.components)
        touching = tuple(part._replace(own=part.own.astype(precision)) for part in self.touching)
        spread, share, frames = (part.astype(precision) for part in (self.spread, self.share, self.frames))
        return PatchInverse(self.shape, self.numbers, spread, share, frames, components, touching)

    def modes(self, forces: Floats) -> Modes:
        """Displacements in modes under forces (size, 3) on all control points."""
        local = self._local(slice(None), forces).reshape(3, *self.shape)
        return [part.modes(force) for part, force in zip(self.components, local, strict=True)]

    def displacements(self, modes: Modes) -> Floats:
        """Displacements (n, 3) from modes."""
        local = [part.displacements(mode).ravel() for part, mode in zip(self.components, modes, strict=True)]
        return np.einsum("aij,ja->ai", self.frames, np.array(local)) * self.share[:, None]

    def pushed(self, forces: Floats) -> Modes:
        """Displacements in modes under forces (size, 3) on the touching faces alone."""
        found: Modes = [np.zeros(1, dtype=forces.dtype)] * 3
        for face, within, own in self.touching:
            local = self._local(within.ravel(), forces).reshape(3, *own.shape) * own
            found = [f + c.pushed(face, part) for f, c, part in zip(found, self.components, local, strict=True)]
        return found

    def traced(self, modes: Modes) -> Iterator[tuple[Indices, Floats]]:
        """Yield control points (n_f,) of touching faces, global numbers, and displacements (n_f, 3)."""
        for face, within, own in self.touching:
            parts = [(c.traced(face, mode) * own).ravel() for c, mode in zip(self.components, modes, strict=True)]
            turned = np.einsum("aij,ja->ai", self._frames(within.ravel()), np.array(parts))
            yield self.numbers[within.ravel()], turned * self.share[within.ravel(), None]

    def between(self, operator: csr_array) -> Array:
        """G B G' (m, m) of this patch's inverse B, for a gap operator (m, dofs)."""
        local = [(part.face, self._components(part, operator)) for part in self.touching]
        found = np.zeros((operator.shape[0],) * 2)
        for i, component in enumerate(self.components):
            for one, left in local:
                for other, right in local:
                    if left[i].nnz and right[i].nnz:
                        found += right[i] @ (left[i] @ component.between(one, other)).T
        return found

    def _components(self, touching: Touching, operator: csr_array) -> list[csr_array]:
        """Parts (m, n_f) of a gap operator (m, dofs) that act on each local component of a face."""
        within = touching.within.ravel()
        frames = self._frames(within) * (self.share[within] * touching.own.ravel())[:, None, None]
        parts = [operator[:, 3 * self.numbers[within] + j] for j in range(3)]
        turned = [csr_array(sum(parts[j].multiply(frames[:, j, i]) for j in range(3))) for i in range(3)]
        largest = max(np.abs(part.data).max(initial=0.0) for part in turned)
        for part in turned:
            part.data[np.abs(part.data) <= ALIGNED * largest] = 0.0
            part.eliminate_zeros()
        return turned

    def _local(self, within: Indices | slice, forces: Floats) -> Floats:
        """The share of this patch in forces on some of its control points, in its frames: (3, k)."""
        own = np.take(forces, self.numbers[within], axis=0) * self.share[within, None]
        return np.einsum("aji,aj->ia", self._frames(within), own)

    def _frames(self, within: Indices | slice) -> Floats:
        """Frames of some control points, all the same where there is one for all."""
        return self.frames if len(self.frames) == 1 else self.frames[within]


class PatchInverses:
    """The sum of the inverses of some patches.

    Parameters
    ----------
    patches : sequence of PatchInverse
    size : int
        Number of control points.
    """

    def __init__(self, patches: Sequence[PatchInverse], size: int) -> None:
        self._patches, self.count = patches, 3 * len(patches)
        self._rounded = [patch.rounded(np.float32) for patch in patches]
        self._size, self._spread = size, csr_array(hstack([patch.spread for patch in self._rounded]))

    def modes(self, forces: Floats) -> Modes:
        """Displacements in modes under forces (size, 3)."""
        return [mode for patch in self._rounded for mode in patch.modes(forces)]

    def displacements(self, modes: Modes) -> Floats:
        """Displacements (size, 3) from modes."""
        parts = [p.displacements(modes[3 * k : 3 * k + 3]) for k, p in enumerate(self._rounded)]
        return self._spread @ np.concatenate(parts)

    def pushed(self, forces: Floats) -> Modes:
        """Displacements in modes under forces (size, 3) on the touching faces alone."""
        return [mode for patch in self._rounded for mode in patch.pushed(forces)]

    def traced(self, modes: Modes) -> Floats:
        """Displacements (size, 3) of the touching faces, zero elsewhere, from modes."""
        result = np.zeros((self._size, 3), dtype=np.float32)
        for number, patch in enumerate(self._rounded):
            for numbers, displacement in patch.traced(modes[3 * number : 3 * number + 3]):
                np.add.at(result, numbers, displacement)
        return result

    def between(self, operator: csr_array) -> Array:
        """G B G' (m, m) for a gap operator (m, dofs) on the touching faces."""
        found = np.zeros((operator.shape[0],) * 2)
        for patch in self._patches:
            if patch.touching:
                found += patch.between(operator)
        return found
