"""The geometry of an analysis: bodies made of patches, and named groups of faces."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from math import prod
from types import MappingProxyType
from typing import Any

import numpy as np

from geom2iga.display import MOST, boxed, counted, html_table, shortened
from geom2iga.errors import CaseError, suggestion
from geom2iga.patch import Face, Patch, resolution, surface
from geom2iga.quality.certificate import Certificate

SIDES = ("left", "right", "front", "back", "bottom", "top")  # x0 x1 y0 y1 z0 z1

SAME = 1e-7  # how far glued control points may lie apart, in sizes of the body; their weights, but for a factor


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
    certificates : patch name to Certificate
        What is proven or measured of the patches; empty where nothing is.

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
    certificates: Mapping[str, Certificate] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("patches", "bodies", "groups", "certificates"):
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
            if len(set(faces)) < len(faces):
                raise ValueError(f'group "{name}" names a face twice')
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
        first, second = self.surface(pair.first), self.surface(pair.second)
        points = oriented(second.control_points, pair.orientation)
        if first.control_points.shape != points.shape:
            raise ValueError(f"{where} are glued but have {first.shape} and {points.shape[:2]} control points")
        if not _same_space(first, second, pair.orientation):
            raise ValueError(f"{where} are glued but differ in degrees or knots")
        apart = float(np.abs(first.control_points - points).max())
        shares = first.weights / oriented(second.weights, pair.orientation)  # a common factor changes no map
        uneven = float(np.ptp(shares) / shares.max())
        near = SAME * self._sizes[self.body_of(pair.first.patch)] + resolution(points)
        if apart > near or uneven > SAME:
            raise ValueError(f"{where} are glued but lie {apart:g} apart, their weights {uneven:g}")

    @cached_property
    def _sizes(self) -> dict[str, float]:
        """Largest extent of each body along x, y or z [length]."""
        points = {
            name: [self.patches[p].control_points.reshape(-1, 3) for p in body] for name, body in self.bodies.items()
        }
        return {name: float(np.ptp(np.concatenate(parts), axis=0).max()) for name, parts in points.items() if parts}

    @cached_property
    def _holders(self) -> dict[str, str]:
        """The body of each patch."""
        return {patch: body for body, patches in self.bodies.items() for patch in patches}

    def body_of(self, patch: str) -> str:
        """Return the name of the body that a patch belongs to."""
        return self._holders[patch]

    @property
    def body_numbers(self) -> dict[str, int]:
        """The number of the body that each patch belongs to, its place in the case from 0; patches body by body."""
        return {patch: number for number, patches in enumerate(self.bodies.values()) for patch in patches}

    def faces(self, group: str) -> tuple[Face, ...]:
        """Return the faces of a group, or raise CaseError with the nearest known name."""
        if group not in self.groups:
            raise CaseError(f'there is no face "{group}"; {suggestion(group, self.groups)}')
        return self.groups[group]

    def surface(self, face: Face) -> Patch:
        """Return a face as a patch of two directions."""
        return surface(self.patches[face.patch], face)

    def __repr__(self) -> str:
        lines = [f"  {body}: {mesh}, {points}; faces {faces}" for body, mesh, points, faces in self._rows]
        left = [f"  and {len(self.bodies) - MOST} more"] if len(self.bodies) > MOST else []
        return "\n".join([f"Model({self._size})", *lines, *left])

    def _repr_html_(self) -> str:
        return html_table(f"Model: {self._size}", ("body", "patches", "control points", "faces"), self._rows)

    @property
    def _size(self) -> str:
        """How much there is of everything."""
        points = sum(prod(patch.shape) for patch in self.patches.values())
        glued = f", {counted(len(self.glued), 'pair', 'pairs')} of glued faces" if self.glued else ""
        bodies, patches = counted(len(self.bodies), "body", "bodies"), counted(len(self.patches), "patch", "patches")
        return f"{bodies}, {patches}, {points} control points{glued}"

    @property
    def _rows(self) -> list[tuple[str, str, str, str]]:
        """Name, mesh, control points and groups of faces of the first bodies."""
        first = islice(self.bodies.items(), MOST)
        return [self._row(name, [self.patches[patch] for patch in patches]) for name, patches in first]

    def _row(self, name: str, patches: Sequence[Patch]) -> tuple[str, str, str, str]:
        """What is said of one body."""
        mesh = patches[0].mesh if len(patches) == 1 else counted(len(patches), "patch", "patches")
        own = {patch.name for patch in patches}
        groups = (group for group, faces in self.groups.items() if any(face.patch in own for face in faces))
        points = np.concatenate([np.empty((0, 3)), *(patch.control_points.reshape(-1, 3) for patch in patches)])
        return name, mesh, boxed(points), shortened(groups) or "none"


def _same_space(first: Patch, second: Patch, orientation: int) -> bool:
    """Say whether two surfaces have the same degrees, and the same knots but for their range."""
    axes = (1, 0) if orientation & 1 else (0, 1)
    for axis, other in enumerate(axes):
        ours, theirs = (
            (knots - knots[0]) / (knots[-1] - knots[0]) for knots in (first.knots[axis], second.knots[other])
        )
        theirs = 1 - theirs[::-1] if orientation & (2 << axis) else theirs
        if first.degrees[axis] != second.degrees[other] or not np.allclose(ours, theirs, rtol=0, atol=SAME):
            return False
    return True


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


def side_faces(patch: str) -> dict[str, tuple[Face, ...]]:
    """Name the six faces of a patch by their side.

    >>> side_faces("upper")["bottom"]
    (Face(patch='upper', axis=2, side=0),)
    """
    return {side: (Face(patch, k // 2, k % 2),) for k, side in enumerate(SIDES)}
