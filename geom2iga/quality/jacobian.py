"""Proof that the Jacobian of a patch is positive, or where it is not."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import inf, nan, prod
from typing import Literal, NamedTuple

import numpy as np

from geom2iga.bspline import Array
from geom2iga.patch import CHUNK, Patch, chunks, evaluate
from geom2iga.quality import bernstein
from geom2iga.quality.volume import enclosed_volume, middle

Status = Literal["proven", "not proven", "folded", "left-handed", "degenerate"]

UNIT_ROUNDOFF = 2.0**-53
ZERO = 1e-12  # of the mean Jacobian: what 15 digits in a CAD file leave of a collapsed edge
BUDGET = 10_000_000  # Bernstein coefficients that halving may make: some tenths of a second
DEEPEST = 60  # halvings of a box, in all three directions together


@dataclass(frozen=True)
class Jacobian:
    """What is known of det J = det(dx/dxi) over a whole patch.

    Parameters
    ----------
    status : str
        "proven": positive everywhere. "not proven": positive wherever sampled, but the cap came first. "folded":
        of both signs. "left-handed": negative wherever sampled. "degenerate": zero somewhere, as at a collapsed edge.
    sampled_minimum : float
        Smallest sample [length³, per unit of xi].
    xi, x : (3,)
        Where that is, in the patch and in space [length].
    bound : float or None
        Where proven, det J is nowhere smaller.
    mean : float
        Volume by the divergence theorem over parametric volume: the measure of what is small.
    """

    status: Status
    sampled_minimum: float
    xi: tuple[float, float, float]
    x: tuple[float, float, float]
    bound: float | None
    mean: float

    @property
    def relative_minimum(self) -> float:
        """Smallest sample over the mean; nan for a patch without volume."""
        return self.sampled_minimum / abs(self.mean) if self.mean else nan

    @property
    def relative_bound(self) -> float | None:
        """Proven bound over the mean."""
        return None if self.bound is None else self.bound / abs(self.mean)

    @property
    def message(self) -> str:
        """Say it in one clause."""
        where = f"xi = {_listed(self.xi)}, x = {_listed(self.x)}"
        share = f"{self.relative_minimum:.3g} of its mean"
        if self.bound is not None:
            return f"det J >= {self.bound:.3g} proven, {self.relative_bound:.3g} of its mean"
        if self.status == "not proven":
            return f"positivity not proven: sampled minimum det J = {self.sampled_minimum:.3g}, {share}, at {where}"
        if self.status == "degenerate":
            return f"degenerate: det J = 0 at {where}"
        advice = "; reverse one direction" if self.status == "left-handed" else ""
        return f"{self.status}: det J = {self.sampled_minimum:.3g}, {share}, near {where}{advice}"


def prove_jacobian(patch: Patch, sharpness: float = 0.5, budget: int = BUDGET) -> Jacobian:
    """Prove that the Jacobian of a volume is positive, or find where it is not.

    With P = (w x, w) of four homogeneous coordinates, det[P_u P_v P_w P] = w⁴ det J is a polynomial on each span, as
    is w⁴; where c ≤ D_i / V_i for their Bernstein coefficients D_i, V_i > 0, every coefficient of w⁴ (det J - c) is
    positive or zero, and det J ≥ c. Spans on which that is not sharp enough are halved, and halved again.
    A bound of all rounding is taken off D_i first (Higham 2002, ch. 3).    Gain, Elber & Kim; Johnen et al. 2013

    Parameters
    ----------
    sharpness : float
        Below 1: the bound is to reach this fraction of the smallest sample, if the budget allows.
    budget : int
        Number of Bernstein coefficients that halving may make before it gives up.
    """
    mean = enclosed_volume(patch) / prod(float(at[-1] - at[0]) for at in patch.breaks)
    found = Found(zero=ZERO * abs(mean))
    for boxes in _boxes_of(patch):
        found = _searched(boxes, found, sharpness, budget)
    status: Status = "proven" if found.bound > 0 else "not proven"
    if found.minimum < -found.zero:
        status = "left-handed" if found.maximum <= found.zero else "folded"
    elif found.minimum <= found.zero:
        status = "degenerate"
    x = evaluate(patch, found.xi[None])[0][0]
    bound = found.bound if status == "proven" else None
    return Jacobian(status, found.minimum, _three(found.xi), _three(x), bound, mean)


class Boxes(NamedTuple):
    """Boxes in parametric space, with det J there as the ratio of two polynomials in Bernstein form."""

    numerator: Array  # (b, n_1, n_2, n_3) w⁴ det J
    denominator: Array  # (b, n_1, n_2, n_3) w⁴
    rounding: Array  # (b,) how far the numerator's coefficients may be off
    start: Array  # (b, 3) lower corner
    size: Array  # (b, 3) edges

    @property
    def bounds(self) -> Array:
        """Lower bounds of det J, (b,)."""
        lowest = (self.numerator - self.rounding[:, None, None, None]) / self.denominator
        return lowest.min(axis=(1, 2, 3))


class Found(NamedTuple):
    """What is known so far."""

    minimum: float = inf  # smallest sample
    maximum: float = -inf  # largest sample
    xi: Array = np.zeros(3)  # of the smallest
    bound: float = inf
    zero: float = 0.0  # what is as good as zero: at least the rounding of every sample
    spent: int = 0  # coefficients made by halving


def _searched(boxes: Boxes, found: Found, sharpness: float, budget: int) -> Found:
    """Halve boxes until each has a bound near the smallest sample, or a sample is negative, or the cap is met."""
    found = _sampled(boxes, found)
    for _ in range(DEEPEST):
        bounds = boxes.bounds
        blunt = bounds < (sharpness * found.minimum if found.minimum > found.zero else -found.zero)
        cost = 4 * int(blunt.sum()) * boxes.numerator[0].size
        if found.minimum < -found.zero or not blunt.any() or found.spent + cost > budget:
            break
        found = found._replace(bound=min(found.bound, bounds[~blunt].min(initial=inf)), spent=found.spent + cost)
        boxes = _halved(Boxes(*(field[blunt] for field in boxes)))
        found = _at_corners(boxes, found)
    return found._replace(bound=min(found.bound, float(boxes.bounds.min())))


def _sampled(boxes: Boxes, found: Found) -> Found:
    """Sample boxes on a grid of as many points as there are coefficients."""
    grids = [np.linspace(0, 1, count) for count in boxes.numerator.shape[1:]]
    numerator, denominator = boxes.numerator, boxes.denominator
    for axis, grid in enumerate(grids, 1):
        matrix = bernstein.values(len(grid) - 1, grid)[0]
        numerator, denominator = (bernstein.along(matrix, each, axis) for each in (numerator, denominator))
    return _noted(boxes._replace(numerator=numerator, denominator=denominator), found)


def _at_corners(boxes: Boxes, found: Found) -> Found:
    """Sample boxes at their corners, where the coefficients are the values."""
    corners = tuple(slice(None, None, count - 1) for count in boxes.numerator.shape[1:])
    held = {name: getattr(boxes, name)[(slice(None), *corners)] for name in ("numerator", "denominator")}
    return _noted(boxes._replace(**held), found)


def _noted(samples: Boxes, found: Found) -> Found:
    """Take note of uniform grids of samples, one per box."""
    ratio = samples.numerator / samples.denominator
    rounding = float((samples.rounding / samples.denominator.min(axis=(1, 2, 3))).max())
    found = found._replace(maximum=max(found.maximum, float(ratio.max())), zero=max(found.zero, rounding))
    if ratio.min() >= found.minimum:
        return found
    box, *place = np.unravel_index(np.argmin(ratio), ratio.shape)
    fraction = np.array(place) / (np.array(ratio.shape[1:]) - 1)
    return found._replace(minimum=float(ratio.min()), xi=samples.start[box] + fraction * samples.size[box])


def _halved(boxes: Boxes) -> Boxes:
    """Halve each box along the direction in which the coefficients are furthest from the values."""
    gap = boxes.numerator - boxes.bounds[:, None, None, None] * boxes.denominator
    bends = [np.abs(np.diff(gap, 2, axis=axis)).max(axis=(1, 2, 3)) for axis in (1, 2, 3)]
    direction = np.argmax(bends, axis=0)
    parts = [_halved_along(Boxes(*(field[direction == d] for field in boxes)), d) for d in range(3)]
    return Boxes(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def _halved_along(boxes: Boxes, direction: int) -> Boxes:
    """Halve boxes along one direction."""
    count = boxes.numerator.shape[1 + direction]
    halves = bernstein.halves(count - 1)
    numerator, denominator = (
        np.concatenate([bernstein.along(half, each, 1 + direction) for half in halves])
        for each in (boxes.numerator, boxes.denominator)
    )
    # both polynomials are means of `count` terms
    more = 2 * (count + 1) * UNIT_ROUNDOFF * np.abs(boxes.numerator).max(axis=(1, 2, 3), initial=0)
    size = boxes.size * np.where(np.arange(3) == direction, 0.5, 1.0)
    start = np.concatenate([boxes.start, boxes.start + (boxes.size - size)])
    return Boxes(numerator, denominator, np.tile(boxes.rounding + more, 2), start, np.tile(size, (2, 1)))


def _boxes_of(patch: Patch) -> Iterator[Boxes]:
    """Yield the spans of a patch as boxes, some at a time."""
    polynomial = bool(np.ptp(patch.weights) <= 4 * UNIT_ROUNDOFF * patch.weights.max())  # moves points by twice that
    centre, length = middle(patch)
    points = (patch.control_points - centre) / length  # det J does not feel it, and rounding becomes small
    weights = np.ones(patch.shape) if polynomial else patch.weights / patch.weights.max()
    unit = replace(patch, control_points=points, weights=weights)
    pieces = bernstein.bezier(unit)
    steps = 16 + sum(4 * degree + 2 for degree, at in zip(patch.degrees, patch.breaks, strict=True) if len(at) > 2)
    count = prod(len(at) - 1 for at in patch.breaks)
    for part in chunks(count, max(1, CHUNK // (16 * prod(2 * degree + 1 for degree in patch.degrees)))):
        coefficients, start, size = bernstein.elements(pieces, part)
        columns = [bernstein.slope(coefficients, axis) for axis in (2, 3, 4)] + [coefficients]
        if polynomial:
            columns = [column[:, :3] for column in columns[:3]]
        scale = length**3 / size.prod(axis=1)
        numerator, denominator = _ratio(columns)
        rounding = scale * _rounding(columns, steps * UNIT_ROUNDOFF)
        yield Boxes(numerator * scale[:, None, None, None], denominator, rounding, start, size)


def _ratio(columns: list[Array]) -> tuple[Array, Array]:
    """Bernstein coefficients (e, n_1, n_2, n_3) of w⁴ det J and of w⁴, of degrees 4 p, or 3 p - 1 where w = 1.

    Parameters
    ----------
    columns : (e, k, n_1, n_2, n_3) each
        P_u, P_v, P_w, P for k = 4; x_u, x_v, x_w for k = 3.
    """
    columns = [bernstein.scaled(column, 3) for column in columns]
    rows = columns[0].shape[1]
    # Laplace's expansion along the first two columns: complements of pairs run backwards
    pairs = list(combinations(range(rows), 2))
    signs = np.array([(-1.0) ** (1 + i + j) for i, j in pairs])[:, None, None, None]
    rest = columns[2] if rows == 3 else _minors(columns[2], columns[3], pairs)
    numerator = bernstein.product(_minors(columns[0], columns[1], pairs) * signs, rest[:, ::-1])
    if rows == 3:
        return bernstein.unscaled(numerator, 3), np.ones(numerator.shape)
    weight = columns[3][:, 3:]
    square = bernstein.product(weight, weight)[:, None]
    raised = bernstein.product(numerator[:, None], np.ones((len(numerator), 1, 2, 2, 2)))  # from 4 p - 1
    return bernstein.unscaled(raised, 3), bernstein.unscaled(bernstein.product(square, square), 3)


def _minors(first: Array, second: Array, pairs: Sequence[tuple[int, int]]) -> Array:
    """Minors (e, pairs, ...) of two columns of scaled polynomials, for pairs of rows."""
    i, j = np.array(pairs).T
    return bernstein.product(
        np.stack([first[:, i], -first[:, j]], axis=2), np.stack([second[:, j], second[:, i]], axis=2)
    )


def _rounding(columns: list[Array], error: float) -> Array:
    """Bound (e,) the rounding in `_ratio`, that of the denominator counted as if it were in the numerator.

    A coefficient is a mean, of positive weights, of products of one entry from each column; each is at most the
    product of the columns' sizes. Its rounding is that times the number of terms summed, and what the entries bring.

    Parameters
    ----------
    error : float
        How far the control points, of size one, may be off.
    """
    rows = columns[0].shape[1]
    degrees = [max(column.shape[axis] for column in columns) - 1 for axis in (2, 3, 4)]
    if rows == 3:
        terms = 32 + 5 * prod(degree + 1 for degree in degrees)
    else:
        terms = 64 + 8 * prod(2 * degree + 1 for degree in degrees)
    sizes = np.array([np.abs(column).max(axis=(2, 3, 4)).sum(axis=1) for column in columns])
    brought = np.array([2 * rows * degree * error for degree in [*degrees, 1][:rows]])
    others = np.array([np.delete(sizes, k, axis=0).prod(axis=0) for k in range(rows)])
    return (terms * UNIT_ROUNDOFF + 4 * error) * sizes.prod(axis=0) + brought @ others  # 4: that of w⁴


def _three(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def _listed(values: Sequence[float]) -> str:
    return f"({', '.join(f'{value:.4g}' for value in values)})"
