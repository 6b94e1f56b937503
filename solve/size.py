"""How much memory control points and contacts take, before anything is searched or integrated."""

from collections.abc import Sequence
from math import prod

import numpy as np

from geom2iga.bspline import Array
from geom2iga.limits import check_memory
from geom2iga.model import Face, Model
from solve.case import Contact
from solve.space import is_straight

# Measured on cubes of degree 1 and 2 with 60 spans a side, one face held and another pressed: 290 and 320. Loaded faces
# come on top of it: at degree 4 with as many spans, half as much again.
CONTROL_POINT = 300  # bytes of the numbering, supports and loads of a control point
QUADRATURE_POINT = 550  # bytes of a quadrature point of a contact, measured on plane and curved faces, degree 1 to 4
FUNCTION = 50  # bytes of it for each basis function of a face
TRIANGLES = 4.0  # quadrature points of cells that are cut into triangles, over those of rectangles
SQUARE = 1e-9  # cosines below it are those of a right angle


def check_points(model: Model) -> None:
    """Raise CaseError where the control points need more memory than is free."""
    points = sum(prod(patch.shape) for patch in model.patches.values())
    check_memory(f"{points} control points", CONTROL_POINT * points, "take fewer spans or a lower degree")


def check_contact(model: Model, contact: Contact) -> None:
    """Raise CaseError where the quadrature points of a contact need more memory than is free, or a face is unknown."""
    points, functions = quadrature_points(model, contact)
    size = points * (QUADRATURE_POINT + FUNCTION * functions)
    check_memory(f"about {points:.2g} quadrature points", size, "take fewer spans on the faces of the contact")


def quadrature_points(model: Model, contact: Contact) -> tuple[float, int]:
    """Estimate the number of quadrature points from spans, degrees, and how far the two sides lie above each other.

    It tells the order of magnitude, and within a factor of 2 that of plane faces. Cells that are no rectangles are cut
    into triangles, about four times as many.

    Returns
    -------
    float, int
        And the basis functions of a span of a face.
    """
    sides = [model.faces(group) for group in (contact.secondary, contact.primary)]
    boxes = [_box(model, faces) for faces in sides]
    degree = max(max(model.patches[face.patch].degrees) for faces in sides for face in faces)
    straight = all(is_straight(model.patches[face.patch]) for faces in sides for face in faces)
    one, other = (_spans(model, faces, box) for faces, box in zip(sides, boxes[::-1], strict=True))
    if contact.integration == "element":
        one, other, count = _spans(model, sides[0]), 0.0, degree + 1
    else:
        count = degree + 1 if straight else 2 * degree + 1
    passes, pieces = 2 if contact.two_pass else 1, (one**0.5 + other**0.5) ** 2
    if other and not (straight and _parallel(model, [face for faces in sides for face in faces])):
        pieces *= TRIANGLES
    return passes * pieces * (contact.points or count) ** 2, (degree + 1) ** 2


def _parallel(model: Model, faces: Sequence[Face]) -> bool:
    """Whether all faces, whose patches are straight, have edges along the same directions."""
    corners = [model.surface(face).control_points[[0, -1, 0], [0, 0, -1]] for face in faces]
    edges = np.array([points[1:] - points[0] for points in corners])  # (f, 2, 3)
    edges /= np.linalg.norm(edges, axis=2, keepdims=True)
    cosines = np.abs(edges @ edges[0].T)
    return bool(np.all((cosines < SQUARE) | (cosines > 1 - SQUARE)))


def _box(model: Model, faces: Sequence[Face]) -> Array:
    """Smallest and largest coordinates (2, 3) of the control points of some faces [length]."""
    points = np.concatenate([model.surface(face).control_points.reshape(-1, 3) for face in faces])
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _spans(model: Model, faces: Sequence[Face], box: Array | None = None) -> float:
    """Spans of some faces, each face counted by the share of its control points that a box holds.

    The direction in which the box is thinnest does not count: that is where the gap is.
    """
    total = 0.0
    for face in faces:
        surface = model.surface(face)
        share = 1.0
        if box is not None:
            along = np.delete(np.arange(3), np.argmin(box[1] - box[0]))
            points = surface.control_points.reshape(-1, 3)[:, along]
            share = float(np.all((points >= box[0][along]) & (points <= box[1][along]), axis=1).mean())
        total += share * prod(len(at) - 1 for at in surface.breaks)
    return total
