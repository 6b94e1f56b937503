"""Bodies of several glued patches that several tests use."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import permutations, product
from typing import Any

import numpy as np

from geom2iga.bspline import Array
from geom2iga.glue import all_faces, find_glued
from geom2iga.model import SIDES, Face, Glued, Model
from geom2iga.patch import Patch, refined, reversed_along, surface
from tests.cases import block_patch

Bodies = Mapping[str, Sequence[Patch]]
# sequences of directions, and which of them then run backwards, that keep a patch right-handed
RIGHT_HANDED = [
    (axes, reverse)
    for axes in permutations(range(3))
    for reverse in ([a for a in range(3) if flips[a]] for flips in product((0, 1), repeat=3))
    if np.linalg.det(np.eye(3)[list(axes)]) * (-1) ** len(reverse) > 0
]


def turned_round(patch: Patch, axes: Sequence[int], reverse: Sequence[int] = ()) -> Patch:
    """The same patch with its directions in another sequence, then some of them backwards."""
    patch = replace(
        patch,
        degrees=tuple(patch.degrees[axis] for axis in axes),
        knots=tuple(patch.knots[axis] for axis in axes),
        control_points=patch.control_points.transpose(*axes, 3),
        weights=patch.weights.transpose(axes),
    )
    for axis in reverse:
        patch = reversed_along(patch, axis)
    return patch


def halves(patch: Patch, axis: int, at: float) -> tuple[Patch, Patch]:
    """Cut a patch at a parameter into "first" and "second"."""
    whole = with_joint(patch, axis, at)
    degree, knots = whole.degrees[axis], whole.knots[axis]
    last = int(np.searchsorted(knots, at)) - 1  # the control point that both halves have
    parts = []
    for name, points, vector in (
        ("first", slice(0, last + 1), np.append(knots[: last + degree + 1], at)),
        ("second", slice(last, None), np.insert(knots[last + 1 :], 0, at)),
    ):
        own = (slice(None),) * axis + (points,)
        vectors = (*whole.knots[:axis], (vector - vector[0]) / (vector[-1] - vector[0]), *whole.knots[axis + 1 :])
        parts.append(Patch(name, whole.degrees, vectors, whole.control_points[own], whole.weights[own]))
    return parts[0], parts[1]


def with_joint(patch: Patch, axis: int, at: float) -> Patch:
    """The same patch with a knot repeated until its functions are merely continuous there."""
    found = int(np.count_nonzero(patch.knots[axis] == at))
    inserted = [[at] * (patch.degrees[axis] - found) if a == axis else [] for a in range(3)]
    return refined(patch, knots=inserted)


def glued_model(bodies: Bodies) -> Model:
    """Glue the patches of each body; name "body/left" ... "body/top" the faces in the six planes around it.

    "body/joints" are the faces inside it, one of each glued pair, and "body/skin" those that are not glued.
    """
    groups: dict[str, tuple[Face, ...]] = {}
    glued: list[Glued] = []
    for body, patches in bodies.items():
        own = find_glued(patches)
        groups[f"{body}/joints"] = tuple(pair.first for pair in own)
        inside = {face for pair in own for face in (pair.first, pair.second)}
        groups[f"{body}/skin"] = tuple(face for face in all_faces(patches) if face not in inside)
        points = np.concatenate([patch.control_points.reshape(-1, 3) for patch in patches])
        for number, name in enumerate(SIDES):
            axis, side = divmod(number, 2)
            groups[f"{body}/{name}"] = faces_in_plane(
                patches, axis, (points.min(axis=0), points.max(axis=0))[side][axis]
            )
        glued.extend(own)
    return Model(
        {patch.name: patch for patches in bodies.values() for patch in patches},
        {body: tuple(patch.name for patch in patches) for body, patches in bodies.items()},
        {name: faces for name, faces in groups.items() if faces},
        tuple(glued),
    )


def faces_in_plane(patches: Sequence[Patch], axis: int, value: float) -> tuple[Face, ...]:
    """Faces all of whose control points have one coordinate in common."""
    by_name = {patch.name: patch for patch in patches}
    return tuple(
        face
        for face in all_faces(patches)
        if np.abs(surface(by_name[face.patch], face).control_points[..., axis] - value).max() < 1e-9
    )


def wall(
    name: str,
    origin: Sequence[float] = (0, 0, 0),
    size: Sequence[float] = (1, 1, 1),
    degree: int = 1,
    spans: Sequence[Sequence[int]] = ((2, 1), (1, 2), (1,)),
    shift: Sequence[float] = (0.0, 0.0),
) -> tuple[Patch, ...]:
    """A cuboid of blocks, each direction a row of span numbers; inner vertical edges moved by a share of a block."""
    counts = np.array([len(row) for row in spans])
    patches = []
    for place in np.ndindex(*counts):
        own = [row[k] for row, k in zip(spans, place, strict=True)]
        patch = block_patch(f"{name}{''.join(map(str, place))}", place, (1, 1, 1), degree, own)
        patch = _skewed(patch, place, counts, shift)
        patches.append(replace(patch, control_points=origin + patch.control_points * np.asarray(size) / counts))
    return tuple(patches)


def _skewed(patch: Patch, place: Sequence[int], counts: Array, shift: Sequence[float]) -> Patch:
    """Move the inner vertical edges of a unit block at a place of a wall; what lies between follows linearly."""
    u, v = np.moveaxis(patch.control_points[..., :2] - place[:2], -1, 0)
    share = np.zeros_like(u)
    for corner in np.ndindex(2, 2):
        if np.all((np.add(place[:2], corner) > 0) & (np.add(place[:2], corner) < counts[:2])):
            share += (u if corner[0] else 1 - u) * (v if corner[1] else 1 - v)
    return replace(patch, control_points=patch.control_points + share[..., None] * np.array([*shift, 0.0]))


def star(
    name: str,
    count: int,
    centre: Sequence[float] = (0, 0, 0),
    radius: float = 1.0,
    height: float = 1.0,
    degree: int = 1,
    spans: Sequence[int] = (2, 2, 1),
) -> tuple[Patch, ...]:
    """Upright prisms over as many rhombi around one edge: a hexagon of 3, a square of 4, a star of 5 and more."""
    patches = []
    for number in range(count):
        angles = 2 * np.pi * (number + np.arange(2)) / count
        sides = radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
        frame = np.stack([*sides, [0, 0, height]])
        patch = block_patch(f"{name}{number}", degree=degree, spans=spans)
        patches.append(replace(patch, control_points=np.asarray(centre) + patch.control_points @ frame))
    return tuple(patches)


def pressed(held: Sequence[str], swap: bool = False, **contact: Any) -> dict[str, Any]:
    """The contact patch test: pressure 1 on "upper" and on what it leaves open of "lower"; faces held in their planes.

    Parameters
    ----------
    swap :
        The lower body is the secondary one.
    """
    sides = ("lower/top", "upper/bottom") if swap else ("upper/bottom", "lower/top")
    return {
        "solve": {
            "material": [{"young": 1000.0, "poisson": 0.3}],
            "support": [{"on": face, "normal": 0.0} for face in ("lower/bottom", *held)],
            "load": [
                {"on": "upper/top", "pressure": 1.0},
                {"on": "lower/top", "pressure": 1.0, "exposed": True},
                {"on": "upper/bottom", "pressure": 1.0, "exposed": True},
            ],
            "contact": [{"secondary": sides[0], "primary": sides[1], "penalty": 1e5, **contact}],
        },
    }
