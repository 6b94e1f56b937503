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
from solve.analysis import prepare, solve
from solve.case import SolveCase
from solve.files import FORMAT, VERSION, read_result, write_result
from solve.newton import Status, Step

FILE = "solution.h5"


def stamp(case: Case, folder: Path) -> str:
    """Fingerprint the geometry and the [solve] table; raise CaseError where geometry.h5 is not that of the case."""
    before = geometry.stamp(case, folder)
    if geometry.STAGE.written(folder) != before:
        raise CaseError(f"{folder / geometry.FILE} is missing or not made from this case: run geom2iga first")
    return fingerprint(before, checked(case, SolveCase).solve.model_dump())


def plan(case: Case) -> str:
    """Check that the case fits its geometry."""
    problem = prepare(build(case), checked(case, SolveCase).solve)
    candidates = sum(len(mortar.area) for mortar in problem.mortars)
    return f"{problem.allowed.size} unknowns, {candidates} control points that may touch"


def run(case: Case, folder: Path, stamp: str) -> None:
    """Solve and write solution.h5; raise NotConvergedError where no equilibrium was reached."""
    began = time.perf_counter()
    model = read_model(folder / geometry.FILE)
    result = solve(model, case, report_step)
    if result.status is not Status.CONVERGED:
        discard(folder)
        raise NotConvergedError(f"iga-solve: {result.status.value}")
    write_result(folder / FILE, result, stamp)
    discard(folder)
    for contact in result.contacts:
        force = ", ".join(f"{component:.6g}" for component in contact.force)
        log.info(
            'iga-solve: contact of "%s" with "%s": force (%s), area %.6g, largest control pressure %.6g',
            contact.definition.secondary,
            contact.definition.primary,
            force,
            contact.area,
            contact.pressure.max() + 0.0,
        )
    statistics = result.statistics
    log.debug("iga-solve: %s, seconds %s", statistics["linear_solver"], statistics["seconds"])
    log.info("iga-solve: converged, %d unknowns, %.2f s", statistics["dofs"], time.perf_counter() - began)


def report_step(step: Step) -> None:
    """Print one line per Newton step, before the first what its columns are."""
    if step.number == 1:
        columns = ("step", "residual", "active", "changes", "length", "seconds")
        log.info("iga-solve: %5s %12s %8s %8s %8s %9s", *columns)
    log.info(
        "iga-solve: %5d %12.3e %8d %8d %8.3g %9.3f",
        *(step.number, step.residual, step.active, step.changes, step.length, step.seconds),
    )


def summary(folder: Path) -> Mapping[str, Any]:
    """What solution.h5 holds."""
    result = read_result(folder / FILE)
    return {
        "status": result.status.value,
        **result.statistics,
        "contact": [{"force": list(c.force), "area": c.area, "active": int(c.active.sum())} for c in result.contacts],
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
