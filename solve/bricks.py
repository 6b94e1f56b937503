"""Sum factorisation on bricks: runs of whole spans of a volume, small enough for a processor's cache.

On a brick a tensor-product function is evaluated direction by direction, with one small dense matrix each
(Orszag 1980); all of them together cost a bounded number of operations per span, whatever the size of the patch.
"""

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from geom2iga.bspline import Array, Indices, basis, breaks, find_spans
from geom2iga.patch import Patch
from solve.rules import Rule, Rules

SPANS = 1331  # in a brick
THREADED = 3  # times as many where several threads share the work: they wait for the interpreter between long calls

Floats = NDArray[Any]  # of single or double precision
Empty = Callable[[tuple[int, ...], DTypeLike], Floats]


class Scratch(threading.local):
    """Memory of one thread that is used again: fresh pages cost as much as the arithmetic on them."""

    def __init__(self) -> None:
        self._buffers: list[Floats] = []
        self._taken = 0

    def restart(self) -> Empty:
        """Take back all arrays that were given out."""
        self._taken = 0
        return self._empty

    def _empty(self, shape: tuple[int, ...], precision: DTypeLike) -> Floats:
        """Give out an array, the next one of the same size as last time."""
        size = prod(shape) * np.dtype(precision).itemsize
        if self._taken == len(self._buffers):
            self._buffers.append(np.empty(0, dtype=np.uint8))
        if self._buffers[self._taken].size < size:
            self._buffers[self._taken] = np.empty(size, dtype=np.uint8)
        self._taken += 1
        return self._buffers[self._taken - 1][:size].view(precision).reshape(shape)


class Piece(NamedTuple):
    """Neighbouring spans of one direction: functions first ... first + n - 1 at q points."""

    functions: slice
    values: Floats  # (q, n)
    slopes: Floats  # (q, n)
    weights: Floats  # (q,) parametric
    points: Array  # (q,)


@dataclass(frozen=True, eq=False)
class Brick:
    """A box of spans.

    Parameters
    ----------
    pieces : three Piece
    """

    pieces: tuple[Piece, Piece, Piece]

    @cached_property
    def _third(self) -> Floats:
        """Values and slopes (2 q_3, n_3) of the last direction."""
        return np.concatenate([self.pieces[2].values, self.pieces[2].slopes])

    @property
    def functions(self) -> tuple[slice, slice, slice]:
        """Its control points in the grid of the patch."""
        first, second, third = (piece.functions for piece in self.pieces)
        return first, second, third

    @property
    def weights(self) -> Floats:
        """Parametric weights (q,) of its points, the last direction fastest."""
        first, second, third = (piece.weights for piece in self.pieces)
        return (first[:, None, None] * second[:, None] * third).ravel()

    def point(self, number: int) -> Array:
        """Parametric place (3,) of a point."""
        shape = tuple(len(piece.points) for piece in self.pieces)
        return np.array([p.points[k] for p, k in zip(self.pieces, np.unravel_index(number, shape), strict=True)])

    def gradients(self, coefficients: Floats, values: bool = False, empty: Empty = np.empty) -> Floats:
        """Differentiate splines at all points.

        Parameters
        ----------
        coefficients : (c, n_1, n_2, n_3)
        values : bool
            Evaluate them, too.
        empty : function
            Makes arrays for intermediate and final results.

        Returns
        -------
        (c, 3, q) or (c, 4, q)
            Derivatives with respect to the parameters, then the values.
        """
        (b1, d1), (b2, d2) = ((piece.values, piece.slopes) for piece in self.pieces[:2])
        count, (q1, n1), (q2, n2), (q3, n3) = len(coefficients), *(piece.values.shape for piece in self.pieces)
        rows = np.ascontiguousarray(coefficients).reshape(-1, n3)
        along = np.matmul(rows, self._third.T, out=empty((count * n1 * n2, 2 * q3), rows.dtype))
        along = along.reshape(count * n1, n2, 2 * q3)
        across = empty((count * n1, 3, q2, q3), rows.dtype)
        np.matmul(d2, along[:, :, :q3], out=across[:, 1])
        np.matmul(b2, along[:, :, q3:], out=across[:, 2])
        np.matmul(b2, along[:, :, :q3], out=across[:, 0])
        across = across.reshape(count, n1, 3, q2 * q3).transpose(0, 2, 1, 3)
        found = empty((count, 3 + values, q1, q2 * q3), rows.dtype)
        np.matmul(d1, across[:, 0], out=found[:, 0])
        np.matmul(b1, across[:, 1:], out=found[:, 1:3])
        if values:
            np.matmul(b1, across[:, 0], out=found[:, 3])
        return found.reshape(count, 3 + values, -1)

    def integrated(self, fluxes: Floats, empty: Empty = np.empty) -> Floats:
        """Transpose of `gradients`: from (c, 3 or 4, q) at the points to coefficients (c, n_1, n_2, n_3)."""
        (b1, d1), (b2, d2) = ((piece.values, piece.slopes) for piece in self.pieces[:2])
        count, (q1, n1), (q2, n2), (q3, n3) = len(fluxes), *(piece.values.shape for piece in self.pieces)
        points = fluxes.reshape(count, -1, q1, q2 * q3)
        across = empty((count, n1, 3, q2 * q3), fluxes.dtype)
        turned = across.transpose(0, 2, 1, 3)
        np.matmul(d1.T, points[:, 0], out=turned[:, 0])
        np.matmul(b1.T, points[:, 1:3], out=turned[:, 1:])
        if points.shape[1] == 4:
            turned[:, 0] += b1.T @ points[:, 3]
        across = across.reshape(count * n1, 3, q2, q3)
        along = empty((count * n1, n2, 2 * q3), fluxes.dtype)
        np.matmul(b2.T, across[:, 2], out=along[:, :, q3:])
        np.matmul(b2.T, across[:, 0], out=along[:, :, :q3])
        along[:, :, :q3] += np.matmul(d2.T, across[:, 1], out=empty((count * n1, n2, q3), fluxes.dtype))
        return (along.reshape(-1, 2 * q3) @ self._third).reshape(count, n1, n2, n3)

    def evaluated(self, coefficients: Floats) -> Floats:
        """Evaluate splines of coefficients (c, n_1, n_2, n_3) at all points: (c, q)."""
        first, second, third = (piece.values for piece in self.pieces)
        count, n1, n2, n3 = coefficients.shape
        along = (coefficients.reshape(-1, n3) @ third.T).reshape(count * n1, n2, len(third))
        across = (second @ along).reshape(count, n1, -1)
        return (first @ across).reshape(count, -1)

    def moments(self, values: Floats) -> Floats:
        """Transpose of `evaluated`: sum up functions times values (c, q) at all points, (c, n_1, n_2, n_3)."""
        first, second, third = (piece.values for piece in self.pieces)
        count, (q1, n1), (q2, n2), (q3, n3) = len(values), first.shape, second.shape, third.shape
        across = (first.T @ values.reshape(count, q1, -1)).reshape(count * n1, q2, q3)
        along = (second.T @ across).reshape(-1, q3) @ third
        return along.reshape(count, n1, n2, n3)


def find_bricks(patch: Patch, rules: Rules, precision: DTypeLike = float, spans: int = SPANS) -> Iterator[Brick]:
    """Cut a volume into bricks.

    Parameters
    ----------
    rules : three Rule
        Points of each direction.
    precision : dtype
        Of the tables.
    spans : int
        In a brick, about.
    """
    sizes = _sizes([len(at) - 1 for at in patch.breaks], spans)
    cut = [
        _pieces(knots, degree, rule, size, precision)
        for knots, degree, rule, size in zip(patch.knots, patch.degrees, rules, sizes, strict=True)
    ]
    return (Brick((first, second, third)) for first, second, third in product(*cut))


def _sizes(spans: Sequence[int], wanted: int) -> list[int]:
    """Spans of a brick in each direction: their product about that wanted, as equal as the patch allows."""
    sizes, left = [0] * len(spans), float(wanted)
    for rank, d in enumerate(np.argsort(spans)):
        sizes[d] = min(spans[d], max(1, round(left ** (1 / (len(spans) - rank)))))
        left /= sizes[d]
    return sizes


def line(knots: Array, degree: int, rule: Rule, spans: Indices | None = None, precision: DTypeLike = float) -> Piece:
    """Evaluate the functions of one direction at the points of neighbouring spans (k,), of all where left out."""
    spans = np.arange(len(rule.counts)) if spans is None else spans
    points, weights, counts = rule.chosen(spans)
    first, local = basis(knots, degree, points, 1, np.repeat(find_spans(knots, degree, breaks(knots)[spans]), counts))
    tables = np.zeros((2, len(points), first[-1] - first[0] + degree + 1))
    tables[:, np.arange(len(points))[:, None], first[:, None] - first[0] + np.arange(degree + 1)] = local
    functions = slice(int(first[0]), int(first[0]) + tables.shape[2])
    values, slopes = tables.astype(precision)
    return Piece(functions, values, slopes, weights.astype(precision), points)


def _pieces(knots: Array, degree: int, rule: Rule, size: int, precision: DTypeLike) -> list[Piece]:
    """Cut one direction into pieces of about `size` spans."""
    count = len(rule.counts)
    parts = np.array_split(np.arange(count), -(-count // size))
    return [line(knots, degree, rule, spans, precision) for spans in parts]
