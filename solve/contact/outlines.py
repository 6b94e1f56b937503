"""Spans of the primary side, or parts of them, drawn in the secondary's parameter plane."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from geom2iga.bspline import Array, Indices, Mask
from geom2iga.errors import CaseError
from geom2iga.patch import evaluate
from geom2iga.projection import closest_points
from solve.contact.charts import Image, frame_at, image_of
from solve.contact.search import find_box_pairs, find_opposite, spans_of
from solve.face import Surface

CHORDS = 8  # chords per side of an outline that is curved, at most
STRAIGHT = 1e-12  # sides that deviate less from their chord, in lengths of it, are straight lines
BENT = 0.2  # outlines with a side that deviates more from its chord, in lengths of it, are cut
LENS = 5e-4  # how far a chord may lie off its curve, in spans of the secondary side
BESIDE = 0.25  # how far beyond the border of the secondary side a part of an outline is still near, in its spans
LEVELS = 24  # how often spans are cut, at most
REFINED = 8  # how often those that lie opposite as a whole are: kinks of the other side never become straight
SMALL = 0.125  # parts that reach beyond the secondary side are cut until they are that small, in its spans
SLENDER = 1e5  # spans that are longer, in widths, would be cut into ever more parts
KNOWN = 0.1  # least determinant of a fit, above which its points span a plane
SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


@dataclass(frozen=True, eq=False)
class Outlines:
    """Rectangles in the primary's parameter plane and their outlines in the secondary's.

    Parameters
    ----------
    corners : (r, 4, 2)
        Of the rectangles, counter-clockwise, in the primary's parameters.
    spans : (r, 2)
        Primary spans that they are part of, as knot indices.
    at : (r, 4 n, 2)
        Points of the outlines in the secondary's parameters, n chords a side.
    curved : (r, 4)
        Which sides are no straight lines there.
    """

    corners: Array
    spans: Indices
    at: Array
    curved: Mask

    def primary_xi(self, numbers: Indices, side: Indices, places: Array) -> tuple[Array, Array]:
        """Points (q, 2) on sides of outlines, and their derivatives (q, 2), at parameters (q,), side ... side + 1."""
        start, end = self.corners[numbers, side], self.corners[numbers, (side + 1) % 4]
        return start + (places - side)[:, None] * (end - start), end - start

    def primary_guess(self, numbers: Indices, xi: Array) -> Array:
        """Points (q, 2) of the primary about opposite points (q, 2) of the secondary; exact between planes."""
        places = self.at[:, :: self.at.shape[1] // 4]
        edges, images = (
            np.stack([c[:, 1] - c[:, 0] + c[:, 2] - c[:, 3], c[:, 3] - c[:, 0] + c[:, 2] - c[:, 1]], axis=2) / 2
            for c in (self.corners, places)
        )
        back = edges @ np.linalg.inv(images)
        away = xi - places.mean(axis=1)[numbers]
        return self.corners.mean(axis=1)[numbers] + np.einsum("qij,qj->qi", back[numbers], away)


def find_outlines(secondary: Surface, primary: Surface, reach: float | None = None) -> Outlines:
    """Draw the spans of the primary side in the secondary's parameter plane.

    Where a span is bent too much there, or only part of it lies opposite the secondary side, it is cut into 2 x 2, a
    slender one across its length alone, and again; what nowhere lies opposite is left out. Between planes all outlines
    are straight and nothing is cut.
    """
    spans = spans_of(primary.patch)
    corners = spans.low[:, None] + SQUARE * (spans.high - spans.low)[:, None]
    if secondary.is_affine and primary.is_affine:
        at, seen = _drawn(secondary, primary, corners, spans.numbers, 1)
        good: Mask = np.asarray(seen.all(axis=1))
        return Outlines(corners[good], spans.numbers[good], at[good], np.zeros((np.count_nonzero(good), 4), dtype=bool))
    return _cut_outlines(secondary, primary, corners, spans.numbers, reach)


def _cut_outlines(
    secondary: Surface, primary: Surface, corners: Array, spans: Indices, reach: float | None
) -> Outlines:
    """Draw rectangles, cutting those that cannot be drawn well."""
    opposite, sizes = find_opposite(secondary, primary, reach), _Sizes(secondary)
    done, off, cuts = [_nothing()], [0.0], np.zeros(len(corners), dtype=np.int64)
    for level in range(LEVELS + 1):
        near = np.unique(find_box_pairs(corners[:, 0], corners[:, 2], opposite.low, opposite.high)[0])
        if not near.size:
            break
        corners, spans, cuts = corners[near], spans[near], cuts[near]
        at, seen = _drawn(secondary, primary, corners, spans, CHORDS)
        good: Mask = np.asarray(seen.all(axis=1))
        bent, lens = _bending(at, secondary)
        fits = good & (bent <= BENT).all(axis=1)
        last = level == LEVELS
        final = fits & (last | (cuts == REFINED) | (lens <= LENS))
        done.append(Outlines(corners[final], spans[final], at[final], bent[final] > STRAIGHT))
        off.append(lens[final].max(initial=0.0))
        partly = ~good & (_touching(secondary, at, seen) | _holding(corners, opposite.feet))
        small = np.full(len(corners), last)
        small[partly] |= sizes.relative(primary, corners[partly], spans[partly]) <= SMALL
        at, whole = _completed(secondary, at, seen)
        whole &= partly & small
        done.append(
            Outlines(corners[whole], spans[whole], at[whole], np.ones((np.count_nonzero(whole), 4), dtype=bool))
        )
        if last:
            break
        again = ~final & ((good & (cuts < REFINED)) | (partly & ~small))
        across = good[again, None] | _long(primary, corners[again], spans[again])
        corners, of = _halved(corners[again], across)
        spans, cuts = spans[again][of], np.where(good, cuts + 1, 0)[again][of]
    coarser = (n for n in range(1, CHORDS) if CHORDS % n == 0 and max(off) * (CHORDS / n) ** 2 <= LENS)
    enough = next(coarser, CHORDS)
    parts = zip(*((o.corners, o.spans, o.at[:, :: CHORDS // enough], o.curved) for o in done), strict=True)
    return Outlines(*(np.concatenate(part) for part in parts))


def _nothing() -> Outlines:
    """No outlines, to add others to."""
    corners = np.empty((0, 4, 2))
    return Outlines(corners, np.empty((0, 2), dtype=np.int64), np.empty((0, 4 * CHORDS, 2)), corners[..., 0] > 0)


class _Sizes:
    """How large the spans of a side are."""

    def __init__(self, surface: Surface) -> None:
        self.surface = surface

    @cached_property
    def spans(self) -> tuple[cKDTree, Array]:
        """Middles and widths (s,) of all spans; raise CaseError where one is so slender that cuts would not end."""
        spans = spans_of(self.surface.patch)
        corners = spans.low[:, None] + SQUARE * (spans.high - spans.low)[:, None]
        points = evaluate(self.surface.patch, corners.reshape(-1, 2))[0].reshape(-1, 4, 3)
        edges = np.linalg.norm(np.roll(points, -1, axis=1) - points, axis=2)
        length = (edges[:, :2] + edges[:, 2:]) / 2  # an edge may have no length
        if np.any(length.max(axis=1) > SLENDER * length.min(axis=1)):
            raise CaseError(
                f"{self.surface.name} has spans more than {SLENDER:g} times as long as wide, too slender to be cut "
                "along a curved face or beside its border: take more spans along them or fewer across"
            )
        return cKDTree(points.mean(axis=1)), length.min(axis=1)

    def relative(self, surface: Surface, corners: Array, spans: Indices) -> Array:
        """Size (r,) of rectangles of another side, in widths of the spans next to them."""
        if not len(corners):
            return np.empty(0)
        tree, width = self.spans
        numbers = np.repeat(spans, 4, axis=0)
        points = evaluate(surface.patch, corners.reshape(-1, 2), spans=numbers)[0].reshape(-1, 4, 3)
        size = np.linalg.norm(np.roll(points, -1, axis=1) - points, axis=2).max(axis=1)
        return size / width[tree.query(points.mean(axis=1))[1]]


def _completed(secondary: Surface, at: Array, seen: Mask) -> tuple[Array, Mask]:
    """Guess the points of outlines (r, n, 2) that are not seen, and say where all of these lie beyond the border.

    What is continued beyond a border may fold. Only on which side of the border such a point lies matters: a curve is
    cut where it crosses the border. An affine map through the points that are seen tells.
    """
    share = np.arange(at.shape[1] // 4)[:, None] / (at.shape[1] // 4)
    square = (SQUARE[:, None] + share * (np.roll(SQUARE, -1, axis=0) - SQUARE)[:, None]).reshape(-1, 2)
    design = np.column_stack([np.ones(len(square)), square])
    normal = np.einsum("rn,ni,nj->rij", seen, design, design)
    known = np.linalg.det(normal) > KNOWN
    right = np.einsum("rn,ni,rnk->rik", seen, design, at)
    guess = design @ np.linalg.solve(np.where(known[:, None, None], normal, np.eye(3)), right)
    low, high = (np.array([b[end] for b in secondary.patch.breaks]) for end in (0, -1))
    beyond = np.any((guess < low) | (guess > high), axis=2)
    return np.where(seen[:, :, None], at, guess), known & np.all(seen | beyond, axis=1)


def _touching(surface: Surface, at: Array, seen: Mask) -> Mask:
    """Which outlines (r, n, 2) have points, among those seen (r, n), on a face or close to it."""
    breaks = surface.patch.breaks
    low = np.array([b[0] - BESIDE * (b[1] - b[0]) for b in breaks])
    high = np.array([b[-1] + BESIDE * (b[-1] - b[-2]) for b in breaks])
    return (seen & np.all((at >= low) & (at <= high), axis=2)).any(axis=1)


def _holding(corners: Array, points: Array) -> Mask:
    """Which rectangles (r, 4, 2) hold any of some points (n, 2)."""
    held = np.zeros(len(corners), dtype=bool)
    held[find_box_pairs(corners[:, 0], corners[:, 2], points, points)[0]] = True
    return held


def _long(surface: Surface, corners: Array, spans: Indices) -> Mask:
    """In which directions (r, 2) rectangles (r, 4, 2) are at least half as long as in the other one."""
    points = evaluate(surface.patch, corners.reshape(-1, 2), spans=np.repeat(spans, 4, axis=0))[0].reshape(-1, 4, 3)
    edges = np.linalg.norm(np.roll(points, -1, axis=1) - points, axis=2)
    length = edges[:, :2] + edges[:, 2:]
    return np.asarray(length >= length.max(axis=1, keepdims=True) / 2)


def _halved(corners: Array, across: Mask) -> tuple[Array, Indices]:
    """Halve rectangles (r, 4, 2) in some directions (r, 2); return the parts, and of which rectangle each is one."""
    low, step = corners[:, 0], (corners[:, 2] - corners[:, 0]) / (1 + across)
    parts = low[:, None, None] + (SQUARE[:, None] + SQUARE) * step[:, None, None]
    real = np.all(across[:, None] >= SQUARE, axis=2)  # (r, 4)
    return parts[real], np.nonzero(real)[0]


def _drawn(secondary: Surface, primary: Surface, corners: Array, spans: Indices, chords: int) -> tuple[Array, Mask]:
    """Outlines (r, 4 chords, 2) in the secondary's plane, and which of their points (r, 4 chords) are seen."""
    flat, owner = np.unique(
        np.concatenate([corners.reshape(-1, 2), np.repeat(spans, 4, axis=0)], axis=1), axis=0, return_inverse=True
    )
    places, numbers = flat[:, :2], flat[:, 2:].astype(np.int64)
    if chords == 1:
        start = np.broadcast_to([at.mean() for at in secondary.patch.breaks], places.shape)
    else:
        start = closest_points(secondary.patch, evaluate(primary.patch, places, spans=numbers)[0]).xi
    image = _image(secondary, primary, places, numbers, start)
    at, seen = image.xi[owner].reshape(-1, 4, 1, 2), image.seen[owner].reshape(-1, 4, 1)
    if chords == 1:
        return at[:, :, 0], seen[:, :, 0]
    share = (np.arange(1, chords) / chords)[:, None]
    between, starts = (c[:, :, None] + share * (np.roll(c, -1, axis=1) - c)[:, :, None] for c in (corners, at[:, :, 0]))
    inner = _image(
        secondary, primary, between.reshape(-1, 2), np.repeat(spans, 4 * (chords - 1), axis=0), starts.reshape(-1, 2)
    )
    at = np.concatenate([at, inner.xi.reshape(starts.shape)], axis=2)
    seen = np.concatenate([seen, inner.seen.reshape(starts.shape[:3])], axis=2)
    return at.reshape(len(at), 4 * chords, 2), seen.reshape(len(at), 4 * chords)


def _image(secondary: Surface, primary: Surface, xi: Array, spans: Indices, start: Array) -> Image:
    return image_of(secondary, frame_at(primary, xi, spans), start, primary.outward)


def _bending(at: Array, secondary: Surface) -> tuple[Array, Array]:
    """How far the sides of outlines deviate from their chords, in lengths of these, and their parts, in spans."""
    spans = spans_of(secondary.patch)
    span = (spans.high - spans.low).mean(axis=0)
    points = at.reshape(-1, 4, CHORDS, 2) / span
    chord = np.roll(points[:, :, 0], -1, axis=1) - points[:, :, 0]
    arm = points - points[:, :, :1]
    away = np.abs(arm[..., 0] * chord[:, :, None, 1] - arm[..., 1] * chord[:, :, None, 0]).max(axis=2)
    length = np.linalg.norm(chord, axis=2)
    bent = np.divide(away, length**2, where=length > 0, out=np.zeros_like(length))
    return bent, (bent * length).max(axis=1) / CHORDS**2
