"""What an analysis returns."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from geom2iga.bspline import Array, Indices, Mask
from geom2iga.errors import CaseError
from geom2iga.model import Model
from solve.case import Contact
from solve.material import Material
from solve.newton import Status, Step
from solve.space import Space, number_control_points


@dataclass(frozen=True, eq=False)
class State:
    """A state of equilibrium.

    Parameters
    ----------
    displacement : (n, 3)
        Of all control points [length].
    pressure : (m,)
        Of the secondary control points of all contacts, one contact after the other, positive in compression.
    active : (m,) bool
        Which of them touch.
    load_factor : float
        Share of the loads.
    """

    displacement: Array
    pressure: Array
    active: Mask
    load_factor: float = 1.0


@dataclass(frozen=True, eq=False)
class ContactResult:
    """One contact pair in the last state.

    Parameters
    ----------
    definition : Contact
        Its entry in the case.
    penalty : float
        [stress/length]
    control_points : (m,)
        Global numbers of the secondary control points.
    control_area : (m,)
        Area of competence [length²].
    control_gap : (m,)
        [length], positive where open.
    pressure : (m,)
        Positive in compression; as coefficients of the secondary basis it is the pressure field.
    active : (m,) bool
    force : (3,)
        On the secondary side.
    """

    definition: Contact
    penalty: float
    control_points: Indices
    control_area: Array
    control_gap: Array
    pressure: Array
    active: Mask
    force: Array

    @property
    def area(self) -> float:
        """Area of competence of the active control points [length²]."""
        return float(self.control_area[self.active].sum())


@dataclass(frozen=True, eq=False)
class Result:
    """Status, states and history of an analysis, with what is needed to look at them.

    Parameters
    ----------
    status : Status
    model : Model
    materials : body name to Material
    states : tuple of State
        Converged states; the last is the result.
    contacts : tuple of ContactResult
    history : tuple of Step
        Newton steps.
    statistics : mapping
        dofs, newton_iterations, linear_iterations, linear_solver, strain_energy, equilibrium_error, seconds by phase.
    """

    status: Status
    model: Model
    materials: Mapping[str, Material]
    states: tuple[State, ...]
    contacts: tuple[ContactResult, ...]
    history: tuple[Step, ...]
    statistics: Mapping[str, Any]

    @property
    def state(self) -> State:
        """The last state; raises CaseError where the analysis has not converged."""
        self.check_converged()
        return self.states[-1]

    def check_converged(self) -> None:
        """Raise CaseError where the analysis has not converged."""
        if not self.states:
            raise CaseError(f"the analysis has no result: {self.status.value}")

    @cached_property
    def space(self) -> Space:
        """The numbering of the control points."""
        return number_control_points(self.model)

    def displacement_of(self, patch: str) -> Array:
        """Displacements (n, 3) of the control points of a patch, in its flat numbering [length]."""
        return self.state.displacement[self.space.numbers[patch]]

    def pressure_field(self, contact: ContactResult) -> Array:
        """Pressure (n, 1) as coefficients of all control points, zero off the contact."""
        field = np.zeros((self.space.size, 1))
        field[contact.control_points, 0] = contact.pressure
        return field

    def __repr__(self) -> str:
        newton, dofs = self.statistics["newton_iterations"], self.statistics["dofs"]
        forces = ", ".join(f"{np.linalg.norm(contact.force):.6g}" for contact in self.contacts) or "none"
        return f"Result({self.status.name}, {dofs} dofs, {newton} Newton steps, contact force {forces})"
