"""How many times displacements are drawn."""

from collections.abc import Iterator

import numpy as np

from geom2iga.bspline import Array
from geom2iga.patch import evaluate
from post.grid import sample_grid
from solve.contact.cells import nearest_feet
from solve.face import area_vectors, surface_of
from solve.result import ContactResult, Result

VISIBLE = 0.08  # largest displacement drawn, in sizes of the model
OVERLAP = 0.002  # largest overlap drawn of bodies in contact, in sizes of the model
SAMPLES = 2  # per span and direction, where gaps are looked at


def size_of(result: Result) -> float:
    """Size of a model: the diagonal of the box around its control points [length]."""
    return float(np.linalg.norm(np.ptp(result.space.control_points, axis=0)))


def deformation_scale(result: Result) -> float:
    """Choose a factor of 1, 2 or 5 times a power of ten, at least 1, that makes displacements visible.

    Bodies that start apart, or touch at one point alone, would seem to run through each other where displacements are
    drawn enlarged: at s times the displacement, a gap is g(s) = g(0) + s (g(1) - g(0)) along the normal. So the factor
    is the largest at which no drawn gap of a contact is a visible overlap.
    """
    largest = np.linalg.norm(result.state.displacement, axis=1).max()
    if largest == 0:
        return 1.0
    size = size_of(result)
    limit = VISIBLE * size / largest
    for contact in result.pairs:
        for before, after in _gaps(result, contact):
            closing = before - after
            closes = closing > 0
            limit = min(limit, ((before + OVERLAP * size)[closes] / closing[closes]).min(initial=limit))
    return _round_below(limit)


def _round_below(limit: float) -> float:
    """The largest 1, 2 or 5 times a power of ten below a limit, at least 1."""
    if limit <= 1:
        return 1.0
    power = 10.0 ** np.floor(np.log10(limit))
    return float(max(step * power for step in (1, 2, 5) if step * power <= limit))


def _gaps(result: Result, contact: ContactResult) -> Iterator[tuple[Array, Array]]:
    """Yield the gaps (q,) [length] of points of the secondary faces before and after deformation."""
    primary = [surface_of(result.model, face) for face in result.model.faces(contact.definition.primary)]
    for face in result.model.faces(contact.definition.secondary):
        surface = surface_of(result.model, face)
        xi = sample_grid(surface.patch, SAMPLES, joined=True).xi
        points, normal, _ = area_vectors(surface, xi)
        moved = evaluate(surface.patch, xi, 0, result.state.displacement[result.space.face_numbers(face)])[0]
        nearest, feet = nearest_feet(points, normal, primary)
        for number, opposite in enumerate(primary):
            own = np.flatnonzero(nearest == number)
            places, outward, _ = area_vectors(opposite, feet[own])
            numbers = result.space.face_numbers(opposite.face)
            other = evaluate(opposite.patch, feet[own], 0, result.state.displacement[numbers])[0]
            before = np.einsum("qk,qk->q", points[own] - places, outward)
            yield before, before + np.einsum("qk,qk->q", moved[own] - other, outward)
