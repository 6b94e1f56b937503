"""Contact pressure from the control-point gap."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from geom2iga.bspline import Array
from solve.case import Contact
from solve.face import area_vectors, surface_of
from solve.material import Material
from solve.space import Space, gauss_points

AUTOMATIC = 10.0  # penalty in units of E/h
STEADY = 100.0  # stiffness of the springs that multipliers are found with, in units of E/h
STIFF = 1000.0  # penalties above this, in units of E/h, would lose digits as springs

Multiplier = Literal["none", "updated", "solved"]


@dataclass(frozen=True, eq=False)
class Penalty:
    """Pressure proportional to overlap.                                             paper, eq. (16)

    Parameters
    ----------
    stiffness : (m,)
        Penalty of each gap [stress/length].
    bodies : (m,)
        E/h, what the bodies under one gap resist with [stress/length]; infinite for rigid ones.
    """

    stiffness: Array
    bodies: Array | float = np.inf

    def yielding(self, count: int) -> "Penalty":
        """The same where so many gaps press on elastic half-spaces: under a pressure p an area A sinks by p √A / E."""
        return Penalty(1 / (1 / self.stiffness + count**0.5 / self.bodies))

    def pressure(self, gap: Array) -> Array:
        """Pressure (m,) from gaps (m,), positive in compression, zero where open."""
        return -self.stiffness * np.minimum(gap, 0.0)

    def energy(self, gap: Array, area: Array) -> float:
        """Energy of the overlaps: ½ Σ_A ε A_A min(g_A, 0)²."""
        return float(np.sum(self.stiffness * area * np.minimum(gap, 0.0) ** 2) / 2)


@dataclass(frozen=True, eq=False)
class Law:
    """What a contact asks for, p >= 0, g + c p >= 0, p (g + c p) = 0, and the springs that it is found with.

    Newton's steps have p = s max(0, λ (1/s - c) - g) with a multiplier λ that is given. Its solution is that of the
    law where λ = p (the proximal method of multipliers: Rockafellar 1976); for a penalty s c = 1, and λ drops out.

    Parameters
    ----------
    stiffness : (m,)
        s [stress/length]
    compliance : (m,)
        c, what is left of overlap per pressure [length/stress].
    multiplier : str
        "none"; "updated" by λ <- p (Uzawa) until the overlap is small enough; "solved" for, as an unknown.
    bodies : (m,)
        E/h of the bodies under one gap [stress/length]; infinite for rigid ones.
    """

    stiffness: Array
    compliance: Array
    multiplier: Multiplier = "none"
    bodies: Array | float = np.inf

    @property
    def springs(self) -> Penalty:
        """The law of Newton's steps, of shifted gaps."""
        return Penalty(self.stiffness, self.bodies)

    @property
    def softness(self) -> Array:
        """Gap (m,) that a unit multiplier shifts, 1/s - c [length/stress]."""
        shift = 1 / self.stiffness - self.compliance
        return np.where(shift > 1e-12 / self.stiffness, shift, 0.0)


def penalty_law(penalty: float, rows: int, scale: float) -> Law:
    """Pressure proportional to overlap; of a large penalty the pressure is an unknown of its own.

    Parameters
    ----------
    penalty : float
        [stress/length]
    rows : int
        Number of gaps.
    scale : float
        E/h [stress/length].
    """
    ones = np.ones(rows)
    if penalty <= STIFF * scale:
        return Law(penalty * ones, ones / penalty, "none", scale * ones)
    return Law(ones / (1 / penalty + 1 / (STEADY * scale)), ones / penalty, "solved", scale * ones)


def augmented_law(penalty: float, rows: int, scale: float) -> Law:
    """No overlap, by updates of a multiplier; a large penalty would lose digits and gain nothing."""
    return Law(np.full(rows, min(penalty, STIFF * scale)), np.zeros(rows), "updated", np.full(rows, scale))


def multiplier_law(rows: int, scale: float) -> Law:
    """No overlap, the multiplier an unknown."""
    return Law(np.full(rows, STEADY * scale), np.zeros(rows), "solved", np.full(rows, scale))


def find_penalty(contact: Contact, scale: float, share: float = 1.0) -> float:
    """Return the penalty of a contact [stress/length], 10 E/h unless it is given; infinite for a multiplier alone."""
    if contact.enforcement == "lagrange":
        return np.inf
    return share * (AUTOMATIC * scale if contact.penalty == "auto" else contact.penalty)


def find_law(contact: Contact, rows: int, scale: float, share: float = 1.0) -> Law:
    """Make the law of a contact.

    Parameters
    ----------
    rows : int
        Number of gaps.
    scale : float
        E/h [stress/length].
    share : float
        Of the pressure that this pass of the contact carries.
    """
    penalty = find_penalty(contact, scale, share)
    if contact.enforcement == "lagrange":
        return multiplier_law(rows, scale)
    make = augmented_law if contact.enforcement == "augmented-lagrange" else penalty_law
    return make(penalty, rows, scale)


def joined(laws: Sequence[Law]) -> Law:
    """Put the laws of several contacts below each other; the most demanding way to find the multipliers counts."""
    ways: tuple[Multiplier, ...] = ("none", "updated", "solved")
    way = max((law.multiplier for law in laws), key=ways.index, default=ways[0])
    names = ("stiffness", "compliance", "bodies")
    parts = ([np.broadcast_to(getattr(law, name), law.stiffness.shape) for law in laws] for name in names)
    stiffness, compliance, bodies = (np.concatenate([np.empty(0), *part]) for part in parts)
    return Law(stiffness, compliance, way, bodies)


def stiffness_scale(space: Space, contact: Contact, materials: Mapping[str, Material]) -> float:
    """Return E/h of a contact [stress/length].

    E is the smaller Young's modulus of the two bodies, h the root of the area of the smallest secondary span, so that
    meshes may be graded towards the contact.
    """
    model = space.model
    faces = (*model.faces(contact.secondary), *model.faces(contact.primary))
    young = min(materials[model.body_of(face.patch)].young for face in faces)
    smallest = np.inf
    for face in model.faces(contact.secondary):
        surface = surface_of(model, face)
        points = gauss_points(surface.patch)
        areas = (points.weights * area_vectors(surface, points.xi)[2]).reshape(-1, points.per_span).sum(axis=1)
        smallest = min(smallest, float(areas.min()))
    return young / smallest**0.5
