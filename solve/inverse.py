"""The preconditioner without contact: B = Σ diagonalised inverses inside patches + E Σ across glued faces E' + coarse.

Patches that are not glued stand alone. Of glued ones the inside is solved for with the glued faces held; what these do
comes from the inverses of the patches at both sides, each with its share, by harmonic extension E (Neumann-Neumann;
Toselli & Widlund 2005, ch. 6, with the straightened map in place of exact solves); see `solve.coarse` for the rest.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from statistics import geometric_mean
from typing import NamedTuple, Protocol

import numpy as np
from scipy.sparse import csr_array

from geom2iga.bspline import Array, Indices, Mask
from geom2iga.patch import Face, Patch, face_indices
from solve.bricks import Floats
from solve.coarse import Coarse
from solve.extension import Extension, PatchExtension, extend
from solve.fastdiag import FaceModes, diagonal_of, local_frames, straightened
from solve.material import Material
from solve.patchwise import Modes, PatchInverse, PatchInverses, Touching
from solve.space import Space

FIXED = 1e-9  # a component is fixed on a face where the supports leave no control point more freedom than this


class Term(Protocol):
    """A symmetric operator B on forces, by way of modes.

    Attributes
    ----------
    count : int
        Arrays of modes.
    """

    count: int

    def modes(self, forces: Floats) -> Modes:
        """Displacements in modes under forces (size, 3)."""

    def displacements(self, modes: Modes) -> Floats:
        """Displacements (size, 3) from modes."""

    def pushed(self, forces: Floats) -> Modes:
        """Displacements in modes under forces (size, 3) on the touching faces alone."""

    def traced(self, modes: Modes) -> Floats:
        """Displacements (size, 3) of the touching faces, zero elsewhere, from modes."""

    def between(self, operator: csr_array) -> Array:
        """G B G' (m, m) for a gap operator (m, dofs) on the touching faces."""


class Extended:
    """E N E' for the inverses N of patches at control points of glued faces.

    Extended displacements are zero on touching faces: there only their edges, if glued, see it.

    Parameters
    ----------
    patches : PatchInverses
    extension : Extension
    freedom : (dofs, dofs)
    """

    def __init__(self, patches: PatchInverses, extension: Extension, freedom: csr_array) -> None:
        self._patches, self._extension, self._freedom = patches, extension, freedom.astype(np.float32)
        self.count, self.pushed, self.traced = patches.count, patches.pushed, patches.traced
        self.between = patches.between

    def modes(self, forces: Floats) -> Modes:
        """Displacements in modes under forces (size, 3)."""
        return self._patches.modes(self._projected(self._extension.gathered(forces)))

    def displacements(self, modes: Modes) -> Floats:
        """Displacements (size, 3) from modes."""
        return self._extension.extended(self._projected(self._patches.displacements(modes)))

    def _projected(self, values: Floats) -> Floats:
        return (self._freedom @ values.ravel()).reshape(-1, 3)


class Inverse:
    """An approximate inverse of the stiffness of all bodies; motions that nothing resists get a finite one, too.

    Parameters
    ----------
    space : Space
    materials : body name to Material
    freedom : (dofs, dofs)
        Projection on the displacements that the supports allow, control point by control point.
    touching : faces
        That take part in contacts.

    Attributes
    ----------
    faces : tuple
        Control points (n_f,) of each touching face, global numbers, the share of its patch in them, and its modes.
    """

    def __init__(
        self, space: Space, materials: Mapping[str, Material], freedom: csr_array, touching: Sequence[Face]
    ) -> None:
        blocks, glued = _blocks(freedom), _glued(space)
        faces = {name: _touching(patch, touching) for name, patch in space.model.patches.items()}
        shares = _shares(space, faces)
        parts = [
            _part(space, name, shares[name], faces[name], materials[space.model.body_of(name)], blocks, glued)
            for name in space.model.patches
        ]
        self._terms: list[Term] = [PatchInverses([part.inside for part in parts], space.size)]
        self.faces = tuple(modes for part in parts for modes in part.faces)
        if glued.any():
            across = PatchInverses([part.across for part in parts if part.across], space.size)
            extension = Extension([part.extension for part in parts if part.extension], glued)
            numbers = [space.numbers[name][p.within.ravel()] for name, own in faces.items() for p in own]
            touched = np.concatenate([np.empty(0, dtype=np.int64), *numbers])
            self._terms += [Extended(across, extension, freedom), Coarse(space, materials, blocks, touched)]
        self._ends = np.cumsum([0, *(term.count for term in self._terms)])

    def modes(self, forces: Floats) -> Modes:
        """Displacements in modes under forces (dofs,), in single precision."""
        points = forces.astype(np.float32, copy=False).reshape(-1, 3)
        return [mode for term in self._terms for mode in term.modes(points)]

    def displacements(self, modes: Modes) -> Floats:
        """Displacements (dofs,) from modes."""
        return np.sum([term.displacements(own) for term, own in self._each(modes)], axis=0).ravel()

    def pushed(self, forces: Floats) -> Modes:
        """Displacements in modes under forces (dofs,) on the touching faces alone."""
        points = forces.reshape(-1, 3)
        return [mode for term in self._terms for mode in term.pushed(points)]

    def traced(self, modes: Modes) -> Floats:
        """Displacements (dofs,) of the touching faces, zero elsewhere, from modes."""
        return np.sum([term.traced(own) for term, own in self._each(modes)], axis=0).ravel()

    def between(self, operator: csr_array) -> Array:
        """G B G' (m, m) for a gap operator (m, dofs) on the touching faces."""
        return np.sum([term.between(operator) for term in self._terms], axis=0)

    def _each(self, modes: Modes) -> Iterator[tuple[Term, Modes]]:
        """Each term with its modes."""
        for term, (start, end) in zip(self._terms, pairwise(self._ends), strict=True):
            yield term, modes[start:end]


class _Part(NamedTuple):
    """What a patch gives to the inverse."""

    inside: PatchInverse
    across: PatchInverse | None
    extension: PatchExtension | None
    faces: list[tuple[Indices, Floats, FaceModes]]


def _part(
    space: Space,
    name: str,
    share: Array,
    touching: tuple[Touching, ...],
    material: Material,
    blocks: Array,
    glued: Mask,
) -> _Part:
    """Diagonalise a patch; components are fixed on the faces where the supports fix all control points."""
    patch, numbers, spread = space.model.patches[name], space.numbers[name], space.spread(name)
    frames, lines = local_frames(patch), straightened(patch, material)
    allowed = np.einsum("aji,ajk,aki->ia", frames, blocks[numbers], frames, optimize=True).reshape(3, *patch.shape)
    fixed = np.array([_ends(part < FIXED) for part in allowed])
    held, touched = _ends(glued[numbers].reshape(patch.shape)), np.zeros((3, 2), dtype=bool)
    for part in touching:
        touched[part.face.axis, part.face.side] = True

    def inverse(still: Mask, own: Array, typical: Callable[[Sequence[float]], float] = min) -> PatchInverse:
        components = tuple(
            diagonal_of(directions, ends, typical) for directions, ends in zip(lines, still, strict=True)
        )
        return PatchInverse(patch.shape, numbers, spread, own, frames, components, touching)

    inside = inverse(fixed | held, np.ones(len(numbers)))
    whole = inverse(fixed, share * glued[numbers], geometric_mean) if held.any() else inside
    faces = [
        (numbers[p.within.ravel()], (share[p.within] * p.own).ravel().astype(np.float32), modes)
        for p in touching
        for modes in [whole.components[p.face.axis].rounded(np.float32).face_modes(p.face)]
    ]
    if not held.any():
        return _Part(inside, None, None, faces)
    return _Part(inside, whole, extend(space, name, frames, lines, fixed | held | touched), faces)


def _ends(points: Mask) -> Array:
    """On which faces (3, 2), at the two ends of each direction, all control points of a patch are so."""
    return np.array([[np.take(points, -side, d).all() for side in range(2)] for d in range(3)])


def _glued(space: Space) -> Mask:
    """Control points (size,) of glued faces."""
    glued = np.zeros(space.size, dtype=bool)
    for pair in space.model.glued:
        for face in (pair.first, pair.second):
            glued[space.face_numbers(face)] = True
    return glued


def _touching(patch: Patch, faces: Sequence[Face]) -> tuple[Touching, ...]:
    """Faces of a patch that take part in contact; each control point belongs to one of them."""
    taken, found = np.zeros(np.prod(patch.shape), dtype=bool), []
    for face in dict.fromkeys(faces):
        if face.patch == patch.name:
            within = face_indices(patch, face)
            found.append(Touching(face, within, (~taken[within]).astype(float)))
            taken[within] = True
    return tuple(found)


def _shares(space: Space, touching: Mapping[str, tuple[Touching, ...]]) -> dict[str, Array]:
    """Share (n,) of each patch in its control points; where there is contact, only of patches that touch."""
    numbers, contact = space.numbers, np.zeros(space.size, dtype=bool)
    wanted = {name: np.ones(len(own)) for name, own in numbers.items()}
    for name, faces in touching.items():
        for part in faces:
            contact[numbers[name][part.within]] = True
    total = np.zeros(space.size)
    for name, own in numbers.items():
        touched = np.zeros(len(own), dtype=bool)
        for part in touching[name]:
            touched[part.within] = True
        wanted[name][contact[own] & ~touched] = 0.0
        np.add.at(total, own, wanted[name])
    return {name: wanted[name] / total[own] for name, own in numbers.items()}


def _blocks(matrix: csr_array) -> Array:
    """Blocks (n, 3, 3) on the diagonal of a symmetric matrix (3 n, 3 n)."""
    blocks = np.empty((matrix.shape[0] // 3, 3, 3))
    for i in range(3):
        for j in range(i, 3):
            blocks[:, i, j] = blocks[:, j, i] = matrix.diagonal(j - i)[i::3][: len(blocks)]
    return blocks
