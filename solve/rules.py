"""Quadrature rules of one direction: Gauss points in every span, and half as many for smooth splines."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from math import ceil
from typing import NamedTuple

import numpy as np

from geom2iga.bspline import Array, Indices, breaks
from solve.space import Space, is_straight

UNEVEN = 2.2  # ratio of neighbouring weights from which on points for smooth splines miss too much between them
EXACT = 4  # degree up to which the points for smooth splines integrate affine maps exactly

Rules = tuple["Rule", "Rule", "Rule"]


class Rule(NamedTuple):
    """Points of one direction, span by span."""

    points: Array  # (q,)
    weights: Array  # (q,) parametric
    counts: Indices  # (s,) points in each span

    def chosen(self, spans: Indices) -> "Rule":
        """The points of neighbouring spans (k,)."""
        start, stop = self.counts[: spans[0]].sum(), self.counts[: spans[-1] + 1].sum()
        return Rule(self.points[start:stop], self.weights[start:stop], self.counts[spans])


def gauss_rule(knots: Array, count: int) -> Rule:
    """Place Gauss-Legendre points in every span."""
    at = breaks(knots)
    nodes, weights = np.polynomial.legendre.leggauss(count)
    half = np.diff(at)[:, None] / 2
    return Rule((at[:-1, None] + half * (1 + nodes)).ravel(), (half * weights).ravel(), np.full(len(half), count))


def smooth_rule(knots: Array, degree: int) -> Rule:
    """Place k points in every span, one more in the last one before a kink.

    For smooth splines of degree 1, 2, 3 ... k is 1, 2, 3, 4, 4, 5, 5 ... They are exact for continuous splines of
    degree 2 k; no rule has fewer points for these (Micchelli & Pinkus 1977). Such are products of splines of degree up
    to 4 and their derivatives; those of higher degree, as smooth as they are, come near to them. Hiemstra, Calabrò,
    Schillinger & Hughes 2017 find the like by Newton's method.

    On a span -1 ... 1 the k points integrate f exactly but for α f(-1) + β f(1). With Legendre polynomials the
    determinant of the moments vanishes for β = (1 - a α) / (a - (a² - b²) α), where a = (k + 1)² / 2, b = (k + 1) / 2.
    What is too much at the end of one span is too little at the start of the next, until the last ends the chain.
    """
    at, repeated = np.unique(knots, return_counts=True)
    half, kinked = np.diff(at) / 2, repeated[1:] >= degree
    inner = np.where(kinked, 0, repeated[1:])  # functions that start inside
    chains = np.cumsum(np.append(0, kinked[:-1]))
    least = max((degree + np.bincount(chains, inner)) / np.bincount(chains))  # so that points are as many as functions
    count = min(degree, max((degree + 4) // 2, ceil(least)))
    points, weights, missing = [], [], 0.0
    sum_, alternating = (count + 1) ** 2 / 2, (count + 1) / 2
    for start, h, last in zip(at[:-1], half, kinked, strict=True):
        lacks = missing / h
        surplus = 0.0 if last else (1 - sum_ * lacks) / (sum_ - (sum_**2 - alternating**2) * lacks)
        nodes, shares = _gauss(lacks, surplus, count + last)
        points.append(start + h * (1 + nodes))
        weights.append(h * shares)
        missing = -surplus * h
    return Rule(np.concatenate(points), np.concatenate(weights), count + kinked.astype(int))


@lru_cache(1024)
def _gauss(start: float, end: float, count: int) -> tuple[Array, Array]:
    """Gauss points in -1 ... 1 and their weights for the integral of f minus start f(-1) minus end f(1)."""
    powers = np.arange(2 * count)
    moments = np.where(powers % 2 == 0, 2 / (powers + 1), 0.0) - start * (-1.0) ** powers - end
    hankel = moments[np.add.outer(powers[:count], powers[:count])]
    nodes = np.sort(np.polynomial.polynomial.polyroots(np.append(np.linalg.solve(hankel, -moments[count:]), 1.0)).real)
    return nodes, np.linalg.solve(np.vander(nodes, increasing=True).T, moments[:count])


def full_rules(space: Space) -> dict[str, Rules]:
    """Gauss points that integrate as accurately as assembly does."""
    return {
        name: _each(gauss_rule, patch.knots, space.point_counts[name]) for name, patch in space.model.patches.items()
    }


def smooth_rules(space: Space) -> dict[str, Rules]:
    """Points for smooth splines; Gauss points along directions in which weights differ too much for these."""
    full, rules = full_rules(space), {}
    for name, patch in space.model.patches.items():
        smooth = _each(smooth_rule, patch.knots, patch.degrees)
        slopes = (np.abs(np.diff(np.log(patch.weights), axis=d)).max() for d in range(patch.directions))
        uneven = [slope > np.log(UNEVEN) for slope in slopes]
        first, second, third = (f if u else s for s, f, u in zip(smooth, full[name], uneven, strict=True))
        rules[name] = first, second, third
    return rules


def exact_rules(space: Space) -> dict[str, Rules]:
    """As accurate as `full_rules`, with fewer points where the map is affine."""
    full, smooth = full_rules(space), smooth_rules(space)
    return {
        name: smooth[name] if max(patch.degrees) <= EXACT and is_straight(patch) else full[name]
        for name, patch in space.model.patches.items()
    }


def _each(rule: Callable[[Array, int], Rule], knots: Sequence[Array], numbers: Sequence[int]) -> Rules:
    """Make the rules of three directions."""
    first, second, third = map(rule, knots, numbers)
    return first, second, third
