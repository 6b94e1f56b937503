"""Integrals of products of gradients over a patch, by sum factorisation (Antolin et al. 2015)."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, product
from math import prod
from typing import NamedTuple

import numpy as np

from geom2iga.bspline import Array
from geom2iga.patch import CHUNK, Patch, chunks
from geom2iga.threads import thread_count
from solve.bricks import Brick
from solve.metric import metric_of
from solve.products import Direction, Tile


class Part(NamedTuple):
    """A few functions of a tile of the third direction."""

    points: slice  # of the tile
    pairs: slice  # of the tile
    factor: Array  # (4 q, k) from the points in all four groups


@dataclass(frozen=True, eq=False)
class GradientProducts:
    """µ ∫ R_a,i R_b,j dV for the functions a and b of a patch that share a span, but for their weights w_a w_b.

    With the metric E of `metric_of` it is the sum over k, m of ∫ E_ki E_mj ∂_k B_a ∂_m B_b dξ, where for rational
    functions B itself counts as one of its derivatives. As it is symmetric, b does not come before a in the first
    direction. The products E_ki E_mj are kept for the spans of one function of the first direction at a time.

    Parameters
    ----------
    shear : float
        µ [stress]
    """

    patch: Patch
    shear: float
    directions: tuple[Direction, Direction, Direction]

    @property
    def rational(self) -> bool:
        """Whether the weights differ."""
        return self.patch.is_rational

    @cached_property
    def kinds(self) -> tuple[int, ...]:
        """The derivatives k, 3 for the function itself; the last one is that along the third direction."""
        return (0, 1, 3, 2) if self.rational else (0, 1, 2)

    @cached_property
    def places(self) -> dict[tuple[int, int], int]:
        """Where E_k E_m is kept, k <= m."""
        pairs = zip(*np.triu_indices(len(self.kinds)), strict=True)
        return {(int(k), int(m)): place for place, (k, m) in enumerate(pairs)}

    @cached_property
    def groups(self) -> list[list[tuple[int, int]]]:
        """Pairs k, m in four groups: neither is the derivative along the third direction, m is, k is, both are."""
        last = len(self.kinds) - 1
        return [[(k, m) for k in one for m in other] for one, other in product((range(last), (last,)), repeat=2)]

    def tiles(self) -> list[tuple[Tile, Tile]]:
        """Cut the functions of the second and third direction so that what is kept for a tile of each remains small."""
        first, second, third = self.directions
        kept = 9 * len(self.places) * prod(first.slots) * max(len(tile.piece.points) for tile in second.tiles)
        kept *= max(len(tile.piece.points) for tile in third.tiles)
        runs = chunks(len(third.tiles), max(1, CHUNK // (kept * thread_count())))
        longer = [third.tile(third.tiles[run][0].rows[0], third.tiles[run][-1].rows[-1] + 1) for run in runs]
        return list(product(second.tiles, longer))

    def slabs(self, second: Tile, third: Tile) -> Iterator[tuple[int, Array]]:
        """Integrate the products with the functions a of two tiles, for one function of the first direction at a time.

        Yields
        ------
        int, (3, 3, k_1, k_2, k_3)
            Number of that function and the integrals for i, j and the pairs of functions of each direction.
        """
        across, along = self._second_factors(second), self._third_factors(third)
        first = self.directions[0]
        spans, points = first.slots
        kept = np.zeros((len(self.places), 3, 3, spans * points, len(second.piece.points), len(third.piece.points)))
        known = 0
        for row, factor in enumerate(first.factors):
            for span in range(known, int(first.band.spans[1, row]) + 1):
                piece, start = first.spans[span], span % spans * points
                brick = Brick((piece, second.piece, third.piece))
                self._keep(brick, kept[:, :, :, start : start + len(piece.points)])
                known = span + 1
            yield row, self._integrated(kept, factor, across, along)

    def _keep(self, brick: Brick, kept: Array) -> None:
        """Set the products E_ki E_mj, k <= m, at the points of a span of the first direction."""
        metric, slopes = metric_of(brick, self.patch, self.shear)
        if slopes is not None:
            metric = np.concatenate([metric[:2], -np.einsum("kq,kiq->iq", slopes, metric)[None], metric[2:]])
        metric = metric.reshape(len(self.kinds), 3, *kept.shape[3:])
        for (k, m), place in self.places.items():
            np.multiply(metric[k][:, None], metric[m], out=kept[place])

    def _integrated(self, kept: Array, first: Array, second: list[Array], third: list[Part]) -> Array:
        """Integrate what is kept along one direction after the other, with the factors of each."""
        *_, across, along = kept.shape
        kept, rows = kept.reshape(*kept.shape[:4], -1), 9 * first.shape[2]
        sums = np.empty((3, 3, first.shape[2], len(self.kinds) ** 2, across * along))
        for place, (k, m) in enumerate(chain(*self.groups)):
            metric = kept[self.places[min(k, m), max(k, m)]]
            factor = first[int(self.kinds[k] == 0), int(self.kinds[m] == 0)]
            np.matmul(factor, metric if k <= m else metric.swapaxes(0, 1), out=sums[:, :, :, place])
        sums = sums.reshape(rows, -1, across, along)
        lines = np.empty((rows, len(second[0]), len(second), along))
        ends = np.cumsum([len(group) for group in self.groups])
        for place, (factor, group) in enumerate(zip(second, np.split(sums, ends[:-1], axis=1), strict=True)):
            np.matmul(factor, group.reshape(rows, -1, along), out=lines[:, :, place])
        found = np.empty((rows * len(second[0]), third[-1].pairs.stop))
        for part in third:
            np.matmul(lines[..., part.points].reshape(len(found), -1), part.factor, out=found[:, part.pairs])
        return found.reshape(3, 3, first.shape[2], len(second[0]), -1)

    def _second_factors(self, tile: Tile) -> list[Array]:
        """For each group, (k, q) from the points of all its derivatives."""
        slope = [int(kind == 1) for kind in self.kinds]
        return [np.concatenate([tile.products[slope[k], slope[m]] for k, m in group], axis=1) for group in self.groups]

    def _third_factors(self, tile: Tile) -> list[Part]:
        """Cut a tile into parts."""
        return [
            Part(
                _within(part.points, tile.points),
                _within(part.pairs, tile.pairs),
                np.moveaxis(part.products, 2, 3).reshape(-1, len(part.rows)),
            )
            for part in self.directions[2].tiles
            if tile.pairs.start <= part.pairs.start < tile.pairs.stop
        ]


def _within(part: slice, whole: slice) -> slice:
    """A slice counted from the start of another."""
    return slice(part.start - whole.start, part.stop - whole.start)
