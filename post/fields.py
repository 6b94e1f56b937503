"""Displacement, stress, pressure and gap at sample points."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from geom2iga.bspline import Array, Indices
from geom2iga.patch import Face, evaluate
from geom2iga.progress import progress, tracked
from post.grid import Grid, face_grid, find_slabs, sample_grid
from solve.bricks import Brick
from solve.contact.cells import nearest_feet
from solve.face import area_vectors, surface_of
from solve.material import hydrostatic_pressure, principal_stress, von_mises
from solve.metric import cofactors_of
from solve.result import ContactResult, Result

SINGULAR = 1e-10  # det J over the product of the lengths of its columns below which it is rounding


@dataclass(frozen=True, eq=False)
class BodySamples:
    """Fields of one patch, or a slab of one, at sample points.

    Parameters
    ----------
    points : (q, 3)
        Undeformed positions [length].
    displacement : (q, 3) [length]
    stress : (q, 6)
        xx yy zz xy yz xz, tension positive.
    cells : (c, 8) or, on a face, (c, 4)
        In VTK's sequence of corners.
    """

    points: Array
    displacement: Array
    stress: Array
    cells: Indices

    @property
    def von_mises(self) -> Array:
        """Von Mises stress (q,)."""
        return von_mises(self.stress)

    @property
    def principal_stress(self) -> Array:
        """Principal stresses (q, 3), the largest first."""
        return principal_stress(self.stress)

    @property
    def hydrostatic_pressure(self) -> Array:
        """Hydrostatic pressure (q,), positive in compression."""
        return hydrostatic_pressure(self.stress)


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
    initial_gap : (q,)
        Before.
    normal : (q, 3)
        Outward normal of the secondary face.
    cells : (c, 4)
    """

    points: Array
    displacement: Array
    pressure: Array
    gap: Array
    initial_gap: Array
    normal: Array
    cells: Indices


@dataclass(frozen=True, eq=False)
class Samples:
    """A result at its sample points; contacts are searched, faces evaluated once for all who ask.

    Parameters
    ----------
    result : Result
    count : int
        Points per span and direction.
    """

    result: Result
    count: int
    _faces: dict[Face, BodySamples] = field(default_factory=dict, init=False)

    @cached_property
    def contacts(self) -> Mapping[ContactResult, tuple[ContactSamples, ...]]:
        """The secondary faces of every pass of every contact."""
        return {contact: sample_contact(self.result, contact, self.count) for contact in self.result.contacts}

    @cached_property
    def secondary(self) -> tuple[ContactSamples, ...]:
        """Every secondary face once; of several contacts at a point the largest pressure and the smallest gap.

        Two contacts meet on the line between their primary faces, where each has its own pressure.
        """
        merged: dict[Face, ContactSamples] = {}
        for contact, parts in self.contacts.items():
            for face, part in zip(self.result.model.faces(contact.definition.secondary), parts, strict=True):
                if face in merged:
                    before = merged[face]
                    part = replace(
                        part,
                        pressure=np.fmax(before.pressure, part.pressure),
                        gap=np.fmin(before.gap, part.gap),
                        initial_gap=np.fmin(before.initial_gap, part.initial_gap),
                    )
                merged[face] = part
        return tuple(merged.values())

    def face(self, face: Face) -> BodySamples:
        """A face of a patch."""
        if face not in self._faces:
            self._faces[face] = sample_face(self.result, face, self.count)
        return self._faces[face]

    def slabs(self, bodies: Iterable[str]) -> Iterator[tuple[str, BodySamples]]:
        """Evaluate all patches of some bodies, slab by slab, and name the patch of each."""
        for name in (name for body in bodies for name in self.result.model.bodies[body]):
            grid = sample_grid(self.result.model.patches[name], self.count, joined=True)
            yield from ((name, part) for part in tracked(_sample_slabs(self.result, name, grid), "slabs"))


def sample_patch(result: Result, name: str, samples: int) -> BodySamples:
    """Sample a whole patch."""
    return _sample_grid(result, name, sample_grid(result.model.patches[name], samples, joined=True))


def sample_face(result: Result, face: Face, samples: int) -> BodySamples:
    """Sample a patch on one of its faces."""
    return _sample_grid(result, face.patch, face_grid(result.model.patches[face.patch], face, samples))


def _sample_grid(result: Result, name: str, grid: Grid) -> BodySamples:
    """Evaluate a whole grid."""
    parts = list(_sample_slabs(result, name, grid))
    each = ("points", "displacement", "stress", "cells")
    return BodySamples(*(np.concatenate([getattr(part, name) for part in parts]) for name in each))


def _sample_slabs(result: Result, name: str, grid: Grid) -> Iterator[BodySamples]:
    """Evaluate a grid slab by slab; cells number the points of the whole grid."""
    patch, material = result.model.patches[name], result.materials[result.model.body_of(name)]
    displacement = result.displacement_of(name).reshape(patch.control_points.shape)
    both = np.moveaxis(np.concatenate([patch.control_points, displacement], axis=-1), -1, 0)
    if patch.is_rational:
        both = np.concatenate([both * patch.weights, patch.weights[None]])
    for slab in find_slabs(patch, grid):
        points, moved, stress = (np.empty((*slab.shape, width)) for width in (3, 3, 6))
        for brick, place in slab.bricks:
            values, gradient = _evaluate_brick(brick, both[:, *brick.functions])
            shape = points[place].shape[:3]
            points[place], moved[place] = (np.moveaxis(v, 0, -1).reshape(*shape, 3) for v in (values[:3], values[3:]))
            stress[place] = material.stress(gradient).reshape(*shape, 6)
        yield BodySamples(points.reshape(-1, 3), moved.reshape(-1, 3), stress.reshape(-1, 6), slab.cells)


def _evaluate_brick(brick: Brick, coefficients: Array) -> tuple[Array, Array]:
    """Place and displacement (6, q) and displacement gradient (q, 3, 3); the latter no number where det J = 0."""
    sampled = brick.gradients(coefficients, values=True)
    if len(sampled) == 7:
        weight = sampled[6]
        sampled = sampled[:6] / weight[3]
        sampled[:, :3] -= sampled[:, 3:] * (weight[:3] / weight[3])
    gradient = np.einsum("iaq,ajq->ijq", sampled[3:, :3], _inverses(sampled[:3, :3]))
    return sampled[:, 3], gradient.transpose(2, 0, 1)


def _inverses(tangents: Array) -> Array:
    """From dx_j/dxi_α (3, 3, q) to dxi_α/dx_j (3, 3, q), not a number where det J is rounding alone."""
    cofactors, determinant = cofactors_of(tangents)
    largest = np.prod(np.linalg.norm(tangents, axis=0), axis=0)
    cofactors /= np.where(np.abs(determinant) <= SINGULAR * largest, np.nan, determinant)
    return cofactors


def sample_at(result: Result, name: str, xi: Array, spans: Indices | None = None) -> BodySamples:
    """Evaluate position, displacement and stress of a patch at any parametric points (q, 3).

    Stress is not a number where det J = 0.
    """
    patch = result.model.patches[name]
    both = np.concatenate([patch.control_points.reshape(-1, 3), result.displacement_of(name)], axis=1)
    values, slopes = evaluate(patch, xi, 1, both, spans)
    gradient = np.einsum("qia,ajq->qij", slopes[:, 3:], _inverses(np.moveaxis(slopes[:, :3], 0, -1)))
    stress = result.materials[result.model.body_of(name)].stress(gradient)
    return BodySamples(values[:, :3], values[:, 3:], stress, np.empty((0, 8), np.int64))


@progress("contact samples")
def sample_contact(result: Result, contact: ContactResult, samples: int) -> tuple[ContactSamples, ...]:
    """Sample the secondary faces of a contact."""
    faces = result.model.faces(contact.definition.secondary)
    return tuple(_sample_secondary(result, contact, face, samples) for face in faces)


def _sample_secondary(result: Result, contact: ContactResult, face: Face, samples: int) -> ContactSamples:
    surface = surface_of(result.model, face)
    grid = sample_grid(surface.patch, samples)
    points, normal, _ = area_vectors(surface, grid.xi)
    numbers = result.space.face_numbers(face)
    displacement = evaluate(surface.patch, grid.xi, 0, result.state.displacement[numbers], grid.spans)[0]
    pressure = result.pressure_at(contact, face, grid.xi, grid.spans)
    gap, initial = np.full((2, len(points)), np.nan)
    for opposite, own, xi in _opposite(result, contact, points, normal):
        initial[own], closing = _gaps(result, opposite, xi, points[own], displacement[own])
        gap[own] = initial[own] + closing
        for other in second_passes(result, contact):
            pressure[own] += result.pressure_at(other, opposite, xi)
    pressure = np.where(np.isnan(gap), 0.0, pressure)
    return ContactSamples(points, displacement, pressure, gap, initial, normal, grid.cells)


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


def _gaps(result: Result, face: Face, xi: Array, points: Array, displacement: Array) -> tuple[Array, Array]:
    """Gaps (q,) of points to those of a primary face at xi, before deformation, and what this adds to them."""
    surface = surface_of(result.model, face)
    feet, outward, _ = area_vectors(surface, xi)
    moved = evaluate(surface.patch, xi, 0, result.state.displacement[result.space.face_numbers(face)])[0]
    before, added = (np.einsum("qk,qk->q", each, outward) for each in (points - feet, displacement - moved))
    return before, added
