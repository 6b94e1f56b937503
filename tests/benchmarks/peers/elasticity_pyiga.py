"""pyiga: its compiled assembler, conjugate gradients of scipy with the diagonal.

The displacements are splines on the rational map, not rational: another space than that of the others on the ring.
"""

import numpy as np
from common import Measured, read_job
from pyiga import assemble, bspline, compile, geometry, vform

FORM = "(lam * div(u) * div(v) + mu * inner(grad(u) + grad(u).T, grad(v))) * dx"


def main() -> None:
    """Assemble and solve."""
    job = read_job()
    measured = Measured("pyiga", job)
    knots = tuple(bspline.KnotVector(at, p) for at, p in zip(job.knots, job.degrees, strict=True))
    if job.weights is None:
        place = bspline.BSplineFunc(knots, job.control_points)
    else:
        place = geometry.NurbsFunc(knots, job.control_points.copy(), job.weights)
    arguments = {"geo": place, "lam": job.lame[0], "mu": job.lame[1]}
    with measured.phase("compiling"):  # kept on disk from the second time on
        form = vform.parse_vf(FORM, knots, args=arguments, bfuns=[("u", 3), ("v", 3)])
        assembler = compile.compile_vform(form)
    with measured.phase("assembly"):
        stiffness = assemble.assemble(assembler, knots, args=arguments, symmetric=True)
    measured.matrix(stiffness)
    if job.solves:
        load = np.concatenate(
            [f * assemble.inner_products(knots, lambda *at: 1.0, geo=place).ravel() for f in job.force]
        )
        free = np.flatnonzero(np.tile(~job.clamped.ravel(), 3))
        measured.solve(stiffness[free][:, free], load[free])
    measured.report(unlike_space=job.weights is not None)


if __name__ == "__main__":
    main()
