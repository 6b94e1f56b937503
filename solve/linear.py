"""Direct solvers for symmetric positive definite systems, behind one small interface."""

import weakref
from importlib.util import find_spec
from typing import Protocol

import numpy as np
from scipy.sparse import csc_array, csr_array, csr_matrix, triu
from scipy.sparse.linalg import splu

from geom2iga.bspline import Array

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
    if not len(right):
        return right.copy()
    solver.factorise(matrix)
    solution = solver.solve(right)
    for _ in range(REFINEMENTS):
        solution = solution + solver.solve(right - matrix @ solution)
    if not np.all(np.isfinite(solution)):
        raise SingularMatrixError
    return solution
