"""Segments: the parts of primary spans that lie opposite one secondary span each, and quadrature on them."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from geom2iga.bspline import Array, Indices, Mask
from geom2iga.patch import basis, evaluate
from solve.contact.charts import closest_in_spans, frame_at, image_of
from solve.contact.outlines import STRAIGHT, Outlines, find_outlines
from solve.contact.polygons import (
    CHORD,
    NONE,
    Corners,
    clip,
    cone_points,
    cross,
    gauss_line,
    outline_corners,
    packed,
    quad_points,
)
from solve.contact.search import find_box_pairs, spans_of
from solve.face import Surface, area_vectors

SLIVER = 1e-13  # segments and cones below this fraction of a secondary span are rounding errors
ON_LINE = 1e-14  # a crossing this close to its knot line, in the parameter range, has been found
HALVINGS = 60
BALANCED = 1e-12  # largest error of the integrals on a segment, in units of themselves
MORE_POINTS = 12  # points per direction beyond those that are exact between planes, at most
SAMPLED = 8  # segments whose integrals are looked at


@dataclass(frozen=True, eq=False)
class Segments:
    """Segments of one pair of faces: those with four edges as they are, others as sums of cones over an edge each.

    Parameters
    ----------
    secondary, primary : Surface
    outlines : Outlines
        Whose curves bound the segments.
    owner : (k,)
        Outline of each segment.
    spans : (k, 2)
        Secondary span of each segment, as knot indices.
    quad : (k,)
        Which segments are bounded by four edges and need no cones.
    apex : (k, 2)
        Of the cones of each other segment, in the secondary's parameter plane.
    segment : (e,)
        Of each edge, in increasing sequence, around each segment.
    start, end : (e, 2)
        Ends of the edges in the secondary's parameter plane.
    low, high : (e,)
        Parameters of the outline where its curve is the edge; -1 where the edge is straight.
    """

    secondary: Surface
    primary: Surface
    outlines: Outlines
    owner: Indices
    spans: Indices
    quad: Mask
    apex: Array
    segment: Indices
    start: Array
    end: Array
    low: Array
    high: Array


class Rule(NamedTuple):
    """Quadrature points on segments."""

    segment: Indices  # (q,)
    secondary_xi: Array  # (q, 2)
    primary_xi: Array  # (q, 2)
    weights: Array  # (q,) parametric, of the secondary side
    found: Mask  # (q,) the primary point is the closest one


def find_segments(secondary: Surface, primary: Surface, reach: float | None = None) -> Segments:
    """Cut the outlines of the primary spans along the secondary's knot lines.

    The cut is found between chords of the curves, then the crossings of curve and knot line are made exact: neighbours
    share their edges, without gap or overlap. Where a chord passes a knot line on the other side than its curve does,
    the polynomials of the neighbouring span are continued over the lens between them.
    """
    outlines, spans = find_outlines(secondary, primary, reach), spans_of(secondary.patch)
    owner, span = find_box_pairs(outlines.at.min(axis=1), outlines.at.max(axis=1), spans.low, spans.high)
    pieces = clip(outline_corners(outlines.at, outlines.curved).chosen(owner), spans.low[span], spans.high[span])
    least = SLIVER * np.prod(spans.high - spans.low, axis=1)[span]
    kept = np.abs(pieces.area) > least
    owner, span, least, numbers = owner[kept], span[kept], least[kept], spans.numbers[span[kept]]
    pieces = pieces.chosen(kept)
    pieces = packed(
        pieces, pieces, np.stack([pieces.meant & (pieces.mark != CHORD), np.zeros_like(pieces.meant)], axis=2)
    )
    pieces = _exact(secondary, primary, outlines, owner, numbers, pieces)
    return Segments(secondary, primary, outlines, owner, numbers, *_edges_of(pieces, least))


def _exact(
    secondary: Surface, primary: Surface, outlines: Outlines, owner: Indices, spans: Indices, pieces: Corners
) -> Corners:
    """Move corners where a curve crosses a knot line from the chord to the curve."""
    if not outlines.curved.any():
        return pieces
    at, places = pieces.at.copy(), (pieces.arrives.copy(), pieces.leaves.copy())
    chords = outlines.at.shape[1] // 4
    for place, leaving in zip(places, (False, True), strict=True):
        number, slot = np.nonzero(pieces.meant & (pieces.mark >= 0) & (place > NONE))
        there = place[number, slot]
        low = np.clip(np.floor(there * chords) if leaving else np.ceil(there * chords) - 1, 0, 4 * chords - 1) / chords
        axis = pieces.mark[number, slot].astype(np.int64)
        guess = at[number, slot]
        line = guess[np.arange(len(guess)), axis]
        curve = _Curve(secondary, primary, outlines, owner[number], spans[number], np.floor(low).astype(np.int64))
        place[number, slot], at[number, slot] = _crossings(curve, low, low + 1 / chords, there, guess, axis, line)
    return pieces._replace(at=at, arrives=places[0], leaves=places[1])


class _Curve(NamedTuple):
    """Sides of outlines as seen by given secondary spans."""

    secondary: Surface
    primary: Surface
    outlines: Outlines
    owner: Indices  # (q,)
    spans: Indices  # (q, 2)
    side: Indices  # (q,)

    def chosen(self, which: Indices) -> "_Curve":
        """Some of them."""
        return self._replace(owner=self.owner[which], spans=self.spans[which], side=self.side[which])

    def at(self, places: Array, start: Array) -> tuple[Array, Array]:
        """Points (q, 2) at parameters (q,), and their derivatives (q, 2)."""
        xi, direction = self.outlines.primary_xi(self.owner, self.side, places)
        frame = frame_at(self.primary, xi, self.outlines.spans[self.owner])
        image = image_of(self.secondary, frame, start, self.primary.outward, self.spans)
        return image.xi, np.einsum("qij,qj->qi", image.slope, direction)


def _crossings(
    curve: _Curve, low: Array, high: Array, place: Array, xi: Array, axis: Indices, line: Array
) -> tuple[Array, Array]:
    """Find where curves cross knot lines, by Newton's method held between the ends of a chord, else by halving.

    Returns
    -------
    place : (q,)
        Parameter of the outline.
    xi : (q, 2)
    """
    place, xi, low, high = place.copy(), xi.copy(), low.copy(), high.copy()
    size = np.array([at[-1] - at[0] for at in curve.secondary.patch.breaks])[axis]
    first = curve.at(low, xi)[0][np.arange(len(axis)), axis] - line
    pending = np.arange(len(place))
    for _ in range(HALVINGS):
        own = (np.arange(len(pending)), axis[pending])
        xi[pending], slope = curve.chosen(pending).at(place[pending], xi[pending])
        height = xi[pending][own] - line[pending]
        before = (height > 0) == (first[pending] > 0)
        low[pending] = np.where(before, place[pending], low[pending])
        high[pending] = np.where(before, high[pending], place[pending])
        steep = slope[own] != 0
        step = np.divide(-height, slope[own], where=steep, out=np.full_like(height, np.inf))
        target = place[pending] + step
        halved = ~((target > low[pending]) & (target < high[pending]))
        near = np.abs(height) <= ON_LINE * size[pending]
        place[pending] = np.where(near, place[pending], np.where(halved, (low + high)[pending] / 2, target))
        pending = pending[~near]
        if not pending.size:
            break
    xi[np.arange(len(axis)), axis] = line
    return place, xi


def _edges_of(pieces: Corners, least: Array) -> tuple[Mask, Array, Indices, Array, Array, Array, Array]:
    """Which polygons are quads, apices, and the edges: their polygon, start, end, the ends' parameters on the outline.

    The apex is a corner between two straight edges, over which there is nothing to integrate, else the middle.
    """
    following, meant = pieces.following, pieces.meant
    ends = np.take_along_axis(pieces.at, following[:, :, None], axis=1)
    high = np.take_along_axis(pieces.arrives, following, axis=1)
    curved = (pieces.leaves > NONE) & (high > pieces.leaves) & meant
    slots = np.arange(pieces.at.shape[1])
    behind = np.take_along_axis(curved, np.where(slots > 0, slots - 1, pieces.counts[:, None] - 1), axis=1)
    plain = meant & ~curved & ~behind
    middle = np.sum(pieces.at, axis=1, where=meant[:, :, None]) / pieces.counts[:, None]
    corner = np.take_along_axis(pieces.at, np.argmax(plain, axis=1)[:, None, None], axis=1)[:, 0]
    apex = np.where(np.any(plain, axis=1, keepdims=True), corner, middle)
    wide = np.abs(cross(pieces.at - apex[:, None], ends - apex[:, None])) / 2 > least[:, None]
    quad = pieces.quads
    number, slot = np.nonzero(meant & (curved | wide | quad[:, None]))
    straight = ~curved[number, slot]
    low, high = (np.where(straight, NONE, values[number, slot]) for values in (pieces.leaves, high))
    return quad, apex, number, pieces.at[number, slot], ends[number, slot], low, high


def integration_points(segments: Segments, counts: Indices) -> Rule:
    """Place count² quadrature points in each segment with four edges, and in each cone of the others.

    Parameters
    ----------
    counts : (k,)
        Points per direction in each segment.
    """
    numbers = [np.flatnonzero(counts == count) for count in np.unique(counts)]
    rules = [_points_in(_chosen(segments, own), int(counts[own[0]])) for own in numbers]
    rules = [rule._replace(segment=own[rule.segment]) for rule, own in zip(rules, numbers, strict=True)]
    return Rule(*(np.concatenate(values) for values in zip(*rules, strict=True)))


def _points_in(segments: Segments, count: int) -> Rule:
    """Place count² points in each quad or cone."""
    curve, slope, weights = _edges(segments, count)
    whole = segments.quad[segments.segment]
    cone, quad = np.flatnonzero(~whole), np.flatnonzero(whole).reshape(-1, 4)
    parts = (
        cone_points(segments.apex[segments.segment[cone]], curve[cone], slope[cone], weights),
        quad_points(segments.start[quad], curve[quad], slope[quad], weights),
    )
    xi, areas = (np.concatenate(values).reshape(-1, *values[0].shape[2:]) for values in zip(*parts, strict=True))
    segment = np.repeat(np.concatenate([segments.segment[cone], segments.segment[quad[:, 0]]]), count * count)
    owner = segments.owner[segment]
    guess = segments.outlines.primary_guess(owner, xi)
    turn = -float(segments.secondary.outward * segments.primary.outward)  # the map between the planes may mirror
    if _between_planes(segments):
        return Rule(segment, xi, guess, turn * areas, np.ones(len(xi), dtype=bool))
    at = evaluate(segments.secondary.patch, xi, spans=segments.spans[segment])[0]
    feet, found = closest_in_spans(segments.primary, at, guess, segments.outlines.spans[owner])
    return Rule(segment, xi, feet, turn * areas, found)


def _edges(segments: Segments, count: int) -> tuple[Array, Array, Array]:
    """Points (e, count, 2) of edges and derivatives with respect to 0 ... 1 along each; Gauss weights (count,)."""
    t, weights = gauss_line(count)
    chord = segments.end - segments.start
    at = segments.start[:, None] + t[:, None] * chord[:, None]
    slope = np.broadcast_to(chord[:, None], at.shape).copy()
    curved = np.flatnonzero(segments.low > NONE)
    if not curved.size:
        return at, slope, weights
    owner, spans = (np.repeat(v[segments.segment[curved]], count, axis=0) for v in (segments.owner, segments.spans))
    length = (segments.high - segments.low)[curved]
    places = (segments.low[curved, None] + t * length[:, None]).ravel()
    side = np.repeat(np.ceil(segments.high[curved]).astype(np.int64) - 1, count)
    curve = _Curve(segments.secondary, segments.primary, segments.outlines, owner, spans, side)
    xi, derivative = curve.at(places, at[curved].reshape(-1, 2))
    at[curved] = xi.reshape(-1, count, 2)
    slope[curved] = derivative.reshape(-1, count, 2) * length[:, None, None]
    return at, slope, weights


def _between_planes(segments: Segments) -> bool:
    return all(side.is_affine for side in (segments.secondary, segments.primary))


def enough_points(segments: Segments) -> Indices:
    """Choose how many points each segment (k,) needs per direction.

    Where both maps are affine, secondary degree + primary degree + 1 are exact for products of basis functions, and
    about half as many where the knot lines of both sides are parallel: there the products are of that degree along
    each direction alone. Elsewhere the integrand is no polynomial, but the error falls geometrically: it is the
    smallest number, up to 12 more, for which the forces of a uniform pressure on either side change by less than 1e-12
    with two points more. Some segments are looked at, so that the cost does not grow with the mesh.
    """
    degree = sum(max(side.patch.degrees) for side in (segments.secondary, segments.primary))
    if _between_planes(segments):
        return np.where(_along_axes(segments), degree // 2 + 1, degree + 1)
    return np.full(len(segments.owner), _enough_curved(segments, degree + 1))


def _along_axes(segments: Segments) -> Mask:
    """Which segments are rectangles along the parametric directions of both sides."""
    at = segments.outlines.at
    sides = np.abs(np.roll(at, -1, axis=1) - at)
    outline = np.all(sides.min(axis=2) <= STRAIGHT * sides.max(axis=2), axis=1)
    return segments.quad & outline[segments.owner]


def _enough_curved(segments: Segments, least: int) -> int:
    """How many points the integrals on some segments need."""
    some = _sample(segments)
    forces = [_forces(some, least), _forces(some, least + 1)]
    for count in range(least, least + MORE_POINTS):
        forces.append(_forces(some, count + 2))
        if all(_error(*pair) <= BALANCED for pair in zip(forces[-3], forces[-1], strict=True)):
            return count
    return least + MORE_POINTS


def _error(found: Array, finer: Array) -> float:
    """Largest difference of forces (s, n), in units of the largest."""
    return float(np.abs(found - finer).max() / np.abs(finer).max())


def _sample(segments: Segments) -> Segments:
    """The largest segments."""
    doubled = np.abs(cross(*(at - segments.apex[segments.segment] for at in (segments.start, segments.end))))
    area = np.bincount(segments.segment, doubled, len(segments.owner))
    return _chosen(segments, np.sort(np.argsort(area)[-SAMPLED:]))


def _chosen(segments: Segments, numbers: Indices) -> Segments:
    """Some of the segments, in increasing sequence."""
    edges = np.flatnonzero(np.isin(segments.segment, numbers))
    of_each = {name: getattr(segments, name)[numbers] for name in ("owner", "spans", "quad", "apex")}
    of_edges = {name: getattr(segments, name)[edges] for name in ("start", "end", "low", "high")}
    return replace(segments, segment=np.searchsorted(numbers, segments.segment[edges]), **of_each, **of_edges)


def _forces(segments: Segments, count: int) -> tuple[Array, Array]:
    """Forces (s, n) of a unit pressure on the functions of the secondary and of the primary side, by segment."""
    rule = _points_in(segments, count)
    spans = segments.spans[rule.segment], segments.outlines.spans[segments.owner[rule.segment]]
    _, normal, stretch = area_vectors(segments.secondary, rule.secondary_xi, spans[0])
    load = (rule.weights * stretch)[:, None] * normal
    sides = ((segments.secondary, rule.secondary_xi, spans[0]), (segments.primary, rule.primary_xi, spans[1]))
    sums = []
    for surface, xi, own in sides:
        shares = (basis(surface.patch, xi, spans=own).values[:, :, None] * load[:, None]).reshape(len(xi), -1)
        total = np.zeros((len(segments.owner), shares.shape[1]))
        np.add.at(total, rule.segment, shares)
        sums.append(total)
    return sums[0], sums[1]
