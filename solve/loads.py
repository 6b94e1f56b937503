"""Nodal forces of pressures, tractions and body forces."""

from collections.abc import Sequence

import numpy as np

from geom2iga.bspline import Array
from geom2iga.errors import CaseError
from geom2iga.model import Model
from geom2iga.patch import Face
from solve.case import BodyForce, Contact, Load
from solve.contact.cells import Cells, find_cells
from solve.face import area_vectors, surface_of, trace_matrix
from solve.material import named_bodies
from solve.space import Space, gauss_points, volume_quadrature

Covers = Sequence[tuple[Contact, tuple[Cells, ...]]]


def assemble_loads(space: Space, loads: Sequence[Load], body_forces: Sequence[BodyForce], covers: Covers) -> Array:
    """Add up all loads.

    Parameters
    ----------
    covers : sequence of (Contact, cells)
        What may cover exposed faces.

    Returns
    -------
    (n, 3)
        Forces on the control points.

    Raises
    ------
    CaseError
        Unknown faces or bodies; an exposed load on a face that takes part in no contact.
    """
    forces = np.zeros((space.size, 3))
    for number, load in enumerate(loads):
        try:
            for face in space.model.faces(load.on):
                forces += face_load(space, face, load)
            if load.exposed:
                forces -= _covered_load(space, load, covers)
        except CaseError as error:
            raise CaseError(f"solve.load[{number}]: {error}") from None
    for number, entry in enumerate(body_forces):
        for body in named_bodies(space.model, entry.bodies, f"solve.body_force[{number}].bodies"):
            forces += body_load(space, body, np.array(entry.force))
    return forces


def face_load(space: Space, face: Face, load: Load) -> Array:
    """Integrate a pressure or traction over a whole face: f_A = ∫ R_A t dΓ, forces (n, 3)."""
    surface = surface_of(space.model, face)
    gauss = gauss_points(surface.patch, [space.point_counts[face.patch][axis] for axis in face.axes])
    _, normal, stretch = area_vectors(surface, gauss.xi)
    return trace_matrix(space, face, gauss.xi).T @ (_traction(load, normal) * (stretch * gauss.weights)[:, None])


def body_load(space: Space, body: str, force: Array) -> Array:
    """Integrate a force per volume (3,) over a body: f_A = ∫ R_A b dV, forces (n, 3)."""
    forces = np.zeros((space.size, 3))
    for name in space.model.bodies[body]:
        for part in volume_quadrature(space.model.patches[name], space.point_counts[name]):
            volume = np.einsum("eqa,eq->ea", part.values, part.volume).ravel()
            share = np.bincount(space.numbers[name][part.indices].ravel(), volume, space.size)
            forces += share[:, None] * force
    return forces


def _traction(load: Load, normal: Array) -> Array:
    """Force per area (q, 3); normals (q, 3) point out of the body."""
    if load.pressure is not None:
        return -load.pressure * normal
    return np.broadcast_to(np.array(load.traction), normal.shape)


def _covered_load(space: Space, load: Load, covers: Covers) -> Array:
    """The load on the part of a face that contact partners cover, cut out exactly whatever the contact's own rule."""
    faces, forces, counted = set(space.model.faces(load.on)), np.zeros((space.size, 3)), set()
    partners = [cover for cover in covers if faces & _sides(space.model, cover[0])]
    if not partners:
        raise CaseError(f'exposed = true, but "{load.on}" takes part in no contact: leave it out')
    for contact, cells in partners:
        exact = contact.model_copy(update={"integration": "segment", "points": None})
        for part in cells if contact == exact else find_cells(space.model, exact):
            pair = frozenset((part.secondary, part.primary))
            if pair in counted:  # either side may be secondary in turn: what is covered counts once
                continue
            counted.add(pair)
            for on_secondary in (True, False):
                if (part.secondary if on_secondary else part.primary) in faces:
                    forces += _cell_load(space, load, part, on_secondary)
    return forces


def _sides(model: Model, contact: Contact) -> set[Face]:
    """All faces of either side of a contact."""
    return {*model.faces(contact.secondary), *model.faces(contact.primary)}


def _cell_load(space: Space, load: Load, cells: Cells, on_secondary: bool) -> Array:
    """The load on one side of some cells, forces (n, 3)."""
    face = cells.secondary if on_secondary else cells.primary
    xi = cells.secondary_xi if on_secondary else cells.primary_xi
    spans = cells.secondary_spans if on_secondary else cells.primary_spans
    area = cells.area if on_secondary else cells.primary_area
    _, normal, _ = area_vectors(surface_of(space.model, face), xi, spans)
    return trace_matrix(space, face, xi, spans).T @ (_traction(load, normal) * area[:, None])
