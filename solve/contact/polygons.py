"""Quadrature on convex polygons."""

import numpy as np
import shapely
from scipy.special import roots_jacobi

from geom2iga.bspline import Array, Indices


def triangulate(polygons: Array) -> tuple[Array, Indices]:
    """Split convex polygons into triangles around their first corner; what is no polygon has none.

    Returns
    -------
    triangles : (t, 3, 2)
    owner : (t,)
        The polygon each belongs to.
    """
    areal = np.flatnonzero(shapely.get_type_id(polygons) == shapely.GeometryType.POLYGON)
    corners, owner = shapely.get_coordinates(polygons[areal], return_index=True)
    first = np.searchsorted(owner, owner)
    last = np.searchsorted(owner, owner, side="right") - 1  # each ring ends where it began
    position = np.arange(len(owner))
    middle = position[(position > first) & (position < last - 1)]
    return np.stack([corners[first[middle]], corners[middle], corners[middle + 1]], axis=1), areal[owner[middle]]


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
    edges = triangles[:, 1:] - triangles[:, :1]
    doubled = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    points = np.einsum("pc,tck->tpk", barycentric, triangles).reshape(-1, 2)
    return points, (doubled[:, None] * fractions).ravel()
