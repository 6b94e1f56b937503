"""Displacement, stress, pressure and gap at sample points."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geom2iga.bspline import Array, Indices, find_spans
from geom2iga.patch import Face, Patch, evaluate
from solve.contact.cells import nearest_feet
from solve.face import area_vectors, surface_of
from solve.material import von_mises
from solve.result import ContactResult, Result


@dataclass(frozen=True, eq=False)
class Grid:
    """Sample points of a patch, `samples` per span and direction; spans do not share points.

    Parameters
    ----------
    xi : (q, d)
        Parametric points.
    spans : (q, d)
        The span each point belongs to, so that values at its ends are those from inside.
    cells : (c, 4) or (c, 8)
        Quadrilaterals or hexahedra between the points, in VTK's sequence of corners.
    """

    xi: Array
    spans: Indices
    cells: Indices


@dataclass(frozen=True, eq=False)
class BodySamples:
    """Fields of one patch at sample points.

    Parameters
    ----------
    points : (q, 3)
        Undeformed positions [length].
    displacement : (q, 3) [length]
    stress : (q, 6)
        xx yy zz xy yz xz, tension positive.
    cells : (c, 8) or, on a face, (c, 4)
    """

    points: Array
    displacement: Array
    stress: Array
    cells: Indices

    @property
    def von_mises(self) -> Array:
        """Von Mises stress (q,)."""
        return von_mises(self.stress)


@dataclass(frozen=True, eq=False)
class ContactSamples:
    """Fields of the secondary face of a contact at sample points.

    Parameters
    ----------
    points : (q, 3)
        Undeformed positions [length].
    displacement : (q, 3) [length]
    pressure : (q,)
        Positive in compression; zero where the primary side is not opposite.
    gap : (q,)
        After deformation [length], positive where open; not a number where the primary side is not opposite.
    normal : (q, 3)
        Outward normal of the secondary face.
    cells : (c, 4)
    """

    points: Array
    displacement: Array
    pressure: Array
    gap: Array
    normal: Array
    cells: Indices


def sample_grid(patch: Patch, samples: int) -> Grid:
    """Place sample points in every span, ends included."""
    each, spans = [], []
    for knots, at, degree in zip(patch.knots, patch.breaks, patch.degrees, strict=True):
        fractions = np.linspace(0, 1, samples)
        each.append((at[:-1, None] * (1 - fractions) + at[1:, None] * fractions).ravel())
        spans.append(np.repeat(find_spans(knots, degree, at[:-1]), samples))
    shape = tuple(len(axis) for axis in each)
    xi, knot_spans = (np.stack(np.meshgrid(*a, indexing="ij"), axis=-1).reshape(-1, len(shape)) for a in (each, spans))
    return Grid(xi, knot_spans, _grid_cells(shape, samples))


def _grid_cells(shape: Sequence[int], samples: int) -> Indices:
    """Cells between neighbouring points of one span, in VTK's sequence of corners."""
    starts = [np.arange(n).reshape(-1, samples)[:, :-1].ravel() for n in shape]
    first = np.ravel_multi_index(np.meshgrid(*starts, indexing="ij"), tuple(shape)).ravel()
    strides = [int(np.prod(shape[d + 1 :])) for d in range(len(shape))]
    square = np.array([0, strides[0], strides[0] + strides[1], strides[1]])
    corners = square if len(shape) == 2 else np.concatenate([square, square + strides[2]])
    return first[:, None] + corners


def sample_patch(result: Result, name: str, samples: int) -> BodySamples:
    """Sample a whole patch."""
    grid = sample_grid(result.model.patches[name], samples)
    return sample_at(result, name, grid.xi, grid.spans, grid.cells)


def sample_face(result: Result, face: Face, samples: int) -> BodySamples:
    """Sample a patch on one of its faces."""
    patch = result.model.patches[face.patch]
    grid = sample_grid(result.model.surface(face), samples)
    end = patch.knots[face.axis][-face.side]
    span = find_spans(patch.knots[face.axis], patch.degrees[face.axis], end)
    xi, spans = np.insert(grid.xi, face.axis, end, axis=1), np.insert(grid.spans, face.axis, span, axis=1)
    return sample_at(result, face.patch, xi, spans, grid.cells)


def sample_at(
    result: Result, name: str, xi: Array, spans: Indices | None = None, cells: Indices | None = None
) -> BodySamples:
    """Evaluate position, displacement and stress of a patch at parametric points (q, 3)."""
    patch = result.model.patches[name]
    both = np.concatenate([patch.control_points.reshape(-1, 3), result.displacement_of(name)], axis=1)
    values, slopes = evaluate(patch, xi, 1, both, spans)
    gradient = slopes[:, 3:] @ np.linalg.inv(slopes[:, :3])
    stress = result.materials[result.model.body_of(name)].stress(gradient)
    return BodySamples(values[:, :3], values[:, 3:], stress, np.empty((0, 8), np.int64) if cells is None else cells)


def sample_contact(result: Result, contact: ContactResult, samples: int) -> tuple[ContactSamples, ...]:
    """Sample the secondary faces of a contact."""
    faces = result.model.faces(contact.definition.secondary)
    return tuple(_sample_secondary(result, contact, face, samples) for face in faces)


def sample_secondary(result: Result, samples: int) -> tuple[ContactSamples, ...]:
    """Sample every secondary face once; pressures of several contacts on it add up, the smallest gap counts."""
    merged: dict[Face, ContactSamples] = {}
    for contact in result.contacts:
        faces = result.model.faces(contact.definition.secondary)
        for face, part in zip(faces, sample_contact(result, contact, samples), strict=True):
            if face in merged:
                pressure, gap = merged[face].pressure + part.pressure, np.fmin(merged[face].gap, part.gap)
                part = replace(part, pressure=pressure, gap=gap)
            merged[face] = part
    return tuple(merged.values())


def _sample_secondary(result: Result, contact: ContactResult, face: Face, samples: int) -> ContactSamples:
    surface = surface_of(result.model, face)
    grid = sample_grid(surface.patch, samples)
    points, normal, _ = area_vectors(surface, grid.xi)
    numbers = result.space.face_numbers(face)
    displacement = evaluate(surface.patch, grid.xi, 0, result.state.displacement[numbers], grid.spans)[0]
    pressure = result.pressure_at(contact, face, grid.xi, grid.spans)
    gap = np.full(len(points), np.nan)
    for opposite, own, xi in _opposite(result, contact, points, normal):
        gap[own] = _gaps(result, opposite, xi, points[own] + displacement[own])
        for other in second_passes(result, contact):
            pressure[own] += result.pressure_at(other, opposite, xi)
    pressure = np.where(np.isnan(gap), 0.0, pressure)
    return ContactSamples(points, displacement, pressure, gap, normal, grid.cells)


def second_passes(result: Result, contact: ContactResult) -> tuple[ContactResult, ...]:
    """Find the pass of a contact that has the sides of this one exchanged, if it has two passes."""
    sides = {"secondary": contact.definition.primary, "primary": contact.definition.secondary}
    other = contact.definition.model_copy(update=sides)
    return tuple(c for c in result.contacts if contact.definition.two_pass and c.definition == other)


def _opposite(
    result: Result, contact: ContactResult, points: Array, normal: Array
) -> Iterator[tuple[Face, Indices, Array]]:
    """Yield the primary faces, which of the secondary points (q,) lie opposite each, and where on it."""
    faces = result.model.faces(contact.definition.primary)
    nearest, xi = nearest_feet(points, normal, [surface_of(result.model, face) for face in faces])
    for number, face in enumerate(faces):
        own = np.flatnonzero(nearest == number)
        yield face, own, xi[own]


def _gaps(result: Result, face: Face, xi: Array, points: Array) -> Array:
    """Gap (q,) between displaced points and those of a primary face at xi, displaced, too."""
    surface = surface_of(result.model, face)
    feet, outward, _ = area_vectors(surface, xi)
    moved = evaluate(surface.patch, xi, 0, result.state.displacement[result.space.face_numbers(face)])[0]
    return np.einsum("qk,qk->q", points - feet - moved, outward)
