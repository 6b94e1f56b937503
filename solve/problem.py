"""Everything that an analysis solves with: space, contacts, supports and loads of a case on a model."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from geom2iga.bspline import Array, Indices
from geom2iga.errors import CaseError
from geom2iga.model import Face, Model
from solve.case import Contact, Solve
from solve.constraints import AffineMap, Conditions, constrain, find_conditions
from solve.contact.cells import Cells, find_cells
from solve.contact.laws import Law, find_law, find_penalty, joined, stiffness_scale
from solve.contact.mortar import Mortar, assemble_mortar, stacked
from solve.loads import assemble_loads
from solve.locking import warn_of_locking
from solve.material import Material, find_materials
from solve.rigid import check_held, check_pressed, unsupported
from solve.size import check_contact, check_points
from solve.space import Space, check_right_handed, number_control_points


class Pass(NamedTuple):
    """One side of a contact as the secondary one; a contact has one pass, or two."""

    number: int  # of the contact in the case
    definition: Contact  # with the sides of this pass
    cells: tuple[Cells, ...]
    mortar: Mortar
    penalty: float  # [stress/length]
    law: Law


class Problem(NamedTuple):
    """Everything the solver needs, in all degrees of freedom."""

    case: Solve
    space: Space
    materials: Mapping[str, Material]
    passes: tuple[Pass, ...]
    mortar: Mortar  # the gaps of all passes below each other
    conditions: Conditions  # what the supports prescribe
    allowed: AffineMap
    load: Array  # (dofs,)
    rigid: Array  # (dofs, k)

    @property
    def law(self) -> Law:
        """The laws of all passes below each other."""
        return joined([part.law for part in self.passes])

    @property
    def touching(self) -> tuple[Face, ...]:
        """Faces that take part in contacts."""
        groups = [g for part in self.passes for g in (part.definition.secondary, part.definition.primary)]
        return tuple(face for group in groups for face in self.space.model.faces(group))

    @property
    def points(self) -> Indices:
        """Control point (m,) of each gap; -1 where its pressure is not that of a control point."""
        rows = [np.where(part.definition.on_control_points, part.mortar.rows, -1) for part in self.passes]
        return np.concatenate([np.empty(0, dtype=np.int64), *rows])

    @property
    def size(self) -> float:
        """Diagonal of the box around the smallest body [length]."""
        points = self.space.control_points
        boxes = (np.ptp(points[self.space.body_numbers(body)], axis=0) for body in self.space.model.bodies)
        return min(float(np.linalg.norm(box)) for box in boxes)


def prepare(model: Model, case: Solve) -> Problem:
    """Find cells, loads and supports of a case and check that every body is held.

    Raises
    ------
    CaseError
        The case does not fit the model, or a body can move freely.
    GeometryError
        A patch is left-handed.
    """
    check_right_handed(model)
    check_points(model)
    space = number_control_points(model)
    materials = find_materials(model, case)
    warn_of_locking(model, materials)
    passes: list[Pass] = []
    for number, contact in enumerate(case.contact):
        try:
            passes.extend(_passes(space, materials, number, contact))
        except CaseError as error:
            raise CaseError(f"solve.contact[{number}]: {error}") from None
    conditions = find_conditions(space, case.support)
    allowed = constrain(space, conditions, case.support)
    mortar = stacked([part.mortar for part in passes], space.dofs)
    check_held(space, conditions, mortar)
    covers = [(part.definition, part.cells) for part in passes]
    load = assemble_loads(space, case.load, case.body_force, covers).ravel()
    rigid = unsupported(space, conditions)
    check_pressed(space, rigid, mortar, load)
    return Problem(case, space, materials, tuple(passes), mortar, conditions, allowed, load, rigid)


def _passes(space: Space, materials: Mapping[str, Material], number: int, contact: Contact) -> list[Pass]:
    """Integrate a contact, in two passes with springs of half the stiffness where it asks for them."""
    check_contact(space.model, contact)
    sides = {"secondary": contact.primary, "primary": contact.secondary}
    definitions = [contact, contact.model_copy(update=sides)] if contact.two_pass else [contact]
    scale, share = max(stiffness_scale(space, d, materials) for d in definitions), 1 / len(definitions)
    penalty = find_penalty(contact, scale, share)
    passes = []
    for definition in definitions:
        cells = find_cells(space.model, definition)
        mortar = assemble_mortar(space, definition, cells)
        law = find_law(definition, len(mortar.area), scale, share)
        passes.append(Pass(number, definition, cells, mortar, penalty, law))
    return passes
