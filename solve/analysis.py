"""From a model and the [solve] table to a Result."""

import resource
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from geom2iga.bspline import Array
from geom2iga.errors import CaseError
from geom2iga.model import Model
from geom2iga.tables import Source, checked
from geom2iga.threads import one_blas_thread
from solve.case import Solve, SolveCase
from solve.constraints import AffineMap, constrain, find_conditions
from solve.contact.cells import find_cells
from solve.contact.laws import Penalty, find_penalty
from solve.contact.mortar import Mortar, assemble_mortar, stacked
from solve.elasticity import assemble_stiffness
from solve.linear import direct_solver
from solve.loads import assemble_loads
from solve.material import find_materials
from solve.newton import ROUNDING, Solution, Status, Step, minimise
from solve.result import ContactResult, Result, State
from solve.rigid import check_held, check_pressed, rigid_modes, unsupported
from solve.space import Space, check_right_handed, number_control_points
from solve.system import System, reduced_system


class Problem(NamedTuple):
    """Everything the solver needs, in all degrees of freedom."""

    case: Solve
    space: Space
    mortars: tuple[Mortar, ...]
    penalties: tuple[float, ...]
    allowed: AffineMap
    load: Array  # (dofs,)
    rigid: Array  # (dofs, k)


def solve(model: Model, source: Source, report: Callable[[Step], None] = lambda step: None) -> Result:
    """Solve the contact problem of a case on a model.

    Parameters
    ----------
    source : path, dict, Case or SolveCase
    report : function
        Is told of each Newton step.

    Returns
    -------
    Result
        Look at its `status`; only a converged result has a state.

    Raises
    ------
    CaseError
        The case is wrong or does not fit the model, or a body can move freely.
    GeometryError
        A patch is folded.
    """
    case = checked(source, SolveCase).solve
    with one_blas_thread():
        return _solve(model, case, report)


def _solve(model: Model, case: Solve, report: Callable[[Step], None]) -> Result:
    """Solve a checked case."""
    clock = Clock()
    materials = find_materials(model, case)
    with clock.phase("contact"):
        problem = prepare(model, case)
    with clock.phase("assembly"):
        stiffness = assemble_stiffness(problem.space, materials)
        mortar = stacked(problem.mortars, problem.space.dofs)
        law = Penalty(np.repeat(problem.penalties, [len(part.area) for part in problem.mortars]))
        system = reduced_system(stiffness, problem.load, mortar, law, problem.allowed, problem.rigid)
    with clock.phase("newton"):
        solver = direct_solver()
        solution = minimise(system, case.newton, solver, report)
    displacement = (problem.allowed.matrix @ solution.free + problem.allowed.offset).reshape(-1, 3)
    contacts = tuple(_contact_results(problem, displacement))
    pressure = np.concatenate([c.pressure for c in contacts]) if contacts else np.empty(0)
    active = np.concatenate([c.active for c in contacts]) if contacts else np.empty(0, dtype=bool)
    states = (State(displacement, pressure, active),) if solution.status is Status.CONVERGED else ()
    statistics = {
        "dofs": system.stiffness.shape[0],
        "newton_iterations": len(solution.history),
        "linear_iterations": 0,
        "linear_solver": solver.name,
        "strain_energy": float(displacement.ravel() @ (stiffness @ displacement.ravel()) / 2),
        "equilibrium_error": _equilibrium_error(problem, system, solution),
        "peak_memory": peak_memory(),
        "seconds": clock.seconds,
    }
    return Result(solution.status, model, materials, states, contacts, solution.history, statistics)


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
    space = number_control_points(model)
    materials = find_materials(model, case)
    cells, mortars, penalties = [], [], []
    for number, contact in enumerate(case.contact):
        try:
            cells.append(find_cells(model, contact))
            mortars.append(assemble_mortar(space, cells[-1]))
            penalties.append(find_penalty(space, contact, materials))
        except CaseError as error:
            raise CaseError(f"solve.contact[{number}]: {error}") from None
    conditions = find_conditions(space, case.support)
    allowed = constrain(space, conditions, case.support)
    mortar = stacked(mortars, space.dofs)
    check_held(space, conditions, mortar)
    load = assemble_loads(space, case.load, case.body_force, list(zip(case.contact, cells, strict=True))).ravel()
    rigid = unsupported(rigid_modes(space), conditions)
    check_pressed(space, rigid, mortar, load)
    return Problem(case, space, tuple(mortars), tuple(penalties), allowed, load, rigid)


def _contact_results(problem: Problem, displacement: Array) -> Iterator[ContactResult]:
    """Evaluate gap, pressure and force of each contact."""
    for contact, mortar, penalty in zip(problem.case.contact, problem.mortars, problem.penalties, strict=True):
        gap = mortar.control_gaps(displacement)
        pressure = Penalty(np.full(len(gap), penalty)).pressure(gap)
        forces = (mortar.gap_operator.T @ pressure).reshape(-1, 3)
        force = forces[problem.space.group_numbers(contact.secondary)].sum(axis=0)
        yield ContactResult(contact, penalty, mortar.control_points, mortar.area, gap, pressure, gap <= 0, force)


def _equilibrium_error(problem: Problem, system: System, solution: Solution) -> float:
    """Largest sum of loads, contact forces and reactions on one body, over the sum of the sizes of all forces.

    The residual on free unknowns is all that reactions do not take.
    """
    unbalanced = (problem.allowed.matrix @ system.residual(solution.free)).reshape(-1, 3)
    bodies = problem.space.model.bodies
    total = max(float(np.abs(unbalanced[problem.space.body_numbers(body)].sum(axis=0)).max()) for body in bodies)
    forces = (system.load, system.contact_forces(system.control_gaps(solution.free)))
    scale = max(ROUNDING * solution.scale, *(float(np.abs(force).sum()) for force in forces))
    return total / scale if scale else total


def peak_memory() -> int:
    """Largest resident memory of this process so far [bytes]."""
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return largest if sys.platform == "darwin" else 1024 * largest


class Clock:
    """Adds up wall-clock seconds by phase."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Time what happens inside."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - began
