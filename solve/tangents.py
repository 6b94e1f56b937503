"""Solves with the tangents of a contact problem: by factors of an assembled matrix."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import LinearOperator, cg

from geom2iga.bspline import Array, Mask
from solve.contact.laws import Law
from solve.linear import DirectSolver, SingularMatrixError
from solve.system import System

REFINEMENTS = 2
EXACT = 1e-14  # relative residual of conjugate gradients for multipliers
MOST_ITERATIONS = 200


class Tangents(Protocol):
    """Solves with the tangents of a contact problem; which gaps press (m,) bool is said each time.

    Attributes
    ----------
    name : str
        Of the method.
    factorisations, iterations : int
        How many there were so far; iterations of conjugate gradients.
    """

    name: str
    factorisations: int
    iterations: int

    def solved(self, active: Mask, right: Array, tolerance: float) -> Array:
        """Solve with the stiffness and the springs of active gaps for a right-hand side (n,).

        Parameters
        ----------
        tolerance : float
            Relative; solutions may be much better, or, where rounding forbids, worse.

        Raises
        ------
        SingularMatrixError
            The tangent is singular to rounding.
        """

    def equalised(self, system: System, law: Law, active: Mask, guess: Array) -> tuple[Array, Array]:
        """Solve with g + c p = 0 where active and p = 0 elsewhere: displacement (n,) and pressure (m,).

        Parameters
        ----------
        guess : (m,)
            Pressure to begin with.

        Raises
        ------
        SingularMatrixError
            There is no one solution.
        """


class Factorised:
    """Tangents that are factorised, each once for as long as the active set stays.

    Parameters
    ----------
    tangent : function
        From active gaps (m,) bool to the matrix (n, n), symmetric positive definite.
    solver : DirectSolver
    """

    def __init__(self, tangent: Callable[[Mask], csr_array], solver: DirectSolver) -> None:
        self._tangent, self._solver, self.name = tangent, solver, solver.name
        self._factorised: bytes | None = None
        self.factorisations = self.iterations = 0

    def solved(self, active: Mask, right: Array, tolerance: float = 0.0) -> Array:
        """Factorise, solve, and refine the solution twice with its residual."""
        self._factorise(active)
        solution = self._solve(right)
        for _ in range(REFINEMENTS):
            solution = solution + self._solve(right - self._matrix @ solution)
        if not np.all(np.isfinite(solution)):
            raise SingularMatrixError
        return solution

    def equalised(self, system: System, law: Law, active: Mask, guess: Array) -> tuple[Array, Array]:
        """Find the multiplier by conjugate gradients.

        [ K  -G' ] [v]   [  f ]        With the springs s of the law, K + G' (s/A) G is well conditioned, and the
        [ G   cA ] [p] = [ -g0]        multiplier has a Schur complement close to A/s: few iterations are enough.
        """
        self._factorise(active)
        shift, spring = law.softness, np.where(active, law.stiffness, 0.0)
        rows = np.flatnonzero(active & (shift > 0))
        operator, c, k = system.gap_operator[rows], law.compliance[rows], shift[rows]
        load = system.load - system.gap_operator.T @ (spring * system.initial_gap / system.area)
        diagonal = system.area[rows] * c * (1 + c / k)

        def schur(values: Array) -> Array:
            return diagonal * values + operator @ self._solve(operator.T @ values)

        right = -(operator @ self._solve(load) + system.initial_gap[rows])
        scale = law.stiffness[rows] * k
        preconditioner = diags_array(law.stiffness[rows] / system.area[rows])
        complement = LinearOperator((len(rows), len(rows)), schur, dtype=float)
        options = {"rtol": EXACT, "maxiter": MOST_ITERATIONS, "M": preconditioner, "callback": self._count}
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            found, _ = cg(complement, right, guess[rows] * scale, **options)
        if not np.all(np.isfinite(found)):
            raise SingularMatrixError
        free = self.solved(active, load + operator.T @ found)
        multiplier = np.zeros(len(active))
        multiplier[rows] = found / scale
        return free, spring * (shift * multiplier - system.control_gaps(free))

    def _count(self, _: Array) -> None:
        self.iterations += 1

    def _factorise(self, active: Mask) -> None:
        """Make ready to solve with a tangent; raise SingularMatrixError where it is singular."""
        key = active.tobytes()
        if key == self._factorised:
            return
        self._factorised = None
        self._matrix = self._tangent(active)
        if self._matrix.shape[0]:
            self._solver.factorise(self._matrix)
        self._factorised, self.factorisations = key, self.factorisations + 1

    def _solve(self, right: Array) -> Array:
        """Solve once with the last tangent."""
        return self._solver.solve(right) if len(right) else right.copy()
