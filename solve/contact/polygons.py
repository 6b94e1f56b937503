"""Polygons bounded by lines and curves: clipping by their chords, quadrature by cones."""

from typing import NamedTuple

import numpy as np
from scipy.special import roots_jacobi

from geom2iga.bspline import Array, Indices, Mask

CORNER, CHORD = -1.0, -2.0  # marks of corners of the first outline: one that stays, one between two chords of a curve
NONE = -1.0  # parameter of an edge that is no curve


class Corners(NamedTuple):
    """Corners of k polygons, in sequence; each of the arrays ends with its last meant corner, the rest is filling."""

    at: Array  # (k, c, 2)
    arrives: Array  # (k, c) parameter of the outline's curve that ends here, -1 where a straight edge does
    leaves: Array  # (k, c) parameter of the outline's curve that begins here, -1 where a straight edge does
    mark: Array  # (k, c) axis across the window's side that the corner lies on; else CORNER or CHORD
    counts: Indices  # (k,)

    @property
    def meant(self) -> Mask:
        """Which corners are meant, (k, c)."""
        return np.arange(self.at.shape[1]) < self.counts[:, None]

    def chosen(self, which: Indices | Mask) -> "Corners":
        """Some of the polygons."""
        return Corners(self.at[which], self.arrives[which], self.leaves[which], self.mark[which], self.counts[which])

    @property
    def following(self) -> Indices:
        """Slot of the corner after each, (k, c)."""
        slots = np.arange(self.at.shape[1])
        return np.where(slots + 1 < self.counts[:, None], slots + 1, 0)

    @property
    def quads(self) -> Mask:
        """Which polygons (k,) have four corners and are convex."""
        if self.at.shape[1] < 4:
            return np.zeros(len(self.at), dtype=bool)
        edges = np.roll(self.at[:, :4], -1, axis=1) - self.at[:, :4]
        turns = cross(edges, np.roll(edges, -1, axis=1))
        return (self.counts == 4) & (np.all(turns > 0, axis=1) | np.all(turns < 0, axis=1))

    @property
    def area(self) -> Array:
        """Areas (k,) within the chords, positive where the corners run counter-clockwise."""
        ahead = np.take_along_axis(self.at, self.following[:, :, None], axis=1)
        middle = self.at[:, :1]  # so that a polygon far from the origin costs no digits
        return np.sum(cross(self.at - middle, ahead - middle), axis=1, where=self.meant) / 2


def outline_corners(at: Array, curved: Mask) -> Corners:
    """Take the corners of four-sided outlines whose sides are cut into equally many chords.

    Parameters
    ----------
    at : (k, 4 n, 2)
        Corners, n chords a side. Along side number e the parameter runs from e to e + 1.
    curved : (k, 4)
        Which sides are curves and not straight lines.
    """
    chords = at.shape[1] // 4
    side = np.arange(at.shape[1]) // chords
    leaves = np.arange(at.shape[1]) / chords
    before = np.roll(side, 1)
    arrives = np.where(leaves > 0, leaves, 4.0)
    mark = np.where(np.arange(at.shape[1]) % chords == 0, CORNER, CHORD)
    return Corners(
        at,
        np.where(curved[:, before], arrives, NONE),
        np.where(curved[:, side], leaves, NONE),
        np.broadcast_to(mark, at.shape[:2]),
        np.full(len(at), at.shape[1]),
    )


def clip(polygons: Corners, low: Array, high: Array) -> Corners:
    """Clip polygons with rectangles, pair by pair, one side after the other (Sutherland & Hodgman 1974).

    Unlike general overlays it cannot fail where edges coincide to rounding. A polygon that is not convex may come
    back in parts that are joined along a side of the rectangle, there and back: sums over signed areas are right.

    Parameters
    ----------
    low, high : (k, 2)
        Corners of the rectangles.

    Examples
    --------
    >>> square = outline_corners(np.array([[[0.0, 0], [1, 0], [1, 1], [0, 1]]]), np.zeros((1, 4), dtype=bool))
    >>> part = clip(square, np.array([[0.5, 0.5]]), np.array([[2.0, 2.0]]))
    >>> part.counts.tolist(), part.area.tolist()
    ([4], [0.25])
    """
    for axis in range(2):
        polygons = _cut(polygons, axis, low[:, axis], 1.0)
        polygons = _cut(polygons, axis, high[:, axis], -1.0)
    return polygons


def _cut(polygons: Corners, axis: int, bound: Array, sign: float) -> Corners:
    """Keep what lies beyond a bound (k,) along an axis (sign 1) or below it (sign -1)."""
    height = sign * (polygons.at[:, :, axis] - bound[:, None])
    following = polygons.following
    ahead = np.take_along_axis(height, following, axis=1)
    inside = height >= 0
    crosses = inside != (ahead >= 0)
    share = np.where(crosses, height / np.where(crosses, height - ahead, 1.0), 0.0)
    at = polygons.at + share[:, :, None] * (
        np.take_along_axis(polygons.at, following[:, :, None], axis=1) - polygons.at
    )
    at[:, :, axis] = bound[:, None]
    place = polygons.leaves + share * (np.take_along_axis(polygons.arrives, following, axis=1) - polygons.leaves)
    crossing = Corners(
        at, np.where(inside, place, NONE), np.where(inside, NONE, place), np.full(height.shape, axis), polygons.counts
    )
    kept = np.stack([inside, crosses], axis=2) & polygons.meant[:, :, None]
    return packed(polygons, crossing, kept)


def packed(first: Corners, second: Corners, kept: Mask) -> Corners:
    """Take the corners kept (k, c, 2) of two sets of polygons in turn."""
    kept = kept.reshape(len(kept), 2 * kept.shape[1])
    counts = kept.sum(axis=1)
    order = np.argsort(~kept, axis=1, kind="stable")[:, : max(3, counts.max(initial=0))]

    def both(name: str) -> Array:
        values = np.stack([getattr(first, name), getattr(second, name)], axis=2)
        values = values.reshape(*kept.shape, *values.shape[3:])
        return np.take_along_axis(values, order[:, :, None] if values.ndim == 3 else order, axis=1)

    return Corners(both("at"), both("arrives"), both("leaves"), both("mark"), counts)


def cross(a: Array, b: Array) -> Array:
    """Cross products of vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def cone_points(apex: Array, curve: Array, slope: Array, weights: Array) -> tuple[Array, Array]:
    """Place count² points in the cones between apices and curves, at Gauss points of the curves.

    x(s, t) = a + s (c(t) - a) has the Jacobian s (c - a) x c', negative where the curve runs clockwise about the
    apex; Gauss-Jacobi points take up the factor s (Stroud 1971, conical product). Over a straight line it is exact
    for polynomials of total degree 2 count - 1.

    Parameters
    ----------
    apex : (e, 2)
    curve, slope : (e, count, 2)
        Points c(t) and c'(t).
    weights : (count,)
        Of the points along the curves.

    Returns
    -------
    points : (e, count², 2)
    weights : (e, count²)

    Examples
    --------
    >>> t, weights = gauss_line(2)
    >>> curve = np.stack([1 - t, t], axis=1)[None]
    >>> slope = np.broadcast_to([-1.0, 1], curve.shape)
    >>> points, weights = cone_points(np.zeros((1, 2)), curve, slope, weights)
    >>> round(float(np.sum(weights * points[..., 0] ** 2 * points[..., 1])) * 60, 12)
    1.0
    """
    s, shares = roots_jacobi(len(weights), 0, 1)
    s, shares = (1 + s) / 2, shares / 4
    arm = curve - apex[:, None]
    points = apex[:, None, None] + s[:, None, None] * arm[:, None]
    areas = shares[:, None] * (weights * cross(arm, slope))[:, None]
    shape = (len(apex), len(weights) ** 2)
    return points.reshape(*shape, 2), areas.reshape(shape)


def quad_points(corners: Array, curves: Array, slopes: Array, weights: Array) -> tuple[Array, Array]:
    """Place count² points between four curves, at the crossings of a blend of opposite ones (Coons 1967).

    Between straight lines it is exact for polynomials of total degree 2 count - 2.

    Parameters
    ----------
    corners : (k, 4, 2)
        Where the curves begin.
    curves, slopes : (k, 4, count, 2)
        Gauss points of four curves in sequence, and their derivatives.
    weights : (count,)
        Of the points along the curves.

    Returns
    -------
    points : (k, count², 2)
    weights : (k, count²)
        Negative where the curves run clockwise.

    Examples
    --------
    >>> t, weights = gauss_line(2)
    >>> corners = np.array([[0.0, 0], [2, 0], [2, 1], [0, 3]])
    >>> chords = np.roll(corners, -1, axis=0) - corners
    >>> curves = corners[:, None] + t[:, None] * chords[:, None]
    >>> slopes = np.broadcast_to(chords[:, None], curves.shape)
    >>> points, weights = quad_points(corners[None], curves[None], slopes[None], weights)
    >>> round(float(weights.sum()), 12)
    4.0
    """
    t = gauss_line(len(weights))[0]
    s = t[:, None, None]
    t = t[:, None]
    low, right, up, left = (curves[:, n] if n < 2 else curves[:, n, ::-1] for n in range(4))
    d_low, d_right, d_up, d_left = (slopes[:, n] if n < 2 else -slopes[:, n, ::-1] for n in range(4))
    low, up, d_low, d_up = (values[:, :, None] for values in (low, up, d_low, d_up))
    left, right, d_left, d_right = (values[:, None] for values in (left, right, d_left, d_right))
    a, b, c, d = (corners[:, n, None, None] for n in range(4))
    start, end = (1 - s) * a + s * b, (1 - s) * d + s * c  # of the straight lines between the corners
    points = (1 - t) * (low - start) + t * (up - end) + (1 - s) * left + s * right
    along = (1 - t) * (d_low - b + a) + t * (d_up - c + d) + right - left
    across = up - end - low + start + (1 - s) * d_left + s * d_right
    areas = np.outer(weights, weights) * cross(along, across)
    shape = (len(corners), len(weights) ** 2)
    return points.reshape(*shape, 2), areas.reshape(shape)


def gauss_line(count: int) -> tuple[Array, Array]:
    """Gauss points and weights on 0 ... 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (1 + nodes) / 2, weights / 2
