"""Averages of the normal gap over the areas of competence of pressure functions: mortar-KTS and its relatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, vstack

from geom2iga.bspline import Array, Indices
from solve.case import Contact
from solve.contact.cells import Cells
from solve.contact.pressure import points_of, pressure_space
from solve.face import trace_matrix
from solve.space import Space

NEGLIGIBLE = 1e-13  # areas of competence below this fraction of the largest are rounding errors


@dataclass(frozen=True, eq=False)
class Mortar:
    """The discrete gap of one contact pair: g_A = (G_A·u + initial gap_A) / A_A.

    Parameters
    ----------
    rows : (m,)
        Which functions of the pressure space have an area of competence; for mortar-KTS global control-point numbers.
    gap_operator : (m, dofs)
        G = Σ_q a_q R_A N_q [length²].                                     numerator of paper, eq. (25)
    initial_gap : (m,)
        Σ_q a_q R_A g0_q [length³], positive where open.
    area : (m,)
        A_A = Σ_q a_q R_A [length²].                                                paper, eq. (26)
    centres : (m, 3)
        Centres of the areas of competence [length].
    """

    rows: Indices
    gap_operator: csr_array
    initial_gap: Array
    area: Array
    centres: Array

    def control_gaps(self, displacement: Array) -> Array:
        """Average the normal gap over each area of competence.                        paper, eq. (25)

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


def assemble_mortar(space: Space, contact: Contact, cells: Sequence[Cells]) -> Mortar:
    """Integrate gap operator, initial gap and areas of competence over cells.         paper, eqs. (21)-(26)

    Raises
    ------
    CaseError
        The pressure space that the contact asks for does not exist.
    """
    points = points_of(space, cells)
    pressures = pressure_space(space, contact, points)
    operator = csr_array((pressures.size, space.dofs))
    area, gap, first = np.zeros(pressures.size), np.zeros(pressures.size), np.zeros((pressures.size, 3))
    before = 0
    for part in cells:
        functions = pressures.functions(part, before)
        weighted = functions.T.tocsr() * part.area[None, :]
        secondary = trace_matrix(space, part.secondary, part.secondary_xi, part.secondary_spans)
        difference = secondary - trace_matrix(space, part.primary, part.primary_xi, part.primary_spans)
        normal_gap = _along(difference.tocoo(), part.normal, space.dofs)  # N_q, eq. (21)
        operator = operator + weighted @ normal_gap
        area += weighted.sum(axis=1)
        gap += weighted @ part.gap
        first += weighted @ points[before : before + len(part.area)]
        before += len(part.area)
    rows = np.flatnonzero(area > NEGLIGIBLE * area.max(initial=0.0))
    return Mortar(rows, operator[rows], gap[rows], area[rows], first[rows] / area[rows, None])


def point_gaps(space: Space, cells: Sequence[Cells], displacement: Array) -> tuple[Array, Array]:
    """Gaps (q,) of all quadrature points before and after a displacement (n, 3) [length], positive where open."""
    before, after = [np.empty(0)], [np.empty(0)]
    for part in cells:
        secondary = trace_matrix(space, part.secondary, part.secondary_xi, part.secondary_spans) @ displacement
        primary = trace_matrix(space, part.primary, part.primary_xi, part.primary_spans) @ displacement
        before.append(part.gap)
        after.append(part.gap + np.einsum("qk,qk->q", secondary - primary, part.normal))
    return np.concatenate(before), np.concatenate(after)


def _along(scalar: coo_array, normal: Array, dofs: int) -> csr_array:
    """Turn a matrix that interpolates scalars (q, n) into one that interpolates u·n, (q, dofs)."""
    rows = np.repeat(scalar.row, 3)
    columns = (3 * scalar.col[:, None] + np.arange(3)).ravel()
    values = (scalar.data[:, None] * normal[scalar.row]).ravel()
    return coo_array((values, (rows, columns)), shape=(scalar.shape[0], dofs)).tocsr()


def stacked(mortars: Sequence[Mortar], dofs: int) -> Mortar:
    """Put the gaps of several contacts below each other."""
    if not mortars:
        empty = np.empty(0)
        return Mortar(np.empty(0, dtype=np.int64), csr_array((0, dofs)), empty, empty, np.empty((0, 3)))
    return Mortar(
        np.concatenate([m.rows for m in mortars]),
        vstack([m.gap_operator for m in mortars], format="csr"),
        np.concatenate([m.initial_gap for m in mortars]),
        np.concatenate([m.area for m in mortars]),
        np.concatenate([m.centres for m in mortars]),
    )
