"""Faces of a model as oriented surfaces: positions, outward normals, planes, traces of the basis."""

from dataclasses import dataclass, replace
from functools import cached_property
from math import prod
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from geom2iga.bspline import Array, Indices
from geom2iga.errors import CaseError
from geom2iga.model import Model
from geom2iga.patch import CHUNK, FLAT, Face, Patch, basis, chunks, evaluate, resolution
from solve.space import Space


class CurvedError(CaseError):
    """A face is curved, or its knot lines are; whoever needs it otherwise adds what to do."""


class Cone(NamedTuple):
    """Directions no farther than an angle from an axis."""

    axis: Array  # (3,) unit vector
    angle: float  # in radians


@dataclass(frozen=True)
class Surface:
    """A face as an oriented surface.

    Parameters
    ----------
    face : Face
    name : str
        What to call it.
    patch : Patch
        Of two directions.
    outward : int
        Sign that turns its t_1 x t_2 outward.
    rounding : float
        What its control points are off by, as they are rounded [length].
    """

    face: Face
    name: str
    patch: Patch
    outward: int
    rounding: float = 0.0

    @cached_property
    def is_affine(self) -> bool:
        """Whether position is an affine function of the parameters."""
        return self.patch.is_affine_within(self.rounding)

    def moved(self, by: Array) -> "Surface":
        """The same elsewhere."""
        return replace(self, patch=replace(self.patch, control_points=self.patch.control_points + by))

    @cached_property
    def cone(self) -> Cone:
        """Where the outward normals lie: those at the breaks and halfway between, and as far again as two of them."""
        axes = halved(self.patch)
        xi = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        normal = area_vectors(self, xi.reshape(-1, 2))[1].reshape(xi.shape[0], xi.shape[1], 3)
        axis = normal.mean(axis=(0, 1))
        axis /= max(np.linalg.norm(axis), np.finfo(float).tiny)
        turns = [np.linalg.norm(np.diff(normal, axis=d), axis=2).max() for d in range(2)]
        return Cone(axis, float(2 * np.arcsin(np.linalg.norm(normal - axis, axis=2).max() / 2) + sum(turns)))


class Plane(NamedTuple):
    """A plane face: a point, two unit vectors in it, its outward unit normal."""

    origin: Array  # (3,)
    frame: Array  # (2, 3)
    normal: Array  # (3,)


def surface_of(model: Model, face: Face) -> Surface:
    """Take a face of a model as an oriented surface."""
    name = next((group for group, faces in model.groups.items() if face in faces), str(face))
    patch = model.surface(face)
    return Surface(face, f'"{name}"', patch, face.outward, resolution(patch.control_points))


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
    points = surface.patch.control_points.reshape(-1, 3)
    origin = points[0]  # differences from it, so that a normal along an axis is exactly so
    offset, tangents = evaluate(surface.patch, xi, 1, points - origin, spans)
    directed = np.cross(tangents[:, :, 0], tangents[:, :, 1]) * surface.outward
    stretch = np.linalg.norm(directed, axis=1)
    return origin + offset, directed / np.where(stretch > 0, stretch, 1.0)[:, None], stretch


def halved(patch: Patch) -> list[Array]:
    """Breaks of each direction, and the middles between them."""
    return [np.sort(np.concatenate([at, (at[1:] + at[:-1]) / 2])) for at in patch.breaks]


def find_plane(surface: Surface) -> Plane:
    """Find the plane that a face lies in; raise CurvedError where there is none."""
    points = surface.patch.control_points.reshape(-1, 3)
    origin = points[0] + (points - points[0]).mean(axis=0)
    _, widths, axes = np.linalg.svd(points - origin, full_matrices=False)
    if widths[2] > FLAT * widths[0] + len(points) ** 0.5 * resolution(points):
        raise CurvedError(f"{surface.name} is curved")
    middle = np.array([[at.mean() for at in surface.patch.breaks]])
    normal = np.cross(axes[0], axes[1])
    normal = np.where(np.abs(normal) < 1e-15, 0.0, normal)  # so that a normal along an axis is exactly so
    normal *= np.sign(normal @ area_vectors(surface, middle)[1][0]) / np.linalg.norm(normal)
    return Plane(origin, axes[:2], normal)


def trace(space: Space, face: Face, xi: Array, spans: Indices | None = None) -> tuple[Indices, Array]:
    """Basis functions of a face at its parametric points: global numbers (q, a) and values (q, a)."""
    functions = basis(space.model.surface(face), xi, spans=spans)
    return space.face_numbers(face)[functions.indices], functions.values


def trace_matrix(space: Space, face: Face, xi: Array, spans: Indices | None = None) -> csr_array:
    """Basis functions of a face at its parametric points, (q, n) over all control points.

    Parameters
    ----------
    spans : (q, 2)
        Whose polynomials to evaluate, as knot index; left out, those of the span that holds the point.
    """
    columns, values = trace(space, face, xi, spans)
    starts = np.arange(len(xi) + 1) * columns.shape[1]
    return csr_array((values.ravel(), columns.ravel(), starts), shape=(len(xi), space.size))


def nodal_forces(surface: Surface, xi: Array, spans: Indices, forces: Array) -> Array:
    """Share forces (q, 3) at points (q, 2) of given spans (q, 2) among the control points: f_a = Σ_q R_a(q) f_q.

    Returns
    -------
    (c, 3)
        In the flat numbering of the surface.
    """
    shared = np.zeros((surface.patch.weights.size, 3))
    for part in chunks(len(xi), CHUNK // (4 * prod(p + 1 for p in surface.patch.degrees))):
        functions = basis(surface.patch, xi[part], spans=spans[part])
        for k in range(3):
            work = functions.values * forces[part, k, None]
            shared[:, k] += np.bincount(functions.indices.ravel(), work.ravel(), len(shared))
    return shared
