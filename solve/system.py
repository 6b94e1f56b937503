"""Energy, residual and tangent of the whole problem in its free unknowns."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array, diags_array, issparse
from scipy.sparse.linalg import LinearOperator, aslinearoperator

from geom2iga.bspline import Array, Mask
from solve.constraints import AffineMap
from solve.contact.laws import Penalty
from solve.contact.mortar import Mortar
from solve.rigid import kernel


@dataclass(frozen=True, eq=False)
class System:
    """Π(v) = ½ vᵀK v - fᵀv + ½ Σ_A ε A_A min(g_A, 0)², g_A = (G_A·v + g0_A) / A_A: convex, piecewise quadratic.

    Parameters
    ----------
    stiffness : (free, free)
        A matrix, or an operator that is only applied.
    load : (free,)
    gap_operator : (m, free)
    initial_gap : (m,) [length³]
    area : (m,) [length²]
    law : Penalty
    rigid : (free, k)
        Rigid motions that the supports leave free.
    """

    stiffness: csr_array | LinearOperator
    load: Array
    gap_operator: csr_array
    initial_gap: Array
    area: Array
    law: Penalty
    rigid: Array

    def shifted(self, shift: Array) -> "System":
        """Make every gap smaller by so much (m,) [length]: the springs press before the bodies meet."""
        return replace(self, initial_gap=self.initial_gap - self.area * shift)

    def rigidly(self) -> "System":
        """The problem of bodies that move only along the rigid motions that the supports leave free."""
        count = self.rigid.shape[1]
        load, operator = self.rigid.T @ self.load, csr_array(self.gap_operator @ self.rigid)
        stiffness = csr_array((count, count))
        return replace(self, stiffness=stiffness, load=load, gap_operator=operator, rigid=np.eye(count))

    def control_gaps(self, free: Array) -> Array:
        """Control-point gaps (m,) [length], positive where open.                    paper, eq. (25)"""
        return (self.gap_operator @ free + self.initial_gap) / self.area

    def contact_forces(self, gap: Array) -> Array:
        """Forces (free,) of the contact pressure.                                   paper, eq. (27)"""
        return self.gap_operator.T @ self.law.pressure(gap)

    def energy(self, free: Array, inner: Array | None = None) -> float:
        """Total potential energy; inner forces K v (free,) may be given where they are known."""
        inner = self.stiffness @ free if inner is None else inner
        return float(free @ inner / 2 - self.load @ free) + self.law.energy(self.control_gaps(free), self.area)

    def residual(self, free: Array, inner: Array | None = None) -> Array:
        """Forces out of balance (free,): minus the gradient of the energy.           paper, eq. (29)"""
        inner = self.stiffness @ free if inner is None else inner
        return self.load - inner + self.contact_forces(self.control_gaps(free))

    def tangent(self, active: Mask) -> csr_array:
        """Second derivative of the energy while the given control points (m,) bool touch.   paper, eq. (30)"""
        scale = np.where(active, self.law.stiffness / self.area, 0.0)
        rows = np.flatnonzero(scale)
        operator = self.gap_operator[rows]
        return csr_array(self.stiffness + operator.T @ (diags_array(scale[rows]) @ operator))

    def force_scale(self, free: Array, inner: Array | None = None) -> float:
        """Largest force on a control point among loads, stresses and contact, to compare residuals with."""
        inner = self.stiffness @ free if inner is None else inner
        parts = (self.load, inner, self.contact_forces(self.control_gaps(free)))
        return float(max(np.abs(part).max(initial=0.0) for part in parts))

    def loose(self, active: Mask) -> Array:
        """Orthonormal rigid motions (free, f) that neither supports nor the given control points, pressed, resist."""
        rows = (self.gap_operator[active] @ self.rigid) / self.area[active, None]
        return np.linalg.qr(self.rigid @ kernel(rows))[0]

    def holds(self, active: Mask) -> bool:
        """Whether the given control points, pressed, hold all rigid motions that the supports leave free."""
        count = self.rigid.shape[1]
        if count == 0:
            return True
        rows = (self.gap_operator[active] @ self.rigid) / self.area[active, None]
        return len(rows) >= count and bool(np.linalg.svd(rows, compute_uv=False)[-1] > 1e-6)


def reduced_system(
    stiffness: csr_array | LinearOperator,
    load: Array,
    mortar: Mortar,
    law: Penalty,
    allowed: AffineMap,
    rigid: Array,
) -> System:
    """Restrict the problem to the displacements that the supports allow.

    Parameters
    ----------
    stiffness : (dofs, dofs)
    load : (dofs,)
    rigid : (dofs, k)
        Rigid motions that the supports leave free.
    """
    matrix = allowed.matrix
    if issparse(stiffness):
        restricted = _restricted(stiffness, matrix)
    else:
        restricted = aslinearoperator(matrix.T) @ stiffness @ aslinearoperator(matrix)
    return System(
        restricted,
        matrix.T @ (load - stiffness @ allowed.offset if allowed.offset.any() else load),
        csr_array(mortar.gap_operator @ matrix),
        mortar.initial_gap + mortar.gap_operator @ allowed.offset,
        mortar.area,
        law,
        matrix.T @ rigid,
    )


def _restricted(stiffness: csr_array, matrix: csr_array) -> csr_array:
    """Z' K Z; rows and columns of K where Z only leaves some out."""
    chosen = matrix.tocoo()
    if np.all(chosen.data == 1) and np.all(np.diff(chosen.row) > 0) and chosen.nnz == matrix.shape[1]:
        return csr_array(stiffness[chosen.row][:, chosen.row])
    return csr_array(matrix.T @ stiffness @ matrix)
