"""The command iga-solve: geometry.h5 to solution.h5."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import takewhile
from pathlib import Path
from typing import Any

from geom2iga import __main__ as geometry
from geom2iga.build import build
from geom2iga.errors import CaseError, NotConvergedError
from geom2iga.files import check_stamp, read_model, read_stamp
from geom2iga.limits import GIGABYTE
from geom2iga.seal import check_ours
from geom2iga.stage import Stage, discard, fingerprint, log, run_command
from geom2iga.tables import Case, checked
from solve.analysis import solve
from solve.case import SolveCase
from solve.diagnosis import Diagnosis
from solve.files import FORMAT, VERSION, read_result, write_result
from solve.iterative import Iterated
from solve.linear import direct_solver
from solve.memory import check_solver, is_iterative, needed
from solve.newton import Step
from solve.output import write_history, write_summary
from solve.problem import prepare
from solve.result import ContactResult, Result, carried

FILE, STEPS, HISTORY, SUMMARY = "solution.h5", "steps.h5", "history.csv", "summary.json"
# what a load step that has converged does not depend on
EFFORT: dict[str, set[str] | bool] = {
    "newton": {"max_steps"},
    "augmentation": {"max_steps"},
    "linear": True,
    "steps": True,
}


def stamp(case: Case, folder: Path) -> str:
    """Fingerprint the geometry and the [solve] table; raise CaseError where geometry.h5 is not that of the case."""
    before = geometry.stamp(case, folder)
    check_stamp(folder / geometry.FILE, geometry.FORMAT, geometry.VERSION, before, "run geom2iga first")
    return fingerprint(before, checked(case, SolveCase).solve.model_dump())


def _stamp_of_steps(case: Case, folder: Path) -> str:
    """Fingerprint what a load step depends on: neither which come after it, nor how much is done for convergence."""
    return fingerprint(geometry.stamp(case, folder), checked(case, SolveCase).solve.model_dump(exclude=EFFORT))


def plan(case: Case) -> str:
    """Check that the case fits its geometry."""
    problem = prepare(build(case), checked(case, SolveCase).solve)
    candidates = sum(len(part.mortar.area) for part in problem.passes)
    solver = None if is_iterative(problem) else direct_solver()
    check_solver(problem, solver)
    way = f"{solver.name if solver else Iterated.name}, about {needed(problem, solver) / GIGABYTE:.2g} GB"
    return f"{problem.allowed.size} unknowns, {candidates} gaps that may close, {way}"


def run(case: Case, folder: Path, stamp: str) -> None:
    """Solve and write solution.h5; raise NotConvergedError where no equilibrium was reached.

    The load steps so far lie in steps.h5 as long as the last one has not converged; a later run goes on from there,
    also where the case asks for more effort, or for other load steps after them.
    """
    began = time.perf_counter()
    for name in (FILE, STEPS, SUMMARY):
        check_ours(folder / name)  # in its place, nothing that is solved may be written
    model, steps = read_model(folder / geometry.FILE, geometry.stamp(case, folder)), folder / STEPS
    mark, before = _stamp_of_steps(case, folder), _steps_so_far(case, folder)
    if before and before.states:
        log.info("iga-solve: going on after load step %d", len(before.states))
    try:
        result = solve(model, case, report_step, lambda so_far: write_result(steps, so_far, mark), before)
    except KeyboardInterrupt:
        if (kept := _steps_so_far(case, folder)) and kept.states:
            log.info("iga-solve: run it again to go on after load step %d", len(kept.states))
        raise
    discard(folder)
    if result.diagnosis:
        _tell(result, result.diagnosis)
        write_result(steps, result, mark)
        _leave(result, result.diagnosis, folder)
        where = f"load step {result.diagnosis.load_step}: " if result.diagnosis.load_steps > 1 else ""
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
    if (share := result.state.load_factor) != 1:
        log.info("iga-solve: the last load step carries %g of the loads", share)
    log.info("iga-solve: converged, %d unknowns, %s, %.2f s", statistics["dofs"], way, seconds)


def _leave(result: Result, diagnosis: Diagnosis, folder: Path) -> None:
    """Write why an analysis did not converge: summary.json, which lists history.csv, then that."""
    found = {"status": result.status.name.lower(), **result.statistics, "diagnosis": asdict(diagnosis)}
    write_summary(folder / SUMMARY, {**found, "files": [HISTORY]})
    write_history(folder / HISTORY, result.history)


def _tell(result: Result, diagnosis: Diagnosis) -> None:
    """Say why an analysis did not converge, and what is kept of it."""
    for line in diagnosis.lines:
        log.warning("iga-solve: %s", line)
    if result.states:
        kept = "iga-solve: load step %d of %d is kept: iga-post shows it, and the next run goes on from there"
        log.info(kept, len(result.states), diagnosis.load_steps)


def _steps_so_far(case: Case, folder: Path) -> Result | None:
    """Read the load steps of an analysis of the same case that has not come to its end; None where there is none."""
    if not (folder / STEPS).exists():
        return None
    try:
        found = read_result(folder / STEPS, _stamp_of_steps(case, folder), "it is not used")
    except CaseError as error:
        log.warning("%s", error)
        return None
    wanted = checked(case, SolveCase).solve.steps.shares[:-1]
    pairs = zip(found.states, wanted, strict=False)
    same = takewhile(lambda pair: pair[0].load_factor == pair[1], pairs)
    return replace(found, states=tuple(state for state, _ in same))


def _tidy(case: Case, folder: Path, options: Any) -> None:
    """Remove the load steps of an analysis that had come to its end when it was cut off, and such that are damaged."""
    if read_stamp(folder / STEPS, FORMAT, VERSION) in (None, _stamp_of_steps(case, folder)):
        (folder / STEPS).unlink(missing_ok=True)


def read_shown(case: Case, folder: Path) -> Result:
    """Read the solution; where there is none, the load steps before the one that did not converge.

    Raises
    ------
    CaseError
        The case has not been solved.
    NotConvergedError
        Its first load step did not converge: there is nothing to show.
    """
    made_from = stamp(case, folder)
    try:
        return read_result(folder / FILE, made_from, "run iga-solve first")
    except CaseError as error:
        missing = error
    found, count = _steps_so_far(case, folder), len(checked(case, SolveCase).solve.steps.shares)
    failed = found and found.diagnosis
    if not found or not failed or (failed.load_step, failed.load_steps) != (len(found.states) + 1, count):
        raise missing
    if not found.states:
        raise NotConvergedError(f"no load step has converged, so that there is nothing to show: {found.status.value}")
    return found


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
    extra=_tidy,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command("Solve the contact problem of a case file on its patches.", [STAGE], arguments)


if __name__ == "__main__":
    raise SystemExit(main())
