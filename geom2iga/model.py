"""The geometry of an analysis: bodies made of patches, and named groups of faces."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from geom2iga.errors import CaseError, suggestion
from geom2iga.patch import Face, Patch, surface

SIDES = ("left", "right", "front", "back", "bottom", "top")  # x0 x1 y0 y1 z0 z1

SAME = 1e-9  # how far glued control points may lie apart, in sizes of the face; weights, in ones


@dataclass(frozen=True)
class Glued:
    """Two faces that are one: control point (i, j) of `first` is that of `second`, `oriented`.

    Parameters
    ----------
    first, second : Face
    orientation : int
        One of 8: the sum of 1 where the two directions of `second` are swapped, then of 2 where the first and 4 where
        the second of them runs backwards.
    """

    first: Face
    second: Face
    orientation: int

    def __post_init__(self) -> None:
        if self.orientation not in range(8):
            raise ValueError(f"two faces can be glued in 8 orientations, 0 to 7, found {self.orientation}")


def oriented(grid: Any, orientation: int) -> Any:
    """Run through the (n_1, n_2, ...) of a second face the way the first face runs.

    >>> oriented(np.array([[1, 2, 3], [4, 5, 6]]), 1 + 4).tolist()
    [[4, 1], [5, 2], [6, 3]]
    """
    grid = np.swapaxes(grid, 0, 1) if orientation & 1 else grid
    grid = grid[::-1] if orientation & 2 else grid
    return grid[:, ::-1] if orientation & 4 else grid


@dataclass(frozen=True, eq=False)
class Model:
    """Bodies, their patches and the names of their faces.

    Parameters
    ----------
    patches : name to Patch
        Volumes of three directions.
    bodies : name to patch names
        Every patch belongs to exactly one body.
    groups : name to faces
        What supports, loads and contacts refer to, such as "upper/bottom".
    glued : pairs of faces
        Where patches of one body hang together: the two faces share their control points.

    Raises
    ------
    ValueError
        A patch that is no volume, has another name here, or lies in no body or several; a face of an unknown patch;
        glued faces of two bodies or that do not coincide.
    """

    patches: Mapping[str, Patch]
    bodies: Mapping[str, tuple[str, ...]]
    groups: Mapping[str, tuple[Face, ...]]
    glued: tuple[Glued, ...] = ()

    def __post_init__(self) -> None:
        for name in ("patches", "bodies", "groups"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        object.__setattr__(self, "glued", tuple(self.glued))
        flat = [patch for body in self.bodies.values() for patch in body]
        if sorted(flat) != sorted(self.patches):
            raise ValueError(f"bodies hold the patches {sorted(flat)}, the model has {sorted(self.patches)}")
        for name, patch in self.patches.items():
            if patch.name != name:
                raise ValueError(f'patch "{patch.name}" is listed as "{name}"')
            if patch.directions != 3:
                raise ValueError(f'patch "{name}" has {patch.directions} directions, a body needs volumes')
        for name, faces in self.groups.items():
            for face in faces:
                if face.patch not in self.patches:
                    raise ValueError(f'group "{name}" names a face of the unknown patch "{face.patch}"')
        for pair in self.glued:
            self._check_glued(pair)

    def _check_glued(self, pair: Glued) -> None:
        """Raise ValueError unless the two faces are of one body and coincide."""
        where = f"{pair.first} and {pair.second}"
        for face in (pair.first, pair.second):
            if face.patch not in self.patches:
                raise ValueError(f'a face of the unknown patch "{face.patch}" is glued')
        if self.body_of(pair.first.patch) != self.body_of(pair.second.patch):
            raise ValueError(f"{where} are glued but of two bodies")
        first = self.surface(pair.first).homogeneous
        second = oriented(self.surface(pair.second).homogeneous, pair.orientation)
        if first.shape != second.shape:
            raise ValueError(f"{where} are glued but have {first.shape[:2]} and {second.shape[:2]} control points")
        apart = np.abs(first - second).max(axis=(0, 1))
        size = np.ptp(first[..., :3] / first[..., 3:], axis=(0, 1)).max()
        if apart[:3].max() > SAME * size or apart[3] > SAME:
            raise ValueError(f"{where} are glued but lie {apart[:3].max():g} apart, their weights {apart[3]:g}")

    def body_of(self, patch: str) -> str:
        """Return the name of the body that a patch belongs to."""
        return next(body for body, patches in self.bodies.items() if patch in patches)

    def faces(self, group: str) -> tuple[Face, ...]:
        """Return the faces of a group, or raise CaseError with the nearest known name."""
        if group not in self.groups:
            raise CaseError(f'there is no face "{group}"; {suggestion(group, self.groups)}')
        return self.groups[group]

    def surface(self, face: Face) -> Patch:
        """Return a face as a patch of two directions."""
        return surface(self.patches[face.patch], face)

    def __repr__(self) -> str:
        return f"Model(bodies {', '.join(self.bodies)}; {len(self.patches)} patches, {len(self.groups)} face groups)"


@dataclass(frozen=True, eq=False)
class Part:
    """Patches that form one body, as built: the mesh and the glued faces are still to come.

    Parameters
    ----------
    patches : tuple of Patch
        Right-handed volumes; where two meet, they meet in whole faces.
    faces : name to faces
        What its faces are called within the body, such as "top".
    """

    patches: tuple[Patch, ...]
    faces: Mapping[str, tuple[Face, ...]]


def block_groups(name: str) -> dict[str, tuple[Face, ...]]:
    """Name the six faces of a patch by their side.

    >>> block_groups("upper")["upper/bottom"]
    (Face(patch='upper', axis=2, side=0),)
    """
    return {f"{name}/{side}": (Face(name, k // 2, k % 2),) for k, side in enumerate(SIDES)}
