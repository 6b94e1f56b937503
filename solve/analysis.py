"""From a model and the [solve] table to a Result."""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from geom2iga.bspline import Array
from geom2iga.limits import peak_memory
from geom2iga.model import Model
from geom2iga.progress import noted, progress, tracked
from geom2iga.tables import Source, checked
from geom2iga.threads import one_blas_thread
from solve.case import SolveCase
from solve.contact.mortar import point_gaps
from solve.contact.precision import find_losses
from solve.diagnosis import Diagnosis, diagnose
from solve.elasticity import assemble_stiffness
from solve.equilibrium import Settings, Start, find_equilibrium
from solve.iterative import Iterated
from solve.linear import DirectSolver, direct_solver
from solve.memory import KEPT, check_solver, fits, is_iterative, map_numbers
from solve.newton import ROUNDING, SETTLED, Solution, Status, Step
from solve.operator import Stiffness
from solve.problem import Pass, Problem, prepare
from solve.reactions import Forces, find_reactions
from solve.result import ContactResult, Result, State
from solve.rules import exact_rules
from solve.strain import warn_of_strain
from solve.system import System, reduced_system
from solve.tangents import Factorised, Tangents

log = logging.getLogger("geom2iga")

NUMERIC = (Status.SLOW, Status.SINGULAR, Status.INACCURATE)  # failures that another linear solver may not have
HIDDEN = 0.3  # overlaps of points above this fraction of how far the bodies came closer are worth a word
DEEP = 0.1  # overlaps above this fraction of the smallest body are
TOUCHING = 1e-9  # overlaps below this fraction of the smallest body are rounding errors

Report = Callable[[Step], None]
Keep = Callable[[Result], None]


def solve(
    model: Model,
    source: Source,
    report: Report = lambda step: None,
    keep: Keep = lambda result: None,
    before: Result | None = None,
) -> Result:
    """Solve the contact problem of a case on a model, load step by load step.

    Parameters
    ----------
    source : path, dict, Case or SolveCase
    report : function
        Is told of each Newton step.
    keep : function
        Is given the result so far after each load step but the last.
    before : Result
        The first load steps, of an analysis of the same case that was cut off.

    Returns
    -------
    Result
        Look at its `status`; its states are those of the load steps that converged.

    Raises
    ------
    CaseError
        The case is wrong or does not fit the model, or a body can move freely.
    GeometryError
        A patch is folded.
    """
    case = checked(source, SolveCase).solve
    clock = Clock()
    with one_blas_thread():
        with clock.phase("contact"):
            problem = prepare(model, case)
        with clock.phase("assembly"):
            assembled = _assemble(problem, None if is_iterative(problem) else direct_solver())
        result = _follow(problem, assembled, clock, report, keep, before)
        if result.status in NUMERIC and problem.case.linear.method == "auto" and is_iterative(problem):
            solver = direct_solver()
            if fits(problem, solver):
                log.info("conjugate gradients failed (%s): going on with %s", result.status.value, solver.name)
                with clock.phase("assembly"):
                    assembled = _assemble(problem, solver)
                result = _follow(problem, assembled, clock, report, keep, result)
        if result.states:
            warn_of_strain(problem.space, result.state.displacement)
        return result


class Assembled(NamedTuple):
    """The reduced problem under all loads, and without any."""

    stiffness: Any  # (dofs, dofs), of all degrees of freedom
    loaded: System
    unloaded: System
    tangents: Tangents

    def under(self, share: float) -> System:
        """The problem under a share of the loads and prescribed displacements."""
        one, other = self.loaded, self.unloaded
        gap = other.initial_gap + share * (one.initial_gap - other.initial_gap)
        return replace(one, load=share * one.load, initial_gap=gap)


def _assemble(problem: Problem, solver: DirectSolver | None) -> Assembled:
    """Assemble the reduced problem for a direct solver, or make operators of it."""
    space, materials, mortar, springs = problem.space, problem.materials, problem.mortar, problem.law.springs
    check_solver(problem, solver)
    if solver:
        stiffness = assemble_stiffness(space, materials)
    else:
        rules = exact_rules(space)
        stiffness = Stiffness(space, materials, rules, stored=map_numbers(space, rules) <= KEPT)
    loaded = reduced_system(stiffness, problem.load, mortar, springs, problem.allowed, problem.rigid)
    unloaded = replace(loaded, load=np.zeros_like(loaded.load), initial_gap=mortar.initial_gap)
    tangents = Factorised(loaded.tangent, solver) if solver else Iterated(problem)
    return Assembled(stiffness, loaded, unloaded, tangents)


def _follow(
    problem: Problem, assembled: Assembled, clock: "Clock", report: Report, keep: Keep, before: Result | None
) -> Result:
    """Go through the load steps, each from the state before."""
    settings = Settings(problem.case.newton, problem.case.augmentation, problem.size)
    shares = problem.case.steps.shares
    states = list(before.states) if before else []
    history = [step for step in before.history if step.load_step <= len(states)] if before else []
    status, error = Status.CONVERGED, before.statistics["equilibrium_error"] if before else 0.0
    diagnosis: Diagnosis | None = None
    inner = assembled.stiffness @ states[-1].displacement.ravel() if states else np.zeros(problem.space.dofs)

    def told(step: Step) -> None:
        history.append(replace(step, number=len(history) + 1, load_step=len(states) + 1))
        report(history[-1])
        noted(f"residual {step.residual:.1e}")

    def result() -> Result:
        energy = float(states[-1].displacement.ravel() @ inner / 2) if states else 0.0
        statistics = _statistics(assembled, clock, history, energy, error)
        model, materials = problem.space.model, problem.materials
        return Result(status, model, materials, tuple(states), tuple(history), statistics, diagnosis)

    for share in tracked(shares[len(states) :], "load steps"):
        system = assembled.under(share)
        start = _start(problem, states[-1]) if states else None
        with clock.phase("newton"):
            solution = find_equilibrium(system, problem.law, settings, assembled.tangents, told, start)
        status = solution.status
        if status is not Status.CONVERGED:
            diagnosis = diagnose(problem, system, solution, len(states) + 1)
            break
        _warn_of_rounding(system, solution, settings)
        state, forces = _state(problem, assembled, share, solution)
        states.append(state)
        inner, error = forces.inner, _unbalanced(problem, system, forces, solution.scale)
        if len(states) < len(shares):
            keep(result())
    return result()


def _warn_of_rounding(system: System, solution: Solution, settings: Settings) -> None:
    """Log how far from balance rounding has left a solution, where that is farther than usual."""
    off = system.load - solution.inner + system.gap_operator.T @ solution.pressure
    rest = float(np.abs(off).max(initial=0.0)) / (solution.scale or 1.0)
    if rest > max(SETTLED, settings.newton.tolerance):
        log.warning("warning: rounding leaves %.1e of the largest force out of balance: stresses are no better", rest)


def _start(problem: Problem, state: State) -> Start:
    """Begin at a state under other loads; what is prescribed is at right angles to what is free."""
    return Start(problem.allowed.matrix.T @ state.displacement.ravel(), state.pressure)


def _state(problem: Problem, assembled: Assembled, share: float, solution: Solution) -> tuple[State, Forces]:
    """Take what is known of an equilibrium under a share of the loads."""
    allowed, supports = problem.allowed, problem.case.support
    displacement = (allowed.matrix @ solution.free + share * allowed.offset).reshape(-1, 3)
    contact = problem.mortar.gap_operator.T @ solution.pressure
    forces = Forces(assembled.stiffness @ displacement.ravel(), share * problem.load, contact)
    ends = np.cumsum([len(part.mortar.area) for part in problem.passes])[:-1]
    pressures = np.split(solution.pressure, ends)
    contacts = tuple(_contact_results(problem, displacement, pressures, solution.scale))
    reactions = find_reactions(problem.space, supports, problem.conditions, forces.carried)
    return State(displacement, contacts, share, reactions), forces


def _contact_results(
    problem: Problem, displacement: Array, pressures: Sequence[Array], scale: float
) -> Iterator[ContactResult]:
    """Evaluate gap, pressure, force and moment of each pass; forces are those of all passes of its contact."""
    pairs = list(zip(problem.passes, pressures, strict=False))
    for part, pressure in pairs:
        mortar = part.mortar
        forces = sum(p.mortar.gap_operator.T @ values for p, values in pairs if p.number == part.number)
        numbers = problem.space.group_numbers(part.definition.secondary)
        on_points, points = forces.reshape(-1, 3)[numbers], problem.space.control_points[numbers]
        yield ContactResult(
            part.definition,
            part.penalty,
            mortar.rows,
            mortar.area,
            mortar.centres,
            mortar.control_gaps(displacement),
            pressure,
            pressure > 0,
            on_points.sum(axis=0),
            np.cross(points, on_points).sum(axis=0),
            tuple(_warnings(problem, part, pressure, displacement, scale)),
        )


def _warnings(problem: Problem, part: Pass, pressure: Array, displacement: Array, scale: float) -> Iterator[str]:
    """Say what makes the pressure of a pass doubtful; the scale is the largest force that acted."""
    before, after = point_gaps(problem.space, part.cells, displacement)
    gap = part.mortar.control_gaps(displacement)
    area, size = part.mortar.area, problem.size
    yield from find_losses(part.definition, part.law, part.cells, pressure, gap, area, size, scale)
    averaged = max(0.0, -float(gap.min(initial=0.0)))
    deepest, still_open = -float(after.min(initial=0.0)), after > 0
    closing = float((before - after)[still_open].max(initial=0.0))  # how far the bodies came closer
    if closing > 0 and deepest - averaged > max(HIDDEN * closing, TOUCHING * problem.size):
        yield (
            f"points overlap by up to {deepest:.3g}, averaged gaps by {averaged:.3g} at most: refine the secondary "
            "side where it touches, or exchange the two sides"
        )
    deepest = max(deepest, -float(before.min(initial=0.0)))
    if deepest > DEEP * problem.size:
        yield (
            f"the bodies overlap by {deepest:.3g}, a good part of their size: check where they are, which faces look "
            "at each other, and the loads"
        )
    reach, pressed = part.definition.reach, pressure > 0
    if reach is not None and np.any(part.mortar.initial_gap[pressed] > reach / 2 * part.mortar.area[pressed]):
        yield f"contact extends to gaps that the reach of {reach:g} cuts off: raise it"


def _statistics(
    assembled: Assembled, clock: "Clock", history: Sequence[Step], energy: float, error: float
) -> dict[str, Any]:
    """Collect sizes, counts and times."""
    return {
        "dofs": len(assembled.loaded.load),
        "newton_iterations": len(history),
        "linear_iterations": assembled.tangents.iterations,
        "factorisations": assembled.tangents.factorisations,
        "linear_solver": assembled.tangents.name,
        "strain_energy": energy,
        "equilibrium_error": error,
        "peak_memory": peak_memory(),
        "seconds": dict(clock.seconds),
    }


def _unbalanced(problem: Problem, system: System, forces: Forces, scale: float) -> float:
    """Largest sum of loads, contact forces and reactions on one body, over the sum of the sizes of all forces.

    What is carried along free unknowns is all that reactions do not take.
    """
    matrix = problem.allowed.matrix
    unbalanced = (matrix @ (matrix.T @ forces.carried)).reshape(-1, 3)
    bodies = problem.space.model.bodies
    total = max(float(np.abs(unbalanced[problem.space.body_numbers(body)].sum(axis=0)).max()) for body in bodies)
    sizes = (float(np.abs(force).sum()) for force in (system.load, matrix.T @ forces.contact))
    return total / (max(ROUNDING * scale, *sizes) or 1.0)


class Clock:
    """Adds up wall-clock seconds by phase."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Time what happens inside, and show that it is under way."""
        began = time.perf_counter()
        try:
            with progress(name):
                yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - began
