"""Faces of a model as oriented surfaces: positions, outward normals, planes, traces of the basis."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from geom2iga.bspline import Array, Indices
from geom2iga.errors import CaseError
from geom2iga.model import Model
from geom2iga.patch import Face, Patch, basis, evaluate
from solve.space import FLAT, Space


class CurvedError(CaseError):
    """A face is curved, or its knot lines are; whoever needs it otherwise adds what to do."""


@dataclass(frozen=True)
class Surface:
    """A face, what to call it, its patch of two directions, and the sign that turns its t_1 x t_2 outward."""

    face: Face
    name: str
    patch: Patch
    outward: int


class Plane(NamedTuple):
    """A plane face: a point, two unit vectors in it, its outward unit normal."""

    origin: Array  # (3,)
    frame: Array  # (2, 3)
    normal: Array  # (3,)


def surface_of(model: Model, face: Face) -> Surface:
    """Take a face of a model as an oriented surface."""
    name = next((group for group, faces in model.groups.items() if face in faces), str(face))
    return Surface(face, f'"{name}"', model.surface(face), face.outward)


def area_vectors(surface: Surface, xi: Array, spans: Indices | None = None) -> tuple[Array, Array, Array]:
    """Evaluate positions and outward normals.

    Parameters
    ----------
    spans : (q, 2)
        Whose polynomial to evaluate, as knot index; left out, the span that holds the point.

    Returns
    -------
    points : (q, 3) [length]
    normal : (q, 3)
        Outward unit normals; zero where the tangents span no plane, at the end of an edge without length.
    stretch : (q,)
        Area per parametric area [length²].
    """
    points, tangents = evaluate(surface.patch, xi, 1, spans=spans)
    directed = np.cross(tangents[:, :, 0], tangents[:, :, 1]) * surface.outward
    stretch = np.linalg.norm(directed, axis=1)
    return points, directed / np.where(stretch > 0, stretch, 1.0)[:, None], stretch


def find_plane(surface: Surface) -> Plane:
    """Find the plane that a face lies in; raise CurvedError where there is none."""
    points = surface.patch.control_points.reshape(-1, 3)
    origin = points.mean(axis=0)
    _, widths, axes = np.linalg.svd(points - origin, full_matrices=False)
    if widths[2] > FLAT * widths[0]:
        raise CurvedError(f"{surface.name} is curved")
    middle = np.array([[at.mean() for at in surface.patch.breaks]])
    normal = np.cross(axes[0], axes[1])
    normal = np.where(np.abs(normal) < 1e-15, 0.0, normal)  # so that a normal along an axis is exactly so
    normal *= np.sign(normal @ area_vectors(surface, middle)[1][0]) / np.linalg.norm(normal)
    return Plane(origin, axes[:2], normal)


def trace_matrix(space: Space, face: Face, xi: Array, spans: Indices | None = None) -> csr_array:
    """Basis functions of a face at its parametric points, (q, n) over all control points.

    Parameters
    ----------
    spans : (q, 2)
        Whose polynomials to evaluate, as knot index; left out, those of the span that holds the point.
    """
    functions = basis(space.model.surface(face), xi, spans=spans)
    columns = space.face_numbers(face)[functions.indices]
    starts = np.arange(len(xi) + 1) * columns.shape[1]
    return csr_array((functions.values.ravel(), columns.ravel(), starts), shape=(len(xi), space.size))
