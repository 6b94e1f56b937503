"""Direct solvers for symmetric positive definite systems, behind one small interface."""

import weakref
from collections.abc import Callable
from importlib.util import find_spec
from typing import Protocol

import numpy as np
from scipy.sparse import csc_array, csr_array, csr_matrix, triu
from scipy.sparse.linalg import splu

from geom2iga.bspline import Array, Mask

REFINEMENTS = 2


class SingularMatrixError(Exception):
    """The matrix could not be factorised."""


class DirectSolver(Protocol):
    """Factorises one matrix at a time."""

    name: str

    def factorise(self, matrix: csr_array) -> None:
        """Factorise a symmetric positive definite matrix (n, n), or raise SingularMatrixError."""

    def solve(self, right: Array) -> Array:
        """Solve for a right-hand side (n,) with the last matrix."""


class SuperLU:
    """Scipy's sparse LU factorisation, for any machine."""

    name = "superlu"

    def factorise(self, matrix: csr_array) -> None:
        """Factorise, keeping the diagonal as pivots."""
        options = {"SymmetricMode": True}
        try:
            self._factors = splu(csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        except RuntimeError as error:
            raise SingularMatrixError from error

    def solve(self, right: Array) -> Array:
        """Solve with the factors."""
        return self._factors.solve(right)


class Pardiso:
    """MKL's PARDISO through pypardiso, Cholesky factors of the upper triangle."""

    name = "pardiso"

    def __init__(self) -> None:
        from pypardiso import PyPardisoSolver

        self._solver = PyPardisoSolver(mtype=2)
        weakref.finalize(self, self._solver.free_memory, everything=True)

    def factorise(self, matrix: csr_array) -> None:
        """Factorise; the memory of the previous factors is used again."""
        from pypardiso.pardiso_wrapper import PyPardisoError

        self._upper = csr_matrix(triu(matrix, format="csr"))
        self._upper.sort_indices()
        try:
            self._solver.factorize(self._upper)
        except (PyPardisoError, ValueError) as error:  # a ValueError where a row is empty
            raise SingularMatrixError from error

    def solve(self, right: Array) -> Array:
        """Solve with the factors."""
        return self._solver.solve(self._upper, right).ravel()


def direct_solver(name: str | None = None) -> DirectSolver:
    """Make the direct solver "pardiso" or "superlu"; left out, PARDISO where pypardiso is installed."""
    if name is None:
        name = "pardiso" if find_spec("pypardiso") else "superlu"
    return Pardiso() if name == "pardiso" else SuperLU()


def solved(solver: DirectSolver, matrix: csr_array, right: Array) -> Array:
    """Factorise, solve, and refine the solution twice with its residual.

    Parameters
    ----------
    matrix : (n, n)
        Symmetric positive definite.
    right : (n,)

    Raises
    ------
    SingularMatrixError
        The matrix is singular to rounding.
    """
    return Tangents(lambda active: matrix, solver).solved(np.empty(0, dtype=bool), right)


class Tangents:
    """Solves with the tangents of a contact problem, each factorised once for as long as the active set stays.

    Parameters
    ----------
    tangent : function
        From active gaps (m,) bool to the matrix (n, n), symmetric positive definite.
    solver : DirectSolver

    Attributes
    ----------
    factorisations, iterations : int
        How many there were so far; iterations of conjugate gradients.
    """

    def __init__(self, tangent: Callable[[Mask], csr_array], solver: DirectSolver) -> None:
        self._tangent, self.solver = tangent, solver
        self._factorised: bytes | None = None
        self.factorisations = self.iterations = 0

    def factorise(self, active: Mask) -> None:
        """Make ready to solve with a tangent; raise SingularMatrixError where it is singular."""
        key = active.tobytes()
        if key == self._factorised:
            return
        self._factorised = None
        self._matrix = self._tangent(active)
        if self._matrix.shape[0]:
            self.solver.factorise(self._matrix)
        self._factorised, self.factorisations = key, self.factorisations + 1

    def solve(self, right: Array) -> Array:
        """Solve once for a right-hand side (n,) with the last tangent."""
        return self.solver.solve(right) if len(right) else right.copy()

    def solved(self, active: Mask, right: Array) -> Array:
        """Factorise, solve for a right-hand side (n,), and refine the solution twice with its residual.

        Raises
        ------
        SingularMatrixError
            The matrix is singular to rounding.
        """
        self.factorise(active)
        solution = self.solve(right)
        for _ in range(REFINEMENTS):
            solution = solution + self.solve(right - self._matrix @ solution)
        if not np.all(np.isfinite(solution)):
            raise SingularMatrixError
        return solution
