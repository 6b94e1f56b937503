"""Which faces bear which names, and where the names go beside a picture."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.optimize import isotonic_regression, linear_sum_assignment

from geom2iga.bspline import Array, Indices, Mask
from geom2iga.model import Model
from geom2iga.patch import Face
from geom2iga.picture.scene import Camera

NUMBERED = re.compile(r"/face\d+$")
MOST_REGIONS = 24  # that still have room for mere numbers of faces
VISIBLE = 3.0  # how far from its border a visible piece of a region must reach to be pointed at [pixels]

NEARLY = 0.9  # of the largest distance from the border; among such points, the middle one is pointed at


@dataclass(frozen=True)
class Region:
    """Faces that bear the same names.

    Parameters
    ----------
    names : tuple of str
        The groups that all of these faces, and no others together, belong to.
    faces : tuple of Face
    """

    names: tuple[str, ...]
    faces: tuple[Face, ...]

    @property
    def text(self) -> str:
        """What to write on the label."""
        return ", ".join(self.names)


@dataclass(frozen=True, eq=False)
class Anchor:
    """The point of a region that its label points to, in one view.

    Parameters
    ----------
    region : int
        Number of the region.
    point : (3,)
        On one of its faces [length].
    seen : bool
        False where other surfaces hide the region in every view.
    """

    region: int
    point: Array
    seen: bool


def regions(model: Model) -> tuple[Region, ...]:
    """Split the named faces of a model into regions that bear the same names, in the sequence of the groups.

    Mere numbers of faces, such as "body/face7", give way to other names; where there are too many, they are left out.

    >>> from geom2iga import build
    >>> model = build({"geometry": {"block": [{"name": "cube", "size": [1, 1, 1]}]}})
    >>> [region.text for region in regions(model)][:2]
    ['cube/left', 'cube/right']
    """
    names: dict[Face, tuple[str, ...]] = {}
    for group, faces in model.groups.items():
        for face in dict.fromkeys(faces):
            names[face] = (*names.get(face, ()), group)
    chosen = {face: tuple(name for name in each if not NUMBERED.search(name)) for face, each in names.items()}
    crowded = any(chosen.values()) and len({chosen[face] or names[face] for face in names}) > MOST_REGIONS
    names = {face: each for face in names if (each := chosen[face] or (() if crowded else names[face]))}
    return tuple(Region(key, tuple(f for f in names if names[f] == key)) for key in dict.fromkeys(names.values()))


def find_anchors(
    samples: Sequence[Array], cameras: Sequence[Camera], images: Sequence[Indices]
) -> tuple[tuple[Anchor, ...], ...]:
    """Choose, for every view, the points of the regions that their labels point to.

    A region is pointed at in every view that shows it, at a sample far inside of what is visible of it. One
    that no view shows is pointed at in the view from which its middle is nearest to the viewer.

    Parameters
    ----------
    samples : per region, (q, 3)
        Points on its faces [length].
    cameras : per view
    images : per view, (height, width)
        Number of the region that is seen in each pixel, other numbers elsewhere.

    Returns
    -------
    per view, tuple of Anchor
        In the sequence of the regions.
    """
    anchors: list[list[Anchor]] = [[] for _ in cameras]
    for region, points in enumerate(samples):
        found = [_farthest_inside(points, c, image == region) for c, image in zip(cameras, images, strict=True)]
        for view, number in enumerate(found):
            if number is not None:
                anchors[view].append(Anchor(region, points[number], True))
        if all(number is None for number in found):
            middle = points.mean(axis=0)
            nearness = [(middle - c.centre) @ c.direction / np.linalg.norm(c.direction) for c in cameras]
            central = np.linalg.norm(points - middle, axis=1).argmin()
            anchors[int(np.argmax(nearness))].append(Anchor(region, points[central], False))
    return tuple(map(tuple, anchors))


def _farthest_inside(points: Array, camera: Camera, visible: Mask) -> int | None:
    """Number of a point far from the border of what is visible, in the middle of such; None where all are hidden."""
    rows = slice(*_extent(visible.any(axis=1)))
    columns = slice(*_extent(visible.any(axis=0)))
    inside = np.zeros(visible.shape)
    inside[rows, columns] = distance_transform_edt(np.pad(visible[rows, columns], 1))[1:-1, 1:-1]
    column, row = np.clip(camera.pixels(points).astype(int).T, 0, np.array([camera.size]).T - 1)
    depth = inside[row, column]
    if depth.max() < VISIBLE:
        return None
    deep = np.flatnonzero(depth >= NEARLY * depth.max())
    middle = points[deep].mean(axis=0)
    return int(deep[np.linalg.norm(points[deep] - middle, axis=1).argmin()])


def _extent(used: Any) -> tuple[int, int]:
    """First and one past last index that is used; one index where none is."""
    at = np.flatnonzero(used)
    return (int(at[0]), int(at[-1]) + 1) if len(at) else (0, 1)


def arranged(points: Array, heights: Array, x: float, top: float, room: float) -> tuple[Indices, Array]:
    """Arrange labels in a column without overlap, so that no two of the lines from them to their points cross.

    Lines of least total length do not cross: of two that do, swapping the ends makes a shorter pair.

    Parameters
    ----------
    points : (n, 2)
        What the labels point to: rightwards, downwards [pixels].
    heights : (n,)
        What each takes up, with the space to the next [pixels].
    x, top, room : float
        Where the lines begin; upper end and height of the column, at least the sum of the heights [pixels].

    Returns
    -------
    sequence : (n,)
        Numbers of the labels from above.
    places : (n,)
        Where their middles are, from above [pixels].
    """
    first = np.argsort(points[:, 1], kind="stable")
    places = spread(points[first, 1] - top, heights[first], room) + top
    starts = np.stack([np.full(len(places), x), places], axis=-1)
    sequence = linear_sum_assignment(np.linalg.norm(starts[:, None] - points, axis=-1))[1]
    return sequence, spread(places - top, heights[sequence], room) + top


def spread(wanted: Array, heights: Array, room: float) -> Array:
    """Place labels in a column without overlap, each as near as possible to where it is wanted.

    Least squares over places y with y[k + 1] - y[k] >= (h[k] + h[k + 1]) / 2, which is isotonic regression of
    y[k] less the heights above it.

    Parameters
    ----------
    wanted : (n,)
        Where their middles should be, from above; they keep this sequence [pixels].
    heights : (n,)
        What each takes up, with the space to the next [pixels].
    room : float
        Height of the column, at least the sum of the heights [pixels].

    Returns
    -------
    (n,)
        Where their middles are [pixels].
    """
    above = np.cumsum(heights) - heights / 2
    level = isotonic_regression(wanted - above).x if len(wanted) else above
    return np.clip(level, 0, room - heights.sum()) + above
