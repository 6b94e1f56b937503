"""Convex polygons: clipping, triangles, quadrature."""

import numpy as np
from scipy.special import roots_jacobi

from geom2iga.bspline import Array, Indices

SLIVER = 1e-15  # triangles below this fraction of the largest are rounding errors


def clip(polygons: Array, windows: Array) -> tuple[Array, Indices]:
    """Clip convex polygons with convex windows, pair by pair, one window edge after the other.

    Unlike general overlays it cannot fail where edges coincide to rounding (Sutherland & Hodgman 1974).

    Parameters
    ----------
    polygons : (k, n, 2)
    windows : (k, m, 2)
        Corners in sequence, either way round.

    Returns
    -------
    corners : (k, c, 2)
    counts : (k,)
        How many of the corners of each are meant; fewer than three where nothing is left.

    Examples
    --------
    >>> square = np.array([[[0.0, 0], [1, 0], [1, 1], [0, 1]]])
    >>> corners, counts = clip(square, square + 0.5)
    >>> counts.tolist(), corners.min(axis=1).tolist(), corners.max(axis=1).tolist()
    ([4], [[0.5, 0.5]], [[1.0, 1.0]])
    """
    corners, counts = polygons, np.full(len(polygons), polygons.shape[1])
    edges = np.roll(windows, -1, axis=1) - windows
    inward = np.sign(_cross(edges[:, 0], edges[:, 1]))[:, None]
    for side in range(windows.shape[1]):
        height = _cross(edges[:, side, None], corners - windows[:, side, None]) * inward
        corners, counts = _cut(corners, counts, height)
    return corners, counts


def _cut(corners: Array, counts: Indices, height: Array) -> tuple[Array, Indices]:
    """Keep what has a nonnegative height (k, n) of polygons (k, n, 2) with the given numbers of corners."""
    pairs, width = height.shape
    slots = np.arange(width)
    following = np.where(slots + 1 < counts[:, None], slots + 1, 0)
    ahead = np.take_along_axis(height, following, axis=1)
    inside = height >= 0
    crosses = inside != (ahead >= 0)
    share = np.where(crosses, height / np.where(crosses, height - ahead, 1.0), 0.0)[:, :, None]
    crossings = corners + share * (np.take_along_axis(corners, following[:, :, None], axis=1) - corners)
    kept = np.stack([inside, crosses], axis=2) & (slots < counts[:, None])[:, :, None]
    kept = kept.reshape(pairs, 2 * width)
    counts = kept.sum(axis=1)
    order = np.argsort(~kept, axis=1, kind="stable")[:, : max(3, counts.max(initial=0))]
    both = np.stack([corners, crossings], axis=2).reshape(pairs, 2 * width, 2)
    return np.take_along_axis(both, order[:, :, None], axis=1), counts


def triangulate(corners: Array, counts: Indices) -> tuple[Array, Indices]:
    """Split convex polygons into triangles around their first corner; slivers are left out.

    Parameters
    ----------
    corners : (k, c, 2)
    counts : (k,)
        How many of the corners of each are meant.

    Returns
    -------
    triangles : (t, 3, 2)
    owner : (t,)
        The polygon each belongs to.
    """
    owner, middle = np.nonzero(np.arange(1, corners.shape[1] - 1) < counts[:, None] - 1)
    triangles = np.stack([corners[owner, 0], corners[owner, middle + 1], corners[owner, middle + 2]], axis=1)
    area = _doubled_area(triangles)
    large = area > SLIVER * area.max(initial=0.0)
    return triangles[large], owner[large]


def _doubled_area(triangles: Array) -> Array:
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.abs(_cross(edges[:, 0], edges[:, 1]))


def _cross(a: Array, b: Array) -> Array:
    """Cross products of vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def triangle_points(triangles: Array, count: int) -> tuple[Array, Array]:
    """Place count² points in each triangle, exact for polynomials of total degree 2 count - 1.

    A square is collapsed onto the triangle; Gauss-Jacobi points take up the factor 1 - s that this brings
    (Stroud 1971, conical product).

    Parameters
    ----------
    triangles : (t, 3, 2)

    Returns
    -------
    points : (t count², 2) [length]
    weights : (t count²,) [length²]

    Examples
    --------
    >>> points, weights = triangle_points(np.array([[[0.0, 0], [1, 0], [0, 1]]]), 2)
    >>> round(float(weights @ (points[:, 0] ** 2 * points[:, 1])) * 60, 12)
    1.0
    """
    s, weights_s = roots_jacobi(count, 1, 0)
    t, weights_t = np.polynomial.legendre.leggauss(count)
    s, t = (1 + s)[:, None] / 2, (1 + t)[None, :] / 2
    barycentric = np.stack(np.broadcast_arrays((1 - s) * (1 - t), s, (1 - s) * t), axis=-1).reshape(-1, 3)
    fractions = np.outer(weights_s, weights_t).ravel() / 8
    points = np.einsum("pc,tck->tpk", barycentric, triangles).reshape(-1, 2)
    return points, (_doubled_area(triangles)[:, None] * fractions).ravel()
