"""The geometry of an analysis: bodies made of patches, and named groups of faces."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from geom2iga.errors import CaseError, suggestion
from geom2iga.patch import Face, Patch, surface

SIDES = ("left", "right", "front", "back", "bottom", "top")  # x0 x1 y0 y1 z0 z1


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

    Raises
    ------
    ValueError
        A patch that is no volume, has another name here, or lies in no body or several; a face of an unknown patch.
    """

    patches: Mapping[str, Patch]
    bodies: Mapping[str, tuple[str, ...]]
    groups: Mapping[str, tuple[Face, ...]]

    def __post_init__(self) -> None:
        for name in ("patches", "bodies", "groups"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
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


def block_groups(name: str) -> dict[str, tuple[Face, ...]]:
    """Name the six faces of a patch by their side.

    >>> block_groups("upper")["upper/bottom"]
    (Face(patch='upper', axis=2, side=0),)
    """
    return {f"{name}/{side}": (Face(name, k // 2, k % 2),) for k, side in enumerate(SIDES)}
