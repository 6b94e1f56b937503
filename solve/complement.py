"""What contact adds to the diagonalised inverse: solves with C + G B G' of the active gaps."""

from typing import Protocol

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator, cg

from geom2iga.bspline import Array, Indices
from solve.bricks import Floats
from solve.inverse import Inverse
from solve.linear import SingularMatrixError

DENSE = 5000  # most gaps whose complement is formed and factorised
TIGHT = 1e-5  # relative residual of conjugate gradients for more of them, near what single precision allows
MOST_ITERATIONS = 500


class Complement(Protocol):
    """C + G B G' of some gaps."""

    def solved(self, gap: Floats) -> Floats:
        """Pressures (k,) that close gaps (k,), in single precision."""


class Factors:
    """Cholesky factors of a complement (k, k).

    Raises
    ------
    SingularMatrixError
        Where it is not positive definite to rounding.
    """

    def __init__(self, matrix: Array) -> None:
        try:
            factors, lower = cho_factor(matrix, overwrite_a=True, check_finite=False)
        except LinAlgError as error:
            raise SingularMatrixError from error
        self._factors = factors.astype(np.float32), lower

    def solved(self, gap: Floats) -> Floats:
        """Solve with the factors."""
        return cho_solve(self._factors, gap, check_finite=False)  # what is not finite ends the iterations


class Iterations:
    """Conjugate gradients for a complement that is only applied.

    Where the gaps are those of control points of a face, its modes are a preconditioner: with the bases U of the
    patch, U' M U = I for the mass matrix M of the face, G is about M and C about c M, so that U (c + 2 E)^-1 U' is near
    the inverse; E is what forces in a mode of the face move it by, twice for two bodies.

    Parameters
    ----------
    inverse : Inverse
    operator : (k, dofs)
    compliance : (k,)
        C
    area : (k,)
        Of competence.
    points : (k,)
        Control point of each gap; -1 where its pressure is not that of a control point.
    unit : float
        Of the pressures: the operator is G times it, compliance and area are C and A times its square.
    """

    def __init__(
        self, inverse: Inverse, operator: csr_array, compliance: Array, area: Array, points: Indices, unit: float
    ) -> None:
        self._inverse, self._operator, self._transposed = inverse, operator, csr_array(operator.T)
        self._compliance, softness = compliance.astype(np.float32), compliance / area
        faces = inverse.faces
        mobility = np.mean([modes.mobility.mean() for _, _, modes in faces])
        diagonal, covered = self._compliance + 2 * mobility * area, np.zeros(len(points), dtype=bool)
        self._faces = []
        for numbers, share, modes in faces:
            place = np.full(max(points.max(initial=0), numbers.max()) + 2, -1)  # the last one is for no control point
            place[numbers] = np.where(share > 0, np.arange(len(numbers)), -1)
            rows = np.flatnonzero(place[points] >= 0)
            if len(rows):
                places = place[points[rows]]
                self._faces.append((rows, places, share[places] / unit, modes.softened(softness[rows].mean())))
                covered[rows] = True
        self._rest = np.where(covered, 0, 1 / diagonal).astype(np.float32)

    def solved(self, gap: Floats) -> Floats:
        """Solve by conjugate gradients."""
        shape = (len(gap), len(gap))
        applied, near = (LinearOperator(shape, f, dtype=gap.dtype) for f in (self._applied, self._near))
        return cg(applied, gap, rtol=TIGHT, maxiter=MOST_ITERATIONS, M=near)[0]

    def _applied(self, pressure: Floats) -> Floats:
        """Apply C + G B G'."""
        moved = self._inverse.traced(self._inverse.pushed(self._transposed @ pressure))
        return self._compliance * pressure + self._operator @ moved

    def _near(self, gap: Floats) -> Floats:
        """Apply the preconditioner."""
        found = gap * self._rest
        for rows, places, share, modes in self._faces:
            grid = np.zeros(modes.mobility.size, dtype=gap.dtype)
            grid[places] = share * gap[rows]
            found[rows] += share * modes.solved(grid)[places]
        return found
