"""Six-faced volumes with straight edges and plane faces to trilinear patches."""

from collections.abc import Iterator
from itertools import permutations

import numpy as np

from geom2iga.bspline import Array
from geom2iga.cad import Volume
from geom2iga.errors import GeometryError
from geom2iga.patch import Patch

TOLERANCE = 1e-10  # how far from straight or plane, in sizes of the volume
ROUNDING = 1e-14  # how far rounding moves a point, in distances from the origin

NOT_YET = "so far only volumes with six plane faces and straight edges become patches"


def trilinear_patch(volume: Volume, name: str, axes: Array | None = None) -> Patch:
    """Make the trilinear patch of a hexahedral volume.

    Parameters
    ----------
    axes : (3, 3)
        Rows: where the three parametric directions should point as nearly as may be; left out, along x, y and z.

    Returns
    -------
    Patch
        Right-handed; its eight control points are the volume's corners.

    Raises
    ------
    GeometryError
        A volume that is not bounded by six plane faces with four straight edges each, or is not convex.
    """
    _check_hexahedron(volume)
    axes = np.eye(3) if axes is None else axes

    candidates = [corners for corners in _labellings(volume) if _smallest_jacobian(corners) > 0]
    if not candidates:
        raise GeometryError(f"volume {volume.tag} has a re-entrant corner: split it there into convex blocks")
    return Patch(
        name,
        (1, 1, 1),
        (np.array([0.0, 0, 1, 1]),) * 3,
        max(candidates, key=lambda corners: float(np.sum(_edges(corners) * axes))),
    )


def _edges(corners: Array) -> Array:
    """Unit vectors (3, 3) along the mean edge of each direction of (2, 2, 2, 3) corners."""
    edges = np.array([np.diff(corners, axis=d).reshape(-1, 3).mean(axis=0) for d in range(3)])
    lengths = np.linalg.norm(edges, axis=1, keepdims=True)
    return edges / np.where(lengths > 0, lengths, 1)


def _smallest_jacobian(corners: Array) -> float:
    """Return the smallest Jacobian determinant of a trilinear map (2, 2, 2, 3) at its eight corners [length³]."""
    along_u, along_v, along_w = (np.diff(corners, axis=d).squeeze(d) for d in range(3))
    return min(float(np.linalg.det([along_u[j, k], along_v[i, k], along_w[i, j]])) for i, j, k in np.ndindex(2, 2, 2))


def _labellings(volume: Volume) -> Iterator[Array]:
    """Yield the corners (2, 2, 2, 3) for each of the 48 ways to run three directions through a hexahedron."""
    neighbours: dict[int, set[int]] = {point: set() for point in volume.points}
    for curve in volume.curves.values():
        start, end = curve.ends
        neighbours[start].add(end)
        neighbours[end].add(start)
    for origin, around in neighbours.items():
        for u, v, w in permutations(sorted(around)):
            uv, vw, uw = (_opposite(neighbours, origin, a, b) for a, b in ((u, v), (v, w), (u, w)))
            far = next(iter(set(neighbours) - {origin, u, v, w, uv, vw, uw}))
            tags = [[[origin, w], [v, vw]], [[u, uw], [uv, far]]]
            yield np.array([[[volume.points[t] for t in row] for row in plane] for plane in tags])


def _opposite(neighbours: dict[int, set[int]], origin: int, a: int, b: int) -> int:
    """Find the fourth corner of the face that holds `origin` between its neighbours a and b."""
    return next(iter((neighbours[a] & neighbours[b]) - {origin}))


def _check_hexahedron(volume: Volume) -> None:
    """Raise GeometryError unless the volume is a hexahedron with straight edges and plane faces."""
    where = f"volume {volume.tag}"
    if len(volume.faces) != 6:
        raise GeometryError(f"{where} has {len(volume.faces)} faces, a block has 6; {NOT_YET}: split it into blocks")
    points = np.array(list(volume.points.values()))
    allowed = TOLERANCE * float(np.ptp(points, axis=0).max()) + ROUNDING * float(np.abs(points).max())
    for tag, (kind, curves) in volume.faces.items():
        if kind != "Plane":
            raise GeometryError(f"{where}: face {tag} is no plane but a {kind.lower()}; {NOT_YET}")
        if len(curves) != 4:
            raise GeometryError(f"{where}: face {tag} has {len(curves)} edges, a block face has 4; {NOT_YET}")
        corners = np.array([volume.points[end] for curve in curves for end in volume.curves[curve].ends])
        if np.linalg.svd(corners - corners.mean(axis=0))[1][-1] > allowed:
            raise GeometryError(f"{where}: the corners of face {tag} do not lie in one plane; {NOT_YET}")
    for tag, curve in volume.curves.items():
        if curve.kind != "Line" or len(curve.ends) != 2:
            raise GeometryError(f"{where}: edge {tag} is no straight line but a {curve.kind.lower()}; {NOT_YET}")
        chord = (volume.points[curve.ends[0]] + volume.points[curve.ends[1]]) / 2
        if np.linalg.norm(curve.middle - chord) > allowed:
            raise GeometryError(f"{where}: edge {tag} is not straight; {NOT_YET}")
    degrees = [sum(point in curve.ends for curve in volume.curves.values()) for point in volume.points]
    if degrees != [3] * 8:
        raise GeometryError(f"{where}: its edges do not form a hexahedron; {NOT_YET}")
