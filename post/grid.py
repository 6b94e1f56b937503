"""Sample points: a tensor grid in every patch, and the cells between them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geom2iga.bspline import Array, Indices, breaks, find_spans, sharp_breaks
from geom2iga.model import Model
from geom2iga.patch import Face, Patch
from solve.bricks import Brick, Piece, line
from solve.rules import Rule

LONG = 32  # points of a brick in each direction: small enough for a processor's cache
SLAB = 500_000  # points of a slab, which is held in memory

USUAL = 4  # points per span and direction
FEWEST = 2
MANY = 4_000_000  # points of all bodies, beyond which fewer per span will do


class Line(NamedTuple):
    """Sample points of one direction."""

    rule: Rule  # where they are, span by span
    spans: Indices  # (q,) knot index of the span that each belongs to
    starts: Indices  # (c,) at which of them a cell begins; it ends at the next
    knots: Indices  # (s + 1,) which of them lie on the breaks


@dataclass(frozen=True, eq=False)
class Grid:
    """Sample points of a patch, the last direction running fastest.

    Parameters
    ----------
    lines : one Line per direction
        On a face of a volume, one of three has a single point.
    """

    lines: tuple[Line, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of points in each direction."""
        return tuple(len(line.rule.points) for line in self.lines)

    @property
    def xi(self) -> Array:
        """Parametric points (q, d)."""
        return _crossed([line.rule.points for line in self.lines])

    @property
    def spans(self) -> Indices:
        """The span (q, d) that each point belongs to, so that values at its ends are those from inside."""
        return _crossed([line.spans for line in self.lines])

    @property
    def cells(self) -> Indices:
        """Quadrilaterals (c, 4) or hexahedra (c, 8) between the points, in VTK's sequence of corners."""
        return self.cells_from(self.lines[0].starts)

    def cells_from(self, first: Indices) -> Indices:
        """The cells that begin at some points (c,) of the first direction."""
        strides = [prod(self.shape[d + 1 :]) for d in range(len(self.shape))]
        wide = [stride for stride, count in zip(strides, self.shape, strict=True) if count > 1]
        begins = [first, *(line.starts for line in self.lines[1:])]
        at = _crossed([start * stride for start, stride in zip(begins, strides, strict=True)]).sum(axis=1)
        square = np.array([0, wide[0], wide[0] + wide[1], wide[1]])
        return at[:, None] + (square if len(wide) == 2 else np.concatenate([square, square + wide[2]]))


class Slab(NamedTuple):
    """Points of a grid between two planes, the whole of its other directions."""

    bricks: list[tuple[Brick, tuple[slice, slice, slice]]]  # and where the points of each are in the slab
    shape: tuple[int, int, int]
    cells: Indices  # those that begin in the slab, in the numbering of the whole grid


def sample_line(knots: Array, degree: int, samples: int, joined: bool) -> Line:
    """Place sample points in every span, ends included.

    Parameters
    ----------
    samples : int
        In each span.
    joined : bool
        Whether two spans share the point between them where derivatives of splines are continuous.
    """
    at = breaks(knots)
    torn = np.isin(at[1:], sharp_breaks(knots, degree)) | (not joined)
    counts = samples - 1 + torn
    owner = np.repeat(np.arange(len(counts)), counts)
    first = np.cumsum(counts) - counts
    fractions = np.linspace(0, 1, samples)[np.arange(len(owner)) - first[owner]]
    points = at[owner] * (1 - fractions) + at[owner + 1] * fractions
    last = (np.cumsum(counts) - 1)[torn]
    starts = np.delete(np.arange(len(owner)), last)
    return Line(_rule(points, counts), find_spans(knots, degree, at[:-1])[owner], starts, np.append(first, last[-1]))


def end_line(knots: Array, degree: int, side: int) -> Line:
    """The single point at the end of a direction."""
    at, end = breaks(knots), np.array([knots[-side]])
    counts = np.zeros(len(at) - 1, dtype=int)
    counts[-side] = 1
    return Line(_rule(end, counts), find_spans(knots, degree, end), np.array([0]), np.array([0]))


def sample_grid(patch: Patch, samples: int, joined: bool = False) -> Grid:
    """Place sample points in every span of a patch; see `sample_line`."""
    directions = zip(patch.knots, patch.degrees, strict=True)
    return Grid(tuple(sample_line(knots, degree, samples, joined) for knots, degree in directions))


def face_grid(patch: Patch, face: Face, samples: int) -> Grid:
    """Place sample points on a face of a volume."""
    lines = list(sample_grid(patch, samples, joined=True).lines)
    lines[face.axis] = end_line(patch.knots[face.axis], patch.degrees[face.axis], face.side)
    return Grid(tuple(lines))


def find_slabs(patch: Patch, grid: Grid) -> Iterator[Slab]:
    """Cut the grid of a volume into slabs, and these into bricks."""
    each = prod(grid.shape[1:])
    first, second, third = (
        _pieces(knots, degree, along.rule, most)
        for knots, degree, along, most in zip(
            patch.knots, patch.degrees, grid.lines, (min(LONG, SLAB // each), LONG, LONG), strict=True
        )
    )
    for piece, place in first:
        shape = (len(piece.points), grid.shape[1], grid.shape[2])
        bricks = [
            (Brick((piece, one, other)), (slice(None), here, there))
            for (one, here), (other, there) in product(second, third)
        ]
        begins = grid.lines[0].starts
        yield Slab(bricks, shape, grid.cells_from(begins[(begins >= place.start) & (begins < place.stop)]))


def _pieces(knots: Array, degree: int, rule: Rule, most: int) -> list[tuple[Piece, slice]]:
    """Cut one direction into pieces of whole spans and about `most` points, and say which points."""
    spans = np.flatnonzero(rule.counts)
    parts = np.array_split(spans, min(len(spans), -(-len(rule.points) // max(1, most))))
    pieces = [line(knots, degree, rule, part) for part in parts]
    stops = np.cumsum([len(piece.points) for piece in pieces]).tolist()
    return [(piece, slice(stop - len(piece.points), stop)) for piece, stop in zip(pieces, stops, strict=True)]


def count_points(patch: Patch, samples: int) -> tuple[int, int]:
    """Numbers of points and cells of a patch."""
    lines = sample_grid(patch, samples, joined=True).lines
    return prod(len(line.rule.points) for line in lines), prod(len(line.starts) for line in lines)


def choose_samples(model: Model) -> int:
    """Choose how many points per span and direction: fewer than usual where that makes very many."""
    for samples in range(USUAL, FEWEST, -1):
        if sum(count_points(patch, samples)[0] for patch in model.patches.values()) <= MANY:
            return samples
    return FEWEST


def _rule(points: Array, counts: Indices) -> Rule:
    """Points that nothing is summed up over."""
    return Rule(points, np.zeros(len(points)), counts)


def _crossed(each: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """All combinations (q, d) of numbers of each direction, the last running fastest."""
    return np.stack(np.meshgrid(*each, indexing="ij"), axis=-1).reshape(-1, len(each))
