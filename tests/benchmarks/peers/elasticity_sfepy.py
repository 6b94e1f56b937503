"""sfepy: its Bezier extraction and C terms, conjugate gradients of scipy with the diagonal."""

import numpy as np
from common import Job, Measured, read_job
from sfepy.base.base import Struct, output
from sfepy.discrete import Equation, Equations, FieldVariable, Integral, Material, Problem, iga
from sfepy.discrete.common import Field
from sfepy.discrete.conditions import Conditions, EssentialBC
from sfepy.discrete.iga.domain import IGDomain, NurbsPatch
from sfepy.mechanics.matcoefs import stiffness_from_lame
from sfepy.terms import Term

output.set_output(quiet=True)


def domain_of(job: Job) -> IGDomain:
    """Its domain, by Bezier extraction."""
    degrees, knots = np.array(job.degrees, dtype=np.int32), tuple(job.knots)
    weights = np.ones(job.shape) if job.weights is None else job.weights
    points, weights = job.control_points.reshape(-1, 3), weights.ravel()
    extraction = iga.compute_bezier_extraction(knots, degrees)
    counts = [len(each) for each in extraction]
    numbers, bezier_numbers = iga.create_connectivity(counts, knots, degrees)
    combined = iga.combine_bezier_extraction(extraction)
    bezier = iga.compute_bezier_control(points, weights, combined, numbers, bezier_numbers)
    patch = NurbsPatch(knots, degrees, points, weights, extraction, numbers)
    mesh = Struct(name="bmesh", cps=bezier[0], weights=bezier[1], conn=bezier_numbers)
    return IGDomain("body", nurbs=patch, bmesh=mesh, regions=iga.get_patch_box_regions(counts, degrees))


def problem_of(job: Job) -> Problem:
    """Its problem: the weak form, its material and the clamped face."""
    domain = domain_of(job)
    omega = domain.create_region("Omega", "all")
    bottom = domain.create_region("Bottom", "vertices of set xi20", "facet")
    field = Field.from_args(
        "displacement", np.float64, "vector", omega, approx_order=None, space="H1", poly_space_basis="iga"
    )
    u = FieldVariable("u", "unknown", field)
    v = FieldVariable("v", "test", field, primary_var_name="u")
    material = Material("m", D=stiffness_from_lame(3, *job.lame), f=job.force.reshape(3, 1))
    integral = Integral("i", order=2 * max(job.degrees))
    terms = Term.new("dw_lin_elastic(m.D, v, u)", integral, omega, m=material, v=v, u=u)
    terms = terms - Term.new("dw_volume_lvf(m.f, v)", integral, omega, m=material, v=v)
    problem = Problem("elasticity", equations=Equations([Equation("balance", terms)]))
    problem.set_bcs(ebcs=Conditions([EssentialBC("clamped", bottom, {"u.all": 0.0})]))
    return problem


def main() -> None:
    """Assemble and solve."""
    job = read_job()
    measured = Measured("sfepy", job)
    with measured.phase("set-up"):
        problem = problem_of(job)
        problem.time_update()
        problem.update_materials()
        evaluator = problem.get_evaluator()
        start = problem.get_initial_state().get_state(reduced=True)
    with measured.phase("assembly"):
        stiffness = evaluator.eval_tangent_matrix(start)
    measured.matrix(stiffness)
    if job.solves:
        measured.solve(stiffness, -evaluator.eval_residual(start))
    measured.report()


if __name__ == "__main__":
    main()
