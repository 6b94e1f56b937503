"""What an analysis returns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np

from geom2iga.bspline import Array, Indices, Mask
from geom2iga.display import counted, html_table
from geom2iga.errors import CaseError
from geom2iga.model import Model
from geom2iga.patch import Face
from solve.case import Contact
from solve.contact.pressure import pressure_space
from solve.diagnosis import Diagnosis
from solve.material import Material
from solve.newton import Status, Step
from solve.reactions import Reaction
from solve.space import Space, number_control_points


@dataclass(frozen=True, eq=False)
class ContactResult:
    """One pass of a contact in one state.

    Parameters
    ----------
    definition : Contact
        Its entry in the case; in a second pass with the sides exchanged.
    penalty : float
        [stress/length]; infinite for a Lagrange multiplier.
    rows : (m,)
        Which functions of its pressure space have an area of competence; for mortar-KTS global control-point numbers.
    control_area : (m,)
        Area of competence [length²].
    centres : (m, 3)
        Centres of the areas of competence [length].
    control_gap : (m,)
        [length], positive where open.
    pressure : (m,)
        Positive in compression, coefficients of the functions.
    active : (m,) bool
    force : (3,)
        On the secondary side, of all passes of the contact.
    moment : (3,)
        Of these forces about the origin [force length].
    warnings : tuple of str
        What makes its pressure doubtful.
    """

    definition: Contact
    penalty: float
    rows: Indices
    control_area: Array
    centres: Array
    control_gap: Array
    pressure: Array
    active: Mask
    force: Array
    moment: Array
    warnings: tuple[str, ...] = ()

    @property
    def area(self) -> float:
        """Area of competence of the active control points [length²]."""
        return float(self.control_area[self.active].sum())

    @property
    def penetration(self) -> float:
        """Largest overlap of an area of competence [length]."""
        return float(-self.control_gap.min(initial=0.0)) + 0.0


def carried(contact: ContactResult) -> dict[str, Any]:
    """What a contact carries: force on its secondary side, moment about the origin, area, overlap, closed gaps."""
    return {
        "secondary": contact.definition.secondary,
        "primary": contact.definition.primary,
        "force": contact.force.tolist(),
        "moment": contact.moment.tolist(),
        "area": contact.area,
        "penetration": contact.penetration,
        "active": int(contact.active.sum()),
        "candidates": len(contact.active),
    }


def first_passes(contacts: Sequence[ContactResult]) -> tuple[ContactResult, ...]:
    """Leave out the second pass of each contact that has one; it comes right after the first."""
    passes = iter(contacts)
    found = []
    for contact in passes:
        found.append(contact)
        if contact.definition.two_pass:
            next(passes)
    return tuple(found)


@dataclass(frozen=True, eq=False)
class State:
    """A state of equilibrium.

    Parameters
    ----------
    displacement : (n, 3)
        Of all control points [length].
    contacts : tuple of ContactResult
        One per pass.
    load_factor : float
        Share of the loads.
    reactions : tuple of Reaction
        One per support.
    """

    displacement: Array
    contacts: tuple[ContactResult, ...] = ()
    load_factor: float = 1.0
    reactions: tuple[Reaction, ...] = ()

    @property
    def pressure(self) -> Array:
        """Pressures (m,) of all contacts, one after the other, positive in compression."""
        return np.concatenate([np.empty(0), *(contact.pressure for contact in self.contacts)])

    @property
    def active(self) -> Mask:
        """Which of them press, (m,)."""
        return np.concatenate([np.empty(0, dtype=bool), *(contact.active for contact in self.contacts)])


@dataclass(frozen=True, eq=False)
class Result:
    """Status, states and history of an analysis, with what is needed to look at them.

    Parameters
    ----------
    status : Status
    model : Model
    materials : body name to Material
    states : tuple of State
        Of the load steps that converged; the last is the result.
    history : tuple of Step
        Newton steps.
    statistics : mapping
        dofs, newton_iterations, linear_iterations, factorisations, linear_solver, strain_energy, equilibrium_error,
        peak_memory [bytes], seconds by phase.
    diagnosis : Diagnosis
        Of the load step that did not converge; None where all did.
    """

    status: Status
    model: Model
    materials: Mapping[str, Material]
    states: tuple[State, ...]
    history: tuple[Step, ...]
    statistics: Mapping[str, Any]
    diagnosis: Diagnosis | None = None

    @property
    def state(self) -> State:
        """The last state that has converged; raises CaseError where there is none."""
        self.check_converged()
        return self.states[-1]

    @property
    def contacts(self) -> tuple[ContactResult, ...]:
        """The contacts in the last state that has converged; none where there is none."""
        return self.states[-1].contacts if self.states else ()

    @property
    def pairs(self) -> tuple[ContactResult, ...]:
        """The contacts in the last state as the case names them: of those with two passes the first."""
        return first_passes(self.contacts)

    def check_converged(self) -> None:
        """Raise CaseError where no load step has converged."""
        if not self.states:
            raise CaseError(f"the analysis has no result: {self.status.value}")

    @cached_property
    def space(self) -> Space:
        """The numbering of the control points."""
        return number_control_points(self.model)

    def displacement_of(self, patch: str) -> Array:
        """Displacements (n, 3) of the control points of a patch, in its flat numbering [length]."""
        return self.state.displacement[self.space.numbers[patch]]

    def pressure_at(self, contact: ContactResult, face: Face, xi: Array, spans: Indices | None = None) -> Array:
        """Evaluate the pressure (q,) of one pass at parametric points (q, 2) of one of its secondary faces.

        Parameters
        ----------
        spans : (q, 2)
            Whose polynomial to evaluate, as knot index; left out, the span that holds the point.
        """
        space = pressure_space(self.space, contact.definition, contact.centres)
        return space.field(face, xi, spans, contact.rows, contact.pressure)

    def plot(self, field: str = "von_mises", **options: Any) -> Any:
        """Draw a field on the deformed bodies.

        What draws, the package `post`, imports this one and not the other way round: so it is looked up only now, as
        pandas looks up what plots its tables. Without it this raises ModuleNotFoundError.

        Parameters
        ----------
        field : str
            Such as ux, displacement_magnitude, stress_zz, von_mises, principal_1.
        options
            Those of `post.plots.plot`, such as units.

        Returns
        -------
        matplotlib.figure.Figure
            Notebooks show it; its `savefig` writes it to a file.

        Raises
        ------
        CaseError
            No load step has converged.
        """
        return import_module("post.plots").plot(self, field, **options)

    def __repr__(self) -> str:
        newton, dofs = (
            counted(self.statistics["newton_iterations"], "Newton step", "Newton steps"),
            self.statistics["dofs"],
        )
        forces = ", ".join(f"{np.linalg.norm(contact.force):.6g}" for contact in self.pairs) or "none"
        return f"Result({self.status.name}, {dofs} dofs, {newton}, contact force {forces})"

    def _repr_html_(self) -> str:
        head = ("contact of", "with", "force", "area", "overlap", "gaps closed")
        rows = [
            (
                *(contact.definition.secondary, contact.definition.primary),
                ", ".join(f"{component:.6g}" for component in contact.force + 0.0),
                *(f"{contact.area:.6g}", f"{contact.penetration:.3g}"),
                f"{contact.active.sum()} of {len(contact.active)}",
            )
            for contact in self.pairs
        ]
        return html_table(repr(self), head, rows)
