"""Contact pressure from the control-point gap."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from geom2iga.bspline import Array
from solve.case import Contact
from solve.face import area_vectors, surface_of
from solve.material import Material
from solve.space import Space, gauss_points

AUTOMATIC = 10.0  # penalty in units of E/h


@dataclass(frozen=True, eq=False)
class Penalty:
    """Pressure proportional to overlap.                                             paper, eq. (16)

    Parameters
    ----------
    stiffness : (m,)
        Penalty of each secondary control point [stress/length].
    """

    stiffness: Array

    def pressure(self, gap: Array) -> Array:
        """Pressure (m,) from control gaps (m,), positive in compression, zero where open."""
        return -self.stiffness * np.minimum(gap, 0.0)

    def energy(self, gap: Array, area: Array) -> float:
        """Energy of the overlaps: ½ Σ_A ε A_A min(g_A, 0)²."""
        return float(np.sum(self.stiffness * area * np.minimum(gap, 0.0) ** 2) / 2)


def find_penalty(space: Space, contact: Contact, materials: Mapping[str, Material]) -> float:
    """Return the penalty of a contact [stress/length], 10 E/h unless it is given.

    E is the smaller Young's modulus of the two bodies, h the root of the mean area of the secondary spans.
    """
    if contact.penalty != "auto":
        return contact.penalty
    model = space.model
    faces = (*model.faces(contact.secondary), *model.faces(contact.primary))
    young = min(materials[model.body_of(face.patch)].young for face in faces)
    area, spans = 0.0, 0
    for face in model.faces(contact.secondary):
        surface = surface_of(model, face)
        points = gauss_points(surface.patch)
        area += float(points.weights @ area_vectors(surface, points.xi)[2])
        spans += len(points.xi) // points.per_span
    return AUTOMATIC * young / (area / spans) ** 0.5
