"""Mortar-KTS: normal gaps averaged over the area of competence of each secondary control point."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, vstack

from geom2iga.bspline import Array, Indices
from solve.contact.cells import Cells
from solve.face import trace_matrix
from solve.space import Space

NEGLIGIBLE = 1e-13  # areas of competence below this fraction of the largest are rounding errors


@dataclass(frozen=True, eq=False)
class Mortar:
    """The discrete gap of one contact pair: g_A = (G_A·u + initial gap_A) / A_A.

    Parameters
    ----------
    control_points : (m,)
        Global numbers of the secondary control points that have an area of competence.
    gap_operator : (m, dofs)
        G = Σ_q a_q R_A N_q [length²].                                     numerator of paper, eq. (25)
    initial_gap : (m,)
        Σ_q a_q R_A g0_q [length³], positive where open.
    area : (m,)
        A_A = Σ_q a_q R_A [length²].                                                paper, eq. (26)
    """

    control_points: Indices
    gap_operator: csr_array
    initial_gap: Array
    area: Array

    def control_gaps(self, displacement: Array) -> Array:
        """Average the normal gap over each control point's area of competence.       paper, eq. (25)

        Parameters
        ----------
        displacement : (n, 3)
            Displacements of all control points [length].

        Returns
        -------
        (m,)
            Positive where open, negative where the bodies overlap [length].
        """
        return (self.gap_operator @ displacement.ravel() + self.initial_gap) / self.area


def assemble_mortar(space: Space, cells: Sequence[Cells]) -> Mortar:
    """Integrate the gap operator, the initial gap and the areas of competence over cells.   paper, eqs. (21)-(26)"""
    size = space.size
    operator = csr_array((size, space.dofs))
    area, gap = np.zeros(size), np.zeros(size)
    for part in cells:
        secondary = trace_matrix(space, part.secondary, part.secondary_xi)
        weighted = secondary.T.tocsr() * part.area[None, :]
        difference = secondary - trace_matrix(space, part.primary, part.primary_xi)
        normal_gap = _along(difference.tocoo(), part.normal, space.dofs)  # N_q, eq. (21)
        operator = operator + weighted @ normal_gap
        area += weighted.sum(axis=1)
        gap += weighted @ part.gap
    control_points = np.flatnonzero(area > NEGLIGIBLE * area.max(initial=0.0))
    return Mortar(control_points, operator[control_points], gap[control_points], area[control_points])


def _along(scalar: coo_array, normal: Array, dofs: int) -> csr_array:
    """Turn a matrix that interpolates scalars (q, n) into one that interpolates u·n, (q, dofs)."""
    rows = np.repeat(scalar.row, 3)
    columns = (3 * scalar.col[:, None] + np.arange(3)).ravel()
    values = (scalar.data[:, None] * normal[scalar.row]).ravel()
    return coo_array((values, (rows, columns)), shape=(scalar.shape[0], dofs)).tocsr()


def stacked(mortars: Sequence[Mortar], dofs: int) -> Mortar:
    """Put the control gaps of several contacts below each other."""
    if not mortars:
        return Mortar(np.empty(0, dtype=np.int64), csr_array((0, dofs)), np.empty(0), np.empty(0))
    return Mortar(
        np.concatenate([m.control_points for m in mortars]),
        vstack([m.gap_operator for m in mortars], format="csr"),
        np.concatenate([m.initial_gap for m in mortars]),
        np.concatenate([m.area for m in mortars]),
    )
