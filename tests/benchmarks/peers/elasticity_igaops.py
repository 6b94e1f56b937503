"""igaops: matrix-free by weighted quadrature, conjugate gradients preconditioned by fast diagonalisation.

Composed of its public parts: quadrature rules, L-mode products, preconditioner and solver; it leaves the sum over the
components of elasticity and the averages of the geometry to its user. Its sparse matrices of B-splines alone are not
measured: it has none of elasticity, nor of NURBS.
"""

from typing import Any

import numpy as np
from common import TOLERANCE, Job, Measured, read_job, skip
from igaops.fastdiag import SingleFD
from igaops.geometry.mixin.template import SingleSpline
from igaops.operators import BsplineOperations, MatrixFree
from igaops.quadrature import WeightedQuadrature
from igaops.solvers import LinearSolver

RULE = "1"  # fewest points; its weights depend on which derivatives of test and trial functions are multiplied
VALUE = None  # a function itself, in place of its derivative along a direction

Along = int | None


class Stiffness:
    """The stiffness of elasticity as an operator on (3 n,), component by component.

    K_ai,bk = sum over directions d, e of ∫ N_a,d D_diek N_b,e with D = λ A_di A_ek + µ A_dk A_ei + µ δ_ik A_d·A_e,
    where A is the inverse of the map's derivative. With weights the gradients of N w/W take N itself, too.
    """

    def __init__(self, spline: SingleSpline, lame: tuple[float, float]) -> None:
        evaluated = spline.evaluate_spline()
        self.rules, self.lame, self.volume = spline.quadrule_list, lame, evaluated.det_jac
        self.inverse = evaluated.inv_jac  # (direction, axis, q)
        self.scale = np.ones(spline.nbctrlpts_total)
        self.factors: dict[Along, Any] = dict(enumerate(self.inverse * np.sqrt(self.volume)))  # (axis, q) of each
        if spline.nurbs_weights.size:
            self.scale = spline.nurbs_weights
            bases = [rule.basis for rule in self.rules]
            self.divisor = BsplineOperations.eval_interpolation(bases, self.scale[None])[0]
            slope = BsplineOperations.eval_jacobien(bases, self.scale[None])[0] / self.divisor
            self.factors = {d: factor / self.divisor for d, factor in self.factors.items()}
            self.factors[VALUE] = -sum(slope[d] * factor for d, factor in self.factors.items())

    def trial(self, coefficients: Any, along: Along) -> Any:
        """Values (3, q) of splines, or of their derivatives."""
        matrices = [rule.basis[d == along] for d, rule in enumerate(self.rules)]
        return np.stack([MatrixFree.apply(matrices, component) for component in coefficients])

    def test(self, values: Any, along: Along, trial: Along = VALUE) -> Any:
        """Integrals (3, n) of values against the functions or their derivatives, for that kind of trial function."""
        matrices = [rule.weights[(d == trial) + 2 * (d == along)] for d, rule in enumerate(self.rules)]
        return np.stack([MatrixFree.apply(matrices, component) for component in values])

    def load(self, force: Any) -> Any:
        """Integrals (3 n,) of a constant force per volume."""
        share = self.volume if len(self.factors) == 3 else self.volume / self.divisor
        return (self.test(np.outer(force, share), VALUE) * self.scale).ravel()

    def __call__(self, displacement: Any) -> Any:
        """Apply it."""
        (lame, mu), result = self.lame, 0.0
        weighted = displacement.reshape(3, -1) * self.scale
        for along, right in self.factors.items():
            slope = self.trial(weighted, along)
            pressed = lame * dot(right, slope)
            for across, left in self.factors.items():
                flux = left * pressed + right * (mu * dot(left, slope)) + slope * (mu * dot(left, right))
                result = result + self.test(flux, across, along)
        return (result * self.scale).ravel()


def dot(one: Any, other: Any) -> Any:
    """Products (q,) of vectors (3, q)."""
    return np.einsum("iq,iq->q", one, other)


def preconditioner(stiffness: Stiffness) -> Any:
    """Fast diagonalisation of each component, with the averages of what multiplies each direction's derivatives."""
    lame, mu = stiffness.lame
    clamped = np.zeros((3, 3, 2), dtype=bool)  # component, direction, end
    clamped[:, 2, 0] = True
    fast = SingleFD()
    fast.compute_space_eigendecomposition(stiffness.rules, clamped)
    squares = stiffness.inverse**2 * stiffness.volume
    across = squares.sum(axis=1)
    means = [(mu * across + (lame + mu) * squares[:, i]).mean(axis=1) for i in range(3)]
    fast.add_scalar_space_time_correctors(stiffness_corrector=means)
    if np.ptp(stiffness.scale) == 0:
        return fast.apply_spatial_preconditioner
    scale = np.tile(stiffness.scale / stiffness.scale.mean(), 3)
    return lambda residual: fast.apply_spatial_preconditioner(residual / scale) / scale


def spline_of(job: Job) -> SingleSpline:
    """Its spline, numbered with the first direction running fastest."""
    rules = [WeightedQuadrature(p, knots, RULE) for p, knots in zip(job.degrees, job.knots, strict=True)]
    points = job.control_points.reshape(-1, 3, order="F").T
    weights = np.array([]) if job.weights is None else job.weights.ravel(order="F")
    return SingleSpline(points, weights, rules)


def main() -> None:
    """Solve."""
    job = read_job()
    measured = Measured("igaops", job)
    if not job.solves:
        skip("has no assembled matrix of elasticity")
    clamped = np.flatnonzero(np.tile(job.clamped.ravel(order="F"), 3)).tolist()
    with measured.phase("set-up"):
        stiffness = Stiffness(spline_of(job), job.lame)
        precondition = preconditioner(stiffness)
        load = stiffness.load(job.force)
        load[clamped] = 0.0
    with measured.phase("solve"):
        solver = LinearSolver(TOLERANCE, 1000, clamped, "cg")
        solver.convergence_manager.parameters["curr_increment"].reference = 0.0  # the residual alone decides
        output = solver.solve(stiffness, load, precondition)
    if not output.success:
        raise RuntimeError("conjugate gradients did not converge")
    energy = load @ output.solution / 2
    measured.report(
        energy=energy,
        iterations=len(output.residual) - 1,
        solver="CG, fast diagonalisation",
        residual=output.residual[-1],
    )


if __name__ == "__main__":
    main()
