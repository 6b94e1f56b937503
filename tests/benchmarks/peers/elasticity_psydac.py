"""psydac: forms compiled by pyccel in every process, conjugate gradients of scipy with the diagonal.

The displacements are splines on the rational map, not rational: another space than that of the others on the ring.
"""

import tempfile
from contextlib import chdir
from typing import Any

import numpy as np
from common import Job, Measured, read_job
from psydac.api.discretization import discretize
from psydac.api.settings import PSYDAC_BACKENDS
from psydac.cad.geometry import Geometry
from psydac.ddm.cart import DomainDecomposition
from psydac.fem.splines import SplineSpace
from psydac.fem.tensor import TensorFemSpace
from psydac.mapping.discrete import NurbsMapping, SplineMapping
from sympde.calculus import div, dot, grad, inner
from sympde.calculus.matrices import Transpose
from sympde.expr import BilinearForm, LinearForm, integral
from sympde.topology import VectorFunctionSpace, element_of
from sympy import Tuple


def mapping(job: Job) -> SplineMapping:
    """Its map of the job's geometry."""
    spaces = [SplineSpace(p, knots=knots, periodic=False) for p, knots in zip(job.degrees, job.knots, strict=True)]
    decomposition = DomainDecomposition([space.ncells for space in spaces], [False] * 3)
    space = TensorFemSpace(decomposition, *spaces)
    if job.weights is None:
        return SplineMapping.from_control_points(space, job.control_points)
    return NurbsMapping.from_control_points_weights(space, job.control_points, job.weights)


def compiled(job: Job) -> tuple[Any, Any]:
    """Compile the stiffness and the load."""
    geometry = Geometry.from_discrete_mapping(mapping(job), name="body")
    space = VectorFunctionSpace("V", geometry.domain)
    u, v = (element_of(space, name=name) for name in "uv")
    lame, mu = job.lame
    strains = [grad(w) + Transpose(grad(w)) for w in (u, v)]
    stiffness = BilinearForm((u, v), integral(geometry.domain, lame * div(u) * div(v) + mu / 2 * inner(*strains)))
    load = LinearForm(v, integral(geometry.domain, dot(Tuple(*job.force.tolist()), v)))
    discrete, backend = discretize(space, geometry, degree=job.degrees), PSYDAC_BACKENDS["pyccel-gcc"]
    return (
        discretize(stiffness, geometry, [discrete, discrete], backend=backend),
        discretize(load, geometry, discrete, backend=backend),
    )


def main() -> None:
    """Compile, assemble and solve."""
    job = read_job()
    measured = Measured("psydac", job)
    with tempfile.TemporaryDirectory() as folder, chdir(folder):  # it writes and compiles code where it runs
        with measured.phase("compiling"):
            form, load = compiled(job)
        with measured.phase("assembly"):
            stiffness = form.assemble().tosparse().tocsr()
        measured.matrix(stiffness)
        right = load.assemble().toarray()
    if job.solves:
        free = np.flatnonzero(np.tile(~job.clamped.ravel(), 3))
        measured.solve(stiffness[free][:, free], right[free])
    measured.report(unlike_space=job.weights is not None)


if __name__ == "__main__":
    main()
