"""How many times displacements are drawn."""

import numpy as np

from geom2iga.model import Model
from post.fields import sample_contact
from solve.result import ContactResult, Result

VISIBLE = 0.08  # largest displacement drawn, in sizes of the model
OVERLAP = 0.002  # largest overlap drawn of bodies in contact, in sizes of the model
POINTS = 10_000  # where gaps of a contact are looked at, about
SAMPLES = (3, 9)  # per span and direction, odd: the middle of a span is where a round face is lowest
ROUNDING = 1e-4  # stress below this fraction of that of a strain of displacement over size counts as none


def size_of(result: Result) -> float:
    """Size of a model: the diagonal of the box around its control points [length]."""
    return float(np.linalg.norm(np.ptp(result.space.control_points, axis=0)))


def stress_of(result: Result) -> float:
    """A stress against which rounding can be told: that of the largest displacement spread over the model."""
    largest = float(np.linalg.norm(result.state.displacement, axis=1).max())
    return ROUNDING * max(material.young for material in result.materials.values()) * largest / size_of(result)


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
        for part in sample_contact(result, contact, _samples(result.model, contact)):
            closing = part.initial_gap - part.gap
            closes = closing > 0
            left = (part.initial_gap + OVERLAP * size)[closes] / closing[closes]
            limit = min(limit, left.min(initial=limit))
    return _round_below(limit)


def _samples(model: Model, contact: ContactResult) -> int:
    """Points per span and direction, an odd number."""
    surfaces = [model.surface(face) for face in model.faces(contact.definition.secondary)]
    spans = sum(np.prod([len(at) - 1 for at in surface.breaks]) for surface in surfaces)
    fewest, most = SAMPLES
    return int(np.clip((POINTS / spans) ** 0.5, fewest, most)) // 2 * 2 + 1


def _round_below(limit: float) -> float:
    """The largest 1, 2 or 5 times a power of ten below a limit, at least 1."""
    if limit <= 1:
        return 1.0
    power = 10.0 ** np.floor(np.log10(limit))
    return float(max(step * power for step in (1, 2, 5) if step * power <= limit))
