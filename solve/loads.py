"""Nodal forces of pressures, tractions and body forces."""

from collections.abc import Callable, Iterator, Sequence
from functools import cache

import numpy as np

from geom2iga.bspline import Array
from geom2iga.errors import CaseError
from geom2iga.model import Model
from geom2iga.patch import Face
from solve.case import BodyForce, Contact, Load
from solve.contact.cells import Cells, find_cells
from solve.face import area_vectors, nodal_forces, surface_of
from solve.material import named_bodies
from solve.metric import shares_of
from solve.rules import full_rules
from solve.space import Space, gauss_points

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
    forces, exact = np.zeros((space.size, 3)), cache(lambda number: _exact_cells(space.model, *covers[number]))
    for number, load in enumerate(loads):
        try:
            for face in space.model.faces(load.on):
                np.add.at(forces, space.face_numbers(face), face_load(space, face, load))
            if load.exposed:
                for face, part in _covered(space.model, load, covers, exact):
                    np.subtract.at(forces, space.face_numbers(face), _cell_load(space, face, load, part))
        except CaseError as error:
            raise CaseError(f"solve.load[{number}]: {error}") from None
    for number, entry in enumerate(body_forces):
        for body in named_bodies(space.model, entry.bodies, f"solve.body_force[{number}].bodies"):
            forces += body_load(space, body, np.array(entry.force))
    return forces


def face_load(space: Space, face: Face, load: Load) -> Array:
    """Integrate a pressure or traction over a whole face: f_A = ∫ R_A t dΓ, forces (c, 3) on its control points."""
    surface = surface_of(space.model, face)
    gauss = gauss_points(surface.patch, [space.point_counts[face.patch][axis] for axis in face.axes])
    _, normal, stretch = area_vectors(surface, gauss.xi, gauss.spans)
    return nodal_forces(surface, gauss.xi, gauss.spans, _traction(load, normal) * (stretch * gauss.weights)[:, None])


def body_load(space: Space, body: str, force: Array) -> Array:
    """Integrate a force per volume (3,) over a body: f_A = ∫ R_A b dV, forces (n, 3)."""
    forces, rules = np.zeros((space.size, 3)), full_rules(space)
    for name in space.model.bodies[body]:
        shares = space.spread(name) @ shares_of(space.model.patches[name], rules[name]).ravel()
        forces += np.multiply.outer(shares, force)
    return forces


def _traction(load: Load, normal: Array) -> Array:
    """Force per area (q, 3); normals (q, 3) point out of the body."""
    if load.pressure is not None:
        return -load.pressure * normal
    return np.broadcast_to(np.array(load.traction), normal.shape)


def _exact_cells(model: Model, contact: Contact, cells: tuple[Cells, ...]) -> tuple[Cells, ...]:
    """Cut the cells of a contact exactly, whatever its own rule."""
    exact = contact.model_copy(update={"integration": "segment", "points": None})
    return cells if contact == exact else find_cells(model, exact)


def _covered(
    model: Model, load: Load, covers: Covers, exact: Callable[[int], tuple[Cells, ...]]
) -> Iterator[tuple[Face, Cells]]:
    """Yield what contact partners cover of the faces of a load: each face with the cells on it, of every partner."""
    faces, counted = set(model.faces(load.on)), set()
    partners = [number for number, (contact, _) in enumerate(covers) if faces & _sides(model, contact)]
    if not partners:
        raise CaseError(f'exposed = true, but "{load.on}" takes part in no contact: leave it out')
    for part in (part for number in partners for part in exact(number)):
        pair = frozenset((part.secondary, part.primary))
        if pair not in counted:  # either side may be secondary in turn: what is covered counts once
            counted.add(pair)
            yield from ((face, part) for face in (part.secondary, part.primary) if face in faces)


def _sides(model: Model, contact: Contact) -> set[Face]:
    """All faces of either side of a contact."""
    return {*model.faces(contact.secondary), *model.faces(contact.primary)}


def _cell_load(space: Space, face: Face, load: Load, cells: Cells) -> Array:
    """The load on one side of some cells, forces (c, 3) on the control points of the face."""
    surface, on_secondary = surface_of(space.model, face), face == cells.secondary
    xi = cells.secondary_xi if on_secondary else cells.primary_xi
    spans = cells.secondary_spans if on_secondary else cells.primary_spans
    area = cells.area if on_secondary else cells.primary_area
    normal = area_vectors(surface, xi, spans)[1] if on_secondary else cells.normal
    return nodal_forces(surface, xi, spans, _traction(load, normal) * area[:, None])
