"""Averages of the normal gap over the areas of competence of pressure functions: mortar-KTS and its relatives."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import prod
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, vstack

from geom2iga.bspline import Array, Indices
from geom2iga.patch import CHUNK, chunks, evaluate
from geom2iga.progress import tracked
from solve.case import Contact
from solve.contact.cells import Cells
from solve.contact.pressure import pressure_space
from solve.face import trace
from solve.space import Space

NEGLIGIBLE = 1e-13  # areas of competence below this fraction of the largest are rounding errors
UPRIGHT = 1e-15  # components of unit normals that are nowhere larger are rounding errors


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
    pressures = pressure_space(space, contact, np.concatenate([part.points for part in cells]))
    operator = csr_array((pressures.size, space.dofs))
    area, gap, first = np.zeros(pressures.size), np.zeros(pressures.size), np.zeros((pressures.size, 3))
    before, pairs = 0, tracked(cells, "contact integrals")
    for part, runs in (some for each in pairs for some in _runs(space, each, pressures.pointwise)):
        functions = pressures.functions(part, before)
        operator = operator + _products(space, part, functions, runs)
        weighted = functions.T.tocsr() * part.area[None, :]
        area += weighted.sum(axis=1)
        gap += weighted @ part.gap
        first += weighted @ part.points
        before += len(part.area)
    rows = np.flatnonzero(area > NEGLIGIBLE * area.max(initial=0.0))
    operator = operator[rows]
    operator.sum_duplicates()
    return Mortar(rows, operator, gap[rows], area[rows], first[rows] / area[rows, None])


def point_gaps(space: Space, cells: Sequence[Cells], displacement: Array) -> tuple[Array, Array]:
    """Gaps (q,) of all quadrature points before and after a displacement (n, 3) [length], positive where open."""
    before, after = [np.empty(0)], [np.empty(0)]
    for part in cells:
        secondary, primary = (
            evaluate(space.model.surface(face), xi, 0, displacement[space.face_numbers(face)], spans)[0]
            for face, xi, spans in (
                (part.secondary, part.secondary_xi, part.secondary_spans),
                (part.primary, part.primary_xi, part.primary_spans),
            )
        )
        before.append(part.gap)
        after.append(part.gap + np.einsum("qk,qk->q", secondary - primary, part.normal))
    return np.concatenate(before), np.concatenate(after)


class Runs(NamedTuple):
    """Points in a row that share all functions: whose spans on both sides are the same, cut to a common length."""

    start: Indices  # (r,)
    end: Indices  # (r,)
    longest: int


def _runs(space: Space, cells: Cells, pointwise: bool) -> Iterator[tuple[Cells, Runs]]:
    """Take as many runs at a time as fit a bounded memory.

    Parameters
    ----------
    pointwise : bool
        Every point has a pressure function of its own.
    """
    spans = np.concatenate([cells.secondary_spans, cells.primary_spans], axis=1)
    borders = np.flatnonzero(np.any(spans[1:] != spans[:-1], axis=1)) + 1
    lengths = np.diff(np.concatenate([[0], borders, [len(spans)]]))
    longest = 1 if pointwise else int(np.median(lengths))
    pieces = -(-lengths // longest)
    start = np.repeat(np.cumsum(lengths) - lengths, pieces)
    start += longest * (np.arange(len(start)) - np.repeat(np.cumsum(pieces) - pieces, pieces))
    end = np.append(start[1:], len(spans))
    widths = [prod(p + 1 for p in space.model.surface(face).degrees) for face in (cells.secondary, cells.primary)]
    for part in chunks(len(start), max(1, CHUNK // (3 * sum(widths) * max(longest, widths[0])))):
        first, last = start[part][0], end[part][-1]
        yield cells.chosen(slice(first, last)), Runs(start[part] - first, end[part] - first, longest)


def _products(space: Space, cells: Cells, functions: csr_array, runs: Runs) -> csr_array:
    """Integrate pressure functions times N_q, (rows, dofs): one small dense product for each run of points.

    Parameters
    ----------
    functions : (q, rows)
        Pressure functions at the points, equally many for each.
    """
    sides = (
        trace(space, cells.secondary, cells.secondary_xi, cells.secondary_spans),
        trace(space, cells.primary, cells.primary_xi, cells.primary_spans),
    )
    numbers = np.concatenate([side[0][runs.start] for side in sides], axis=1)
    relative = np.concatenate([sides[0][1], -sides[1][1]], axis=1)
    axes = np.flatnonzero(np.abs(cells.normal).max(axis=0) > UPRIGHT)
    slots = runs.start[:, None] + np.arange(runs.longest)
    meant = slots < runs.end[:, None]
    slots = np.where(meant, slots, runs.start[:, None])
    weights = np.where(meant, cells.area[slots], 0.0)
    left = functions.data.reshape(len(relative), -1)[slots] * weights[:, :, None]
    right = relative[slots][:, :, :, None] * cells.normal[:, axes][slots][:, :, None]  # N_q, eq. (21)
    blocks = left.swapaxes(1, 2) @ right.reshape(*slots.shape, -1)
    columns = (3 * numbers[:, :, None] + axes).reshape(len(numbers), 1, -1)
    apart = _rows(np.broadcast_to(columns, blocks.shape).reshape(-1, blocks.shape[2]), blocks, space.dofs)
    own = functions.indices.reshape(len(relative), -1)[runs.start].reshape(-1, 1)
    return _rows(own, np.ones(own.shape), functions.shape[1]).T.tocsr() @ apart


def _rows(columns: Indices, values: Array, size: int) -> csr_array:
    """Matrix (k, size) of which each row has equally many entries, in columns (k, a)."""
    starts = np.arange(len(columns) + 1) * columns.shape[1]
    return csr_array((values.ravel(), columns.ravel(), starts), shape=(len(columns), size))


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
