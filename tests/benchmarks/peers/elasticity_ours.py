"""Ours, through the public functions; with `assembly` the assembled matrix of the direct way alone.

python elasticity_ours.py JOB.npz [assembly] [METHOD]

METHOD is that of [solve.linear]; left out, or where the case has no such table yet, what stands in the case decides.
"""

import json
import sys
from typing import Any

import numpy as np
from common import Measured, read_job

import solve
from geom2iga import build
from geom2iga.threads import one_blas_thread
from solve.case import Solve, SolveCase
from solve.elasticity import assemble_stiffness
from solve.material import find_materials
from solve.space import number_control_points

METHODS = ("auto", "direct", "iterative")


def with_method(case: dict[str, Any]) -> dict[str, Any]:
    """Ask for the linear solver named on the command line."""
    methods = [word for word in sys.argv[2:] if word in METHODS]
    if not methods or "linear" not in Solve.model_fields:
        return case
    return case | {"solve": case["solve"] | {"linear": {"method": methods[0]}}}


def assemble(measured: Measured, case: dict[str, Any]) -> None:
    """Assemble the matrix of all degrees of freedom."""
    model = build(case)
    materials = find_materials(model, SolveCase.model_validate({"solve": case["solve"]}).solve)
    with measured.phase("assembly"), one_blas_thread():
        stiffness = assemble_stiffness(number_control_points(model), materials)
    measured.matrix(stiffness)


def solve_case(measured: Measured, case: dict[str, Any]) -> None:
    """Solve the whole case."""
    with measured.phase("geometry"):
        model = build(case)
    with measured.phase("all"):
        statistics = solve.solve(model, case).statistics
    measured.found["seconds"] |= phases(measured.found["seconds"].pop("all"), statistics["seconds"])
    measured.found["growth"].pop("all")
    measured.found |= {
        "energy": statistics["strain_energy"],
        "iterations": statistics["linear_iterations"],
        "solver": statistics["linear_solver"],
        "unknowns": statistics["dofs"],
    }


def phases(whole: float, seconds: dict[str, float]) -> dict[str, float]:
    """Seconds by the phases that all have: what is neither assembly nor the solution is set-up."""
    assembly, solution = seconds.get("assembly", 0.0), seconds["newton"]
    return {"set-up": whole - assembly - solution, "assembly": assembly, "solve": solution}


def main() -> None:
    """Assemble or solve."""
    job = read_job()
    measured = Measured("geom2iga", job)
    with np.load(sys.argv[1]) as held:
        case = with_method(json.loads(str(held["case"])))
    if job.solves:
        solve_case(measured, case)
    else:
        assemble(measured, case)
    measured.report()


if __name__ == "__main__":
    main()
