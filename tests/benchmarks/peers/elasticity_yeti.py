"""Yeti: its element matrices in Fortran, added up by scipy, conjugate gradients of scipy with the diagonal.

It has no constant force per volume: the load vector is that of the job.
"""

import numpy as np
from common import Job, Measured, read_job
from yeti_iga import BoundaryCondition, ElasticMaterial, IgaModel, Patch


def yeti_patch(job: Job) -> Patch:
    """Its patch: the first direction runs fastest, elements name their functions from the last to the first."""
    numbers = np.arange(np.prod(job.shape)).reshape(job.shape, order="F")
    spans = [np.flatnonzero(np.diff(knots)) for knots in job.knots]
    grid = np.stack(np.meshgrid(*spans, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    local = np.stack(np.meshgrid(*map(np.arange, np.array(job.degrees) + 1), indexing="ij"), axis=-1)
    local = local.reshape(-1, 3, order="F")[::-1]
    index = grid[:, None] - np.array(job.degrees) + local
    weights = np.ones(job.shape) if job.weights is None else job.weights
    return Patch(
        element_type="U1",
        degrees=np.array(job.degrees),
        knot_vectors=list(job.knots),
        control_points=job.control_points.reshape(-1, 3, order="F"),
        weights=weights.ravel(order="F"),
        connectivity=numbers[tuple(np.moveaxis(index, 2, 0))],
        spans=grid,
        material=ElasticMaterial(young_modulus=job.young, poisson_ratio=job.poisson),
    )


def main() -> None:
    """Assemble and solve."""
    job = read_job()
    measured = Measured("yeti-iga", job)
    with measured.phase("set-up"):
        model = IgaModel("3D solid")
        model.add_patch(yeti_patch(job))
        clamped = np.flatnonzero(job.clamped.ravel(order="F"))
        model.add_boundary_condition(0, BoundaryCondition(cp_index=clamped, dof=np.arange(3), value=0.0))
    with measured.phase("assembly"):
        stiffness, _ = model.build_stiffness_matrix()
    measured.matrix(stiffness)
    if job.solves:
        free = model.idof_free
        load = job.load.reshape(-1, 3, order="F").ravel()
        measured.solve(stiffness[free][:, free].tocsr(), load[free])
    measured.report()


if __name__ == "__main__":
    main()
