"""Spaces of contact pressures: what gaps are averaged with, and how pressures are evaluated."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import ClassVar, Protocol

import numpy as np
from scipy.sparse import csr_array, eye_array
from scipy.spatial import cKDTree

from geom2iga import bspline
from geom2iga.bspline import Array, Indices
from geom2iga.errors import CaseError
from geom2iga.patch import Face, Patch, evaluate
from solve.case import Contact
from solve.contact.cells import Cells
from solve.face import trace_matrix
from solve.space import Space


class PressureSpace(Protocol):
    """Functions on the secondary side, none negative, whose coefficients are the contact pressures."""

    @property
    def size(self) -> int:
        """Number of functions."""

    @property
    def pointwise(self) -> bool:
        """Whether each point has a function of its own; else those of one span are the same at all its points."""

    def functions(self, cells: Cells, before: int) -> csr_array:
        """All functions (q, size) at the points of some cells, `before` points of other cells."""

    def field(self, face: Face, xi: Array, spans: Indices | None, rows: Indices, pressure: Array) -> Array:
        """Evaluate the pressure (q,) at points (q, 2) of a face, in spans (q, 2), from that (m,) of functions (m,)."""


@dataclass(frozen=True, eq=False)
class ControlPointPressures:
    """The basis of the displacements: mortar-KTS.                                   paper, eq. (25)"""

    space: Space
    pointwise: ClassVar[bool] = False

    @property
    def size(self) -> int:
        """One function per control point of the model."""
        return self.space.size

    def functions(self, cells: Cells, before: int) -> csr_array:
        """Evaluate the basis of the face that the cells lie on."""
        return trace_matrix(self.space, cells.secondary, cells.secondary_xi, cells.secondary_spans)

    def field(self, face: Face, xi: Array, spans: Indices | None, rows: Indices, pressure: Array) -> Array:
        """Evaluate the spline whose control values are the pressures."""
        values = np.zeros((self.size, 1))
        values[rows, 0] = pressure
        return evaluate(self.space.model.surface(face), xi, 0, values[self.space.face_numbers(face)], spans)[0][:, 0]


@dataclass(frozen=True, eq=False)
class ReducedPressures:
    """B-splines of degree p - 2 and smoothness p - 3 on the spans of each face.

    They are inf-sup stable with displacements of degree p (Brivadis, Buffa, Wohlmuth & Wunderlich 2015); for contact:
    Antolin, Buffa & Fabre 2019.

    Parameters
    ----------
    surfaces : face to Patch
        The secondary faces.
    """

    surfaces: Mapping[Face, Patch]
    pointwise: ClassVar[bool] = False

    @cached_property
    def directions(self) -> Mapping[Face, tuple[tuple[Array, int], ...]]:
        """Knots and degree of the functions of each face along its two directions."""
        return {
            face: tuple((_capped(k[2:-2], p - 2), p - 2) for k, p in zip(patch.knots, patch.degrees, strict=True))
            for face, patch in self.surfaces.items()
        }

    @cached_property
    def shapes(self) -> Mapping[Face, tuple[int, ...]]:
        """Number of functions of each face along its two directions."""
        return {face: tuple(len(k) - p - 1 for k, p in along) for face, along in self.directions.items()}

    @property
    def size(self) -> int:
        """The functions of all faces."""
        return sum(map(prod, self.shapes.values()))

    def functions(self, cells: Cells, before: int) -> csr_array:
        """Evaluate the B-splines of the face that the cells lie on."""
        return self._matrix(cells.secondary, cells.secondary_xi, cells.secondary_spans)

    def field(self, face: Face, xi: Array, spans: Indices | None, rows: Indices, pressure: Array) -> Array:
        """Evaluate the spline whose coefficients are the pressures."""
        values = np.zeros(self.size)
        values[rows] = pressure
        return self._matrix(face, xi, spans) @ values

    def _matrix(self, face: Face, xi: Array, spans: Indices | None) -> csr_array:
        """All functions at points of a face, (q, size)."""
        faces, shape = list(self.shapes), self.shapes[face]
        start = sum(prod(self.shapes[other]) for other in faces[: faces.index(face)])
        (first, one), (second, other) = (self._along(face, d, xi, spans) for d in range(2))
        columns = (first[:, :, None] * shape[1] + second[:, None, :]).reshape(len(xi), -1) + start
        values = one[:, :, None] * other[:, None, :]
        starts = np.arange(len(xi) + 1) * columns.shape[1]
        return csr_array((values.ravel(), columns.ravel(), starts), shape=(len(xi), self.size))

    def _along(self, face: Face, d: int, xi: Array, spans: Indices | None) -> tuple[Indices, Array]:
        """Numbers and values (q, a) of the functions along one direction."""
        knots, degree = self.directions[face][d]
        of_face = self.surfaces[face].knots[d]
        inside = xi[:, d] if spans is None else (of_face[spans[:, d]] + of_face[spans[:, d] + 1]) / 2
        first, values = bspline.basis(knots, degree, xi[:, d], 0, bspline.find_spans(knots, degree, inside))
        return first[:, None] + np.arange(degree + 1), values[0]


@dataclass(frozen=True, eq=False)
class PointPressures:
    """A pressure at each quadrature point: KTS (Temizer, Wriggers & Hughes 2011).

    Parameters
    ----------
    space : Space
    points : (size, 3)
        Quadrature points on the secondary side [length]; of a result those whose area counts, row by row.
    """

    space: Space
    points: Array
    pointwise: ClassVar[bool] = True

    @property
    def size(self) -> int:
        """One function per point."""
        return len(self.points)

    def functions(self, cells: Cells, before: int) -> csr_array:
        """Make functions that are one at one point and zero at all others."""
        return csr_array(eye_array(len(cells.area), self.size, k=before))

    def field(self, face: Face, xi: Array, spans: Indices | None, rows: Indices, pressure: Array) -> Array:
        """Take the pressure of the nearest point."""
        at = evaluate(self.space.model.surface(face), xi)[0]
        return pressure[cKDTree(self.points).query(at)[1]] if len(pressure) else np.zeros(len(xi))


def pressure_space(space: Space, contact: Contact, points: Array) -> PressureSpace:
    """Make the space that a contact asks for.

    Parameters
    ----------
    points : (q, 3)
        Quadrature points on the secondary side, part by part.

    Raises
    ------
    CaseError
        The degree is too low for a multiplier of degree p - 2.
    """
    if contact.method == "kts":
        return PointPressures(space, points)
    if contact.multiplier == "p":
        return ControlPointPressures(space)
    surfaces = {face: space.model.surface(face) for face in space.model.faces(contact.secondary)}
    for face, patch in surfaces.items():
        if min(patch.degrees) < 2:
            degrees = " and ".join(map(str, patch.degrees))
            raise CaseError(
                f'multiplier = "p-2" needs degree 2 or more, "{contact.secondary}" on patch "{face.patch}" has '
                f"{degrees}: raise it, or leave multiplier out"
            )
    return ReducedPressures(surfaces)


def _capped(knots: Array, degree: int) -> Array:
    """Leave out knots beyond degree + 1 times the same."""
    at, counts = np.unique(knots, return_counts=True)
    return np.repeat(at, np.minimum(counts, degree + 1))
