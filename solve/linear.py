"""Direct solvers for symmetric positive definite systems, behind one small interface."""

import os
import sys
import weakref
from importlib.util import find_spec
from pathlib import Path
from typing import Protocol

import numpy as np
from scipy.sparse import csc_array, csr_array, csr_matrix
from scipy.sparse.linalg import splu

from geom2iga.bspline import Array


class SingularMatrixError(Exception):
    """The matrix could not be factorised."""


class SlowError(SingularMatrixError):
    """Iterations did not come to an end."""


class DirectSolver(Protocol):
    """Factorises one matrix at a time."""

    name: str
    fill: float  # memory of the factors, in units of PARDISO's

    def factorise(self, matrix: csr_array) -> None:
        """Factorise a symmetric positive definite matrix (n, n), or raise SingularMatrixError."""

    def solve(self, right: Array) -> Array:
        """Solve for a right-hand side (n,) with the last matrix."""


class SuperLU:
    """Scipy's sparse LU factorisation, for any machine."""

    name, fill = "superlu", 2.0

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

    name, fill = "pardiso", 1.0

    def __init__(self) -> None:
        from pypardiso import PyPardisoSolver

        for library in Path(sys.prefix, "lib").glob("libmkl_rt*"):  # else it searches all folders, each time
            os.environ.setdefault("PYPARDISO_MKL_RT", str(library))
        os.environ.setdefault("MKL_CBWR", "AUTO")  # else no two runs on several threads add up in the same sequence
        self._solver = PyPardisoSolver(mtype=2)
        weakref.finalize(self, self._solver.free_memory, everything=True)

    def factorise(self, matrix: csr_array) -> None:
        """Factorise; the memory of the previous factors is used again."""
        from pypardiso.pardiso_wrapper import PyPardisoError

        matrix.sort_indices()
        rows, diagonal = np.diff(matrix.indptr), np.arange(matrix.shape[0], dtype=matrix.indices.dtype)
        kept = matrix.indices >= np.repeat(diagonal, rows)
        before = np.append(0, np.cumsum(kept))[matrix.indptr]
        self._upper = csr_matrix((matrix.data[kept], matrix.indices[kept], before), shape=matrix.shape)
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
