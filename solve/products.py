"""Products of two functions of one direction at its quadrature points: the factors of sum factorisation."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from geom2iga.bspline import Array, Indices
from geom2iga.patch import Patch
from solve.bricks import Piece, line
from solve.pattern import Band, find_band
from solve.rules import Rule, Rules

ROWS = 8  # functions of a direction whose products are integrated by one dense matrix


@dataclass(frozen=True, eq=False)
class Tile:
    """Neighbouring functions a of one direction, with all functions b that share a span with them.

    Parameters
    ----------
    rows, columns : (k,)
        The pairs of functions a and b, one a after the other.
    pairs : slice
        These pairs among all of the direction.
    piece : Piece
        The spans on which the functions a are not zero.
    points : slice
        Their quadrature points among all of the direction.
    """

    rows: Indices
    columns: Indices
    pairs: slice
    piece: Piece
    points: slice

    @cached_property
    def products(self) -> Array:
        """Value or slope of a times value or slope of b at the points (2, 2, k, q)."""
        functions = np.stack([self.piece.values.T, self.piece.slopes.T])
        first = self.piece.functions.start
        return functions[:, None, self.rows - first] * functions[:, self.columns - first]


@dataclass(frozen=True, eq=False)
class Direction:
    """One direction of a patch with its quadrature points."""

    knots: Array
    degree: int
    rule: Rule

    @cached_property
    def band(self) -> Band:
        """The pairs of functions that share a span."""
        return find_band(self.knots, self.degree)

    @cached_property
    def point_ends(self) -> Indices:
        """Where the points of each span begin, and the last ones end (s + 1,)."""
        return np.append(0, np.cumsum(self.rule.counts))

    @cached_property
    def spans(self) -> list[Piece]:
        """Each span by itself."""
        return [self._piece(span, span + 1) for span in range(len(self.rule.counts))]

    @cached_property
    def tiles(self) -> list[Tile]:
        """All functions, in as few and as equal tiles of at most ROWS as can be."""
        ends = np.linspace(0, self.band.size, -(-self.band.size // ROWS) + 1).astype(int)
        return [self.tile(int(start), int(stop)) for start, stop in pairwise(ends)]

    def tile(self, start: int, stop: int) -> Tile:
        """The functions start ... stop - 1."""
        begin, end = self.band.spans[0, start], self.band.spans[1, stop - 1] + 1
        pairs = slice(int(self.band.starts[start]), int(self.band.starts[stop]))
        points = slice(int(self.point_ends[begin]), int(self.point_ends[end]))
        return Tile(*self.band.pairs(start, stop), pairs, self._piece(begin, end), points)

    def _piece(self, start: int, stop: int) -> Piece:
        """The spans start ... stop - 1."""
        return line(self.knots, self.degree, self.rule, np.arange(start, stop))

    @cached_property
    def slots(self) -> tuple[int, int]:
        """How many spans one function is nonzero on, at most, and the most points in one.

        That many spans in a row have a slot each: the remainder of the number of the span by the number of slots.
        """
        return int(np.ptp(self.band.spans, axis=0).max()) + 1, int(self.rule.counts.max())

    @cached_property
    def factors(self) -> list[Array]:
        """For each function, its products with those not before it (2, 2, k, q) at the points of the slots."""
        return [self._factor(self.tile(row, row + 1)) for row in range(self.band.size)]

    def _factor(self, tile: Tile) -> Array:
        """Products of one function with those not before it; zero where a slot has no points of its spans."""
        spans, points = self.slots
        products = tile.products[:, :, tile.columns >= tile.rows]
        at = np.arange(tile.points.start, tile.points.stop)
        span = np.searchsorted(self.point_ends, at, "right") - 1
        factor = np.zeros((2, 2, products.shape[2], spans * points))
        factor[..., span % spans * points + at - self.point_ends[span]] = products
        return factor


Known = dict[tuple[int, bytes, bytes], Direction]


def directions_of(patch: Patch, rules: Rules, known: Known) -> tuple[Direction, Direction, Direction]:
    """The directions of a volume, from those known already or added to them."""
    keys = [
        (degree, knots.tobytes(), rule.points.tobytes())
        for knots, degree, rule in zip(patch.knots, patch.degrees, rules, strict=True)
    ]
    for key, knots, degree, rule in zip(keys, patch.knots, patch.degrees, rules, strict=True):
        if key not in known:
            known[key] = Direction(knots, degree, rule)
    first, second, third = (known[key] for key in keys)
    return first, second, third
