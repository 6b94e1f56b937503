"""Where the entries of a matrix between splines stand, in closed form.

Two tensor-product splines share a span where they do so in each direction: the columns of a row are a box in the grid
of control points, their number a product of three, their places known before anything is integrated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import bsr_array

from geom2iga.bspline import Array, Indices, Mask, breaks, find_spans
from geom2iga.patch import Patch
from solve.space import Space


@dataclass(frozen=True, eq=False)
class Band:
    """The pairs of functions of one direction that share a span: a with lowest[a] ... lowest[a] + width[a] - 1.

    Parameters
    ----------
    first : (s,)
        First function that is nonzero on each span.
    spans : (2, n)
        First and last span on which each function is nonzero.
    lowest, width : (n,)
    """

    first: Indices
    spans: Indices
    lowest: Indices
    width: Indices

    @property
    def size(self) -> int:
        """Number of functions."""
        return len(self.width)

    @cached_property
    def starts(self) -> Indices:
        """Where the pairs of each function begin, and the last ones end (n + 1,)."""
        return np.append(0, np.cumsum(self.width))

    def pairs(self, start: int, stop: int) -> tuple[Indices, Indices]:
        """All pairs (a, b) of the functions start ... stop - 1 with any others, row by row."""
        rows = np.arange(start, stop)
        return np.repeat(rows, self.width[rows]), runs(self.lowest[rows], self.width[rows])


def find_band(knots: Array, degree: int) -> Band:
    """Find the pairs of B-splines that share a span."""
    first = find_spans(knots, degree, breaks(knots)[:-1]) - degree
    functions = np.arange(len(knots) - degree - 1)
    spans = np.stack([np.searchsorted(first, functions - degree), np.searchsorted(first, functions, "right") - 1])
    lowest = first[spans[0]]
    return Band(first, spans, lowest, first[spans[1]] + degree + 1 - lowest)


def runs(starts: Indices, lengths: Indices) -> Indices:
    """Chain the ranges start ... start + length - 1.

    >>> runs(np.array([5, 0]), np.array([2, 3])).tolist()
    [5, 6, 0, 1, 2]
    """
    ends = np.cumsum(lengths)
    return np.repeat(starts - (ends - lengths), lengths) + np.arange(ends[-1] if len(ends) else 0)


def box_columns(patch: Patch) -> tuple[Indices, Indices]:
    """Number of functions that share a span with each function of a patch (n,), and these one after the other."""
    counts, columns = np.ones(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
    for knots, degree in zip(patch.knots[::-1], patch.degrees[::-1], strict=True):
        counts, columns = _crossed(find_band(knots, degree), counts, columns)
    return counts, columns


def _crossed(band: Band, counts: Indices, columns: Indices) -> tuple[Indices, Indices]:
    """Rows of a tensor product with one more direction, which runs slowest."""
    inner, starts = len(counts), np.cumsum(counts) - counts
    repeated = {}
    for width in np.unique(band.width):
        lengths = np.repeat(counts, width)
        shifts = np.tile(inner * np.arange(width), inner)
        repeated[width] = columns[runs(np.repeat(starts, width), lengths)] + np.repeat(shifts, lengths)
    boxes = [repeated[width] + inner * lowest for width, lowest in zip(band.width, band.lowest, strict=True)]
    return np.outer(band.width, counts).ravel(), np.concatenate(boxes)


class Rows(NamedTuple):
    """Rows of control points, each a run of columns; both as global control-point numbers."""

    points: Indices  # (r,)
    counts: Indices  # (r,) columns of each
    columns: Indices

    def chosen(self, mask: Mask) -> "Rows":
        """Some of the rows (r,)."""
        if mask.all():
            return self
        starts, counts = np.cumsum(self.counts) - self.counts, self.counts[mask]
        return Rows(self.points[mask], counts, self.columns[runs(starts[mask], counts)])

    @property
    def increasing(self) -> Mask:
        """Whether the columns of each row (r,) increase."""
        ends = np.cumsum(self.counts)
        falls = np.flatnonzero(np.diff(self.columns) <= 0) + 1
        row = np.searchsorted(ends, falls, "right")
        found = np.ones(len(ends), dtype=bool)
        found[row[falls > (ends - self.counts)[row]]] = False
        return found


class Merger(NamedTuple):
    """Rows of a patch that cannot be written where they belong: others add to them, or their columns are out of line.

    They are written one after the other beyond the values of the matrix and added from there.
    """

    points: Indices  # (r,) global control-point numbers
    counts: Indices  # (r,) columns of each, as control points
    blocks: Indices  # where these blocks of 3 x 3 stand in the matrix, counted row by row


@dataclass(frozen=True, eq=False)
class Pattern:
    """Compressed rows of a matrix of 3 x 3 blocks, and where the rows of each patch stand among its values.

    Parameters
    ----------
    indptr, indices :
        As those of a csr_array; columns increase along each row.
    starts : patch name to (n,)
        Where the three rows of each control point begin; those to be merged, beyond the values of the matrix.
    mergers : patch name to Merger
    """

    indptr: Indices
    indices: Indices
    starts: Mapping[str, Indices]
    mergers: Mapping[str, Merger]

    def allocated(self) -> Array:
        """Zeros for all values and, beyond them, for the rows to be merged of any one patch."""
        return np.zeros(len(self.indices) + max(9 * len(merger.blocks) for merger in self.mergers.values()))

    def merge(self, name: str, values: Array) -> None:
        """Add the rows of a patch that stand beyond the values of the matrix."""
        points, counts, blocks = self.mergers[name]
        first = self.indptr[3 * points].astype(np.int64)
        length = self.indptr[3 * points + 1] - first
        source = 3 * np.arange(len(blocks)) + np.repeat(6 * (np.cumsum(counts) - counts), counts) + len(self.indices)
        target = 3 * blocks + np.repeat(first // 3 * 2, counts)
        for _ in range(3):
            for j in range(3):
                np.add.at(values, target + j, values[source + j])
            source += np.repeat(3 * counts, counts)
            target += np.repeat(length, counts)


def find_pattern(space: Space) -> Pattern:
    """Find the pattern of matrices of three components per control point on a space."""
    uses = np.bincount(np.concatenate(list(space.numbers.values())), minlength=space.size)
    direct, merged, written = {}, {}, {}
    boxes: dict[tuple[bytes, ...], tuple[Indices, Indices]] = {}
    for name, patch in space.model.patches.items():
        key = (bytes(patch.degrees), *(knots.tobytes() for knots in patch.knots))
        counts, columns = boxes[key] if key in boxes else boxes.setdefault(key, box_columns(patch))
        rows = Rows(space.numbers[name], counts, space.numbers[name][columns])
        written[name] = (uses[rows.points] == 1) & rows.increasing
        direct[name], merged[name] = rows.chosen(written[name]), rows.chosen(~written[name])
    union, places = _united(list(merged.values()), space.size)
    begins, columns = _joined([*direct.values(), union], space.size)
    indptr, indices = _in_components(begins, columns)
    blocks = runs(begins[union.points], union.counts)
    starts, mergers = {}, {}
    for (name, rows), place in zip(merged.items(), places, strict=True):
        mergers[name] = Merger(rows.points, rows.counts, blocks[place])
        starts[name] = 9 * begins[space.numbers[name]]
        starts[name][~written[name]] = len(indices) + 9 * (np.cumsum(rows.counts) - rows.counts)
    return Pattern(indptr, indices, starts, mergers)


def _united(parts: Sequence[Rows], size: int) -> tuple[Rows, list[Indices]]:
    """Unite rows of several patches, their columns in line; and the number of each column of theirs in the union."""
    keys = [np.repeat(part.points, part.counts) * size + part.columns for part in parts]
    found, numbers = np.unique(np.concatenate(keys), return_inverse=True)
    points, counts = np.unique(found // size, return_counts=True)
    return Rows(points, counts, found % size), np.split(numbers, np.cumsum([len(key) for key in keys])[:-1])


def _joined(parts: Sequence[Rows], size: int) -> tuple[Indices, Indices]:
    """Where each row (size,) begins, and the columns of all rows, from rows that stand in one part each."""
    counts = np.zeros(size, dtype=np.int64)
    for part in parts:
        counts[part.points] = part.counts
    starts = np.cumsum(counts) - counts
    columns = np.empty(counts.sum(), dtype=np.int32)
    for part in parts:
        columns[runs(starts[part.points], part.counts)] = part.columns
    return starts, columns


def _in_components(starts: Indices, columns: Indices) -> tuple[Indices, Indices]:
    """Compressed rows of blocks of 3 x 3 as those of single numbers."""
    blocks = np.zeros((len(columns), 3, 3), dtype=np.int8)  # only their places are wanted
    ends = np.append(starts, len(columns)).astype(np.int32)
    matrix = bsr_array((blocks, columns, ends), shape=(3 * len(starts),) * 2).tocsr()
    return matrix.indptr, matrix.indices
