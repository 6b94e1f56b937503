"""The command iga-solve: geometry.h5 to solution.h5."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from geom2iga import __main__ as geometry
from geom2iga.build import build
from geom2iga.errors import CaseError, NotConvergedError
from geom2iga.files import read_model, read_stamp
from geom2iga.stage import Stage, discard, fingerprint, log, run_command
from geom2iga.tables import Case, checked
from solve.analysis import solve
from solve.case import SolveCase
from solve.files import FORMAT, VERSION, read_result, write_result
from solve.iterative import Iterated
from solve.linear import direct_solver
from solve.memory import is_iterative, needed
from solve.newton import Status, Step
from solve.problem import prepare
from solve.result import ContactResult, Result, carried

FILE, STEPS = "solution.h5", "steps.h5"


def stamp(case: Case, folder: Path) -> str:
    """Fingerprint the geometry and the [solve] table; raise CaseError where geometry.h5 is not that of the case."""
    before = geometry.stamp(case, folder)
    if geometry.STAGE.written(folder) != before:
        raise CaseError(f"{folder / geometry.FILE} is missing or not made from this case: run geom2iga first")
    return fingerprint(before, checked(case, SolveCase).solve.model_dump())


def plan(case: Case) -> str:
    """Check that the case fits its geometry."""
    problem = prepare(build(case), checked(case, SolveCase).solve)
    candidates = sum(len(part.mortar.area) for part in problem.passes)
    solver = None if is_iterative(problem) else direct_solver()
    way = f"{solver.name if solver else Iterated.name}, about {needed(problem, solver):.2g} GB"
    return f"{problem.allowed.size} unknowns, {candidates} gaps that may close, {way}"


def run(case: Case, folder: Path, stamp: str) -> None:
    """Solve and write solution.h5; raise NotConvergedError where no equilibrium was reached.

    The load steps so far lie in steps.h5 as long as the last one has not converged; a later run goes on from there.
    """
    began = time.perf_counter()
    model, steps = read_model(folder / geometry.FILE), folder / STEPS
    before = _steps_so_far(steps, stamp)
    if before:
        log.info("iga-solve: going on after load step %d", len(before.states))
    try:
        result = solve(model, case, report_step, lambda so_far: write_result(steps, so_far, stamp), before)
    except KeyboardInterrupt:
        if _steps_so_far(steps, stamp):
            log.info("iga-solve: the load steps so far are kept, run again to go on")
        raise
    discard(folder)
    if result.status is not Status.CONVERGED:
        where = f"load step {len(result.states) + 1}: " if checked(case, SolveCase).solve.steps.several else ""
        raise NotConvergedError(f"iga-solve: {where}{result.status.value}")
    write_result(folder / FILE, result, stamp)
    steps.unlink(missing_ok=True)
    for contact in result.pairs:
        log.info("iga-solve: %s", describe(contact))
        for warning in contact.warnings:
            names = contact.definition.secondary, contact.definition.primary
            log.warning('iga-solve: warning: contact of "%s" with "%s": %s', *names, warning)
    statistics = result.statistics
    way, seconds = statistics["linear_solver"], time.perf_counter() - began
    log.info("iga-solve: converged, %d unknowns, %s, %.2f s", statistics["dofs"], way, seconds)


def _steps_so_far(path: Path, stamp: str) -> Result | None:
    """Read the load steps of an analysis of the same case that was cut off; None where there are none."""
    if read_stamp(path, FORMAT, VERSION) != stamp:
        return None
    try:
        return read_result(path)
    except CaseError:  # damaged: begin anew
        return None


def describe(contact: ContactResult) -> str:
    """Say in one line what a contact carries."""
    force, moment = (", ".join(f"{component:.6g}" for component in v + 0.0) for v in (contact.force, contact.moment))
    return (
        f'contact of "{contact.definition.secondary}" with "{contact.definition.primary}": force ({force}), '
        f"moment ({moment}), area {contact.area:.6g}, overlap {contact.penetration:.3g}, "
        f"{contact.active.sum()} of {len(contact.active)} gaps closed"
    )


def report_step(step: Step) -> None:
    """Print one line per Newton step, before the first what its columns are."""
    if step.number == 1:
        columns = ("step", "load step", "update", "residual", "active", "changes", "length", "seconds")
        log.info("iga-solve: %5s %10s %7s %12s %8s %8s %8s %9s", *columns)
    log.info(
        "iga-solve: %5d %10d %7d %12.3e %8d %8d %8.3g %9.3f",
        *(step.number, step.load_step, step.update),
        *(step.residual, step.active, step.changes, step.length, step.seconds),
    )


def summary(folder: Path) -> Mapping[str, Any]:
    """What solution.h5 holds."""
    result = read_result(folder / FILE)
    return {
        "status": result.status.value,
        **result.statistics,
        "contact": [carried(contact) for contact in result.pairs],
    }


STAGE = Stage(
    "iga-solve",
    SolveCase,
    stamp,
    lambda folder: read_stamp(folder / FILE, FORMAT, VERSION),
    plan,
    run,
    summary,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command("Solve the contact problem of a case file on its patches.", [STAGE], arguments)


if __name__ == "__main__":
    raise SystemExit(main())
