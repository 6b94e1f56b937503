"""Bodies cut along a plane: what lies behind it, and the face that it cuts."""

from collections.abc import Sequence
from itertools import permutations, product
from math import prod
from typing import Any

import numpy as np
import pyvista

from geom2iga.bspline import Array, Indices
from geom2iga.patch import Patch
from geom2iga.picture.scene import ABOVE
from post.case import Cut
from post.fields import BodySamples, Samples, sample_patch
from post.grid import Grid, count_points, sample_grid
from post.quantities import Quantity

MOST = 400_000  # points that bodies are sampled at to be cut, if two per span are not more
INVISIBLE = 1e-6  # distance, in sizes of the model
HEXAHEDRON, QUADRILATERAL = int(pyvista.CellType.HEXAHEDRON), int(pyvista.CellType.QUAD)


def affordable(samples: Samples, names: Sequence[str], cut: Cut) -> Samples:
    """Take fewer samples where the patches that a plane crosses would have too many inside."""
    patches = [
        patch for name, patch in samples.result.model.patches.items() if name in names and _is_crossed(patch, cut)
    ]
    count = samples.count
    while count > 2 and sum(count_points(patch, count)[0] for patch in patches) > MOST:
        count -= 1
    return samples if count == samples.count else Samples(samples.result, count)


def moved_back(cut: Cut, size: float) -> Cut:
    """Move a plane back by an invisible distance: one through sample points would cut cells along their edges."""
    return cut.model_copy(update={"origin": tuple((np.array(cut.origin) - INVISIBLE * size * cut.direction).tolist())})


def behind(meshes: Sequence[Any], cut: Cut) -> list[Any]:
    """Keep what of faces or lines lies behind the plane."""
    kept = [mesh.clip(normal=cut.direction, origin=cut.origin, invert=True) for mesh in meshes]
    return [mesh for mesh in kept if mesh.n_points]


def cut_faces(
    samples: Samples, names: Sequence[str], quantity: Quantity, cut: Cut, knot_lines: bool = True
) -> tuple[list[Any], list[Any]]:
    """Find the faces along which a plane cuts patches, undeformed, and the knot lines, or borders alone, on them.

    Returns
    -------
    faces, lines : meshes
        With point data "displacement", the faces with "field", too.
    """
    faces, lines = [], []
    patches = samples.result.model.patches
    for name in (name for name in names if _is_crossed(patches[name], cut)):
        part = sample_patch(samples.result, name, samples.count)
        grid = sample_grid(patches[name], samples.count, joined=True)
        height = cut.heights(part.points)
        cells = _crossing(part.cells, height)
        faces.append(_slice(part, cells, HEXAHEDRON, cut, field=quantity.values(part)))
        surfaces = _knot_surfaces(grid, knot_lines)
        lines.append(_slice(part, _crossing(surfaces, height), QUADRILATERAL, cut))
    return [mesh for mesh in faces if mesh.n_points], [mesh for mesh in lines if mesh.n_points]


def view_of(normal: Array) -> tuple[float, ...]:
    """Turn the usual view, by exchanging and mirroring axes, so that it faces a plane most."""
    if np.dot(ABOVE, normal) >= 0.7 * np.linalg.norm(ABOVE) * np.linalg.norm(normal):
        return ABOVE
    turned = [
        tuple(sign * size for sign, size in zip(signs, sizes, strict=True))
        for sizes in permutations(np.abs(ABOVE))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    usual = np.array([np.dot(ABOVE, view) for view in turned])
    return turned[int(np.argmax(np.round(turned @ normal / np.linalg.norm(normal), 6) + 1e-3 * usual))]


def _is_crossed(patch: Patch, cut: Cut) -> bool:
    """Whether the control points, and so perhaps the patch, lie on both sides."""
    height = cut.heights(patch.control_points.reshape(-1, 3))
    return bool(height.min() < 0 < height.max())


def _crossing(cells: Indices, height: Array) -> Indices:
    """Keep the cells that the plane crosses."""
    corners = height[cells]
    return cells[(corners.min(axis=1) < 0) & (corners.max(axis=1) >= 0)]


def _slice(part: BodySamples, cells: Indices, kind: int, cut: Cut, **fields: Array) -> Any:
    """Cut cells along the plane."""
    used, numbers = np.unique(cells, return_inverse=True)
    connections = np.insert(numbers.reshape(cells.shape), 0, cells.shape[1], axis=1).ravel()
    mesh = pyvista.UnstructuredGrid(connections, np.full(len(cells), kind, np.uint8), part.points[used])
    for name, values in {"displacement": part.displacement, **fields}.items():
        mesh[name] = values[used]
    return mesh.slice(normal=cut.direction, origin=cut.origin)


def _knot_surfaces(grid: Grid, inner: bool) -> Indices:
    """Quadrilaterals (c, 4) between the sample points on the borders and, if `inner`, where knots are between them."""
    numbers = np.arange(prod(grid.shape)).reshape(grid.shape)
    found = []
    for axis, line in enumerate(grid.lines):
        first, second = (d for d in range(3) if d != axis)
        at = np.moveaxis(numbers, axis, 0)[line.knots if inner else line.knots[[0, -1]]]
        rows, columns = grid.lines[first].starts, grid.lines[second].starts
        corners = [at[:, rows + i][:, :, columns + j].ravel() for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
        found.append(np.stack(corners, axis=-1))
    return np.concatenate(found)
