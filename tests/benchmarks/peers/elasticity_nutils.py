"""nutils: assembled by its expressions, conjugate gradients of scipy with the diagonal."""

import numpy as np
from common import Measured, read_job
from nutils import matrix, mesh
from nutils.expression_v2 import Namespace
from nutils.solver import System
from scipy.sparse import csr_matrix


def main() -> None:
    """Assemble and solve."""
    job = read_job()
    measured = Measured("nutils", job)
    with matrix.backend("scipy"), measured.phase("assembly"):
        topology, _ = mesh.rectilinear([np.unique(knots) for knots in job.knots])
        basis = topology.basis("spline", degree=job.degrees)
        if job.weights is not None:
            basis = basis * job.weights.ravel()
            basis = basis / basis.sum(0)
        ns = Namespace()
        ns.x = basis @ job.control_points.reshape(-1, 3)
        ns.define_for("x", gradient="∇", jacobians=("dV",))
        ns.δ = np.eye(3)
        ns.λ, ns.μ = job.lame
        ns.f = job.force
        ns.add_field(("u", "v"), basis, shape=(3,))
        ns.σ_ij = "λ ∇_k(u_k) δ_ij + μ (∇_j(u_i) + ∇_i(u_j))"
        residual = topology.integral("(∇_j(v_i) σ_ij - v_i f_i) dV" @ ns, degree=2 * max(job.degrees))
        clamped = np.broadcast_to(job.clamped.reshape(-1, 1), (len(basis), 3))
        system = System(residual, trial="u", test="v")
        jacobian, load = system.assemble_jacobian_residual(*system.deconstruct({}, {"u": clamped}))
        stiffness = csr_matrix(jacobian.export("csr"))
    measured.matrix(stiffness)
    if job.solves:
        measured.solve(stiffness, -load)
    measured.report()


if __name__ == "__main__":
    main()
