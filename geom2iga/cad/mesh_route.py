"""The mesh route: patches fitted to transfinite hexahedral meshes, for volumes that cannot be converted exactly."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import shortest_path

from geom2iga import bspline
from geom2iga.bspline import Array, Indices
from geom2iga.cad.hexahedra import HexahedralMesh, distances, mesh_volumes
from geom2iga.errors import CaseError, GeometryError
from geom2iga.patch import Face, Patch, evaluate, surface
from geom2iga.spline import collocation

CELLS_PER_SPAN = 2  # more equations than unknowns: a fit, smooth where the mesh is not
EDGES = ((0, 1), (3, 2), (4, 5), (7, 6), (0, 3), (1, 2), (4, 7), (5, 6), (0, 4), (1, 5), (2, 6), (3, 7))  # of a cell
CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))  # as gmsh counts
NO_GRID = "its hexahedra form no structured grid: split it into blocks"


@dataclass(frozen=True, eq=False)
class Fitted:
    """A patch fitted to the mesh of a volume.

    Parameters
    ----------
    patch : Patch
        Right-handed; where two volumes share a face, their patches share its control points.
    faces : by gmsh tag of a CAD face
        The face of the patch that was fitted to it.
    node_error : float
        Largest distance of the patch from the mesh nodes it was fitted to [length].
    boundary_error : float
        Largest distance of its faces from the CAD faces, measured also between the nodes [length].
    """

    patch: Patch
    faces: Mapping[int, Face]
    node_error: float
    boundary_error: float


def fit_volumes(names: Mapping[int, str], spans: int, degree: int = 3) -> tuple[Fitted, ...]:
    """Fit a patch to each of several volumes of the open gmsh model.

    Parameters
    ----------
    names : volume tag to name
        What the patches are called.
    spans : int
        Spans of every patch in each direction; the mesh has twice as many cells.

    Raises
    ------
    CaseError
        Too few spans for the degree.
    GeometryError
        A volume that gmsh cannot mesh with hexahedra, or whose mesh is folded.
    """
    if spans < max(1, degree - 1):
        raise CaseError(f"the mesh route fits degree {degree} with {max(1, degree - 1)} or more spans, found {spans}")
    meshes = mesh_volumes(list(names), CELLS_PER_SPAN * spans)
    return tuple(_fit_volume(tag, meshes[tag], name, spans, degree) for tag, name in names.items())


def _fit_volume(tag: int, mesh: HexahedralMesh, name: str, spans: int, degree: int) -> Fitted:
    """Fit one patch and measure its errors."""
    try:
        grid = structured_grid(mesh.nodes, mesh.hexahedra)
    except GeometryError as error:
        raise GeometryError(f"volume {tag}: {error}") from None
    patch, node_error = fitted(mesh.nodes[grid], name, degree, (spans,) * 3)
    faces = {face: _side(grid, nodes, name) for face, nodes in mesh.faces.items()}
    return Fitted(patch, faces, node_error, max(_boundary_error(patch, *pair) for pair in faces.items()))


def _side(grid: Indices, nodes: Indices, name: str) -> Face:
    """Find the side of a grid that consists of given nodes."""
    sides = (Face(name, axis, side) for axis in range(3) for side in range(2))
    return next(f for f in sides if np.array_equal(np.sort(np.take(grid, -f.side, f.axis), axis=None), nodes))


def _boundary_error(patch: Patch, tag: int, face: Face) -> float:
    """Measure the distance of a face from its CAD face at the nodes of the mesh and halfway between them."""
    sheet = surface(patch, face)
    at = [np.linspace(0, 1, 2 * CELLS_PER_SPAN * (len(b) - 1) + 1) for b in sheet.breaks]
    xi = np.stack(np.meshgrid(*at, indexing="ij"), axis=-1).reshape(-1, 2)
    return float(distances(tag, evaluate(sheet, xi)[0]).max())


def structured_grid(nodes: Array, hexahedra: Indices) -> Indices:
    """Recover the grid of a structured hexahedral mesh from its connectivity.

    Along the edges of the mesh, node (i, j, k) is i + j + k steps from one corner and a - i + j + k from the next, so
    that the distances from four corners tell i, j and k.

    Parameters
    ----------
    nodes : (n, 3)
        Positions [length]; they decide only which way the three directions run: right-handed, and along x, y and z
        as nearly as may be.
    hexahedra : (m, 8)
        Node numbers, each hexahedron turned as it likes.

    Returns
    -------
    (a + 1, b + 1, c + 1)
        Node numbers.

    Raises
    ------
    GeometryError
        Hexahedra that are no a x b x c grid, or a mesh that is folded.
    """
    steps, corners = _steps_from_corners(hexahedra, len(nodes))
    if len(corners) != 8 or not np.isfinite(steps).all():
        raise GeometryError(NO_GRID)
    between = steps[:, corners]
    on_the_way = between[:, :, None] + between[None, :, :] == between[:, None, :]  # is corner q between p and r?
    ends = np.flatnonzero(on_the_way[0].sum(axis=0) == 2)  # none lies between them and corner 0
    if len(ends) != 3:
        raise GeometryError(NO_GRID)
    sizes = between[0, ends]
    places = np.rint((steps[0] - steps[ends] + sizes[:, None]) / 2).astype(np.int64)
    shape = tuple(int(size) + 1 for size in sizes)
    grid = np.full(shape, -1)
    if np.all(places >= 0) and np.all(places < np.array(shape)[:, None]):
        grid[tuple(places)] = np.arange(len(nodes))
    if not _same_cells(grid, hexahedra):
        raise GeometryError(NO_GRID)
    return _aligned(grid, nodes)


def _steps_from_corners(hexahedra: Indices, count: int) -> tuple[Array, Indices]:
    """Count the edges (c, n) on the shortest ways from the corner nodes (c,), which are in one hexahedron only."""
    start, end = hexahedra[:, np.array(EDGES)].reshape(-1, 2).T
    edges = coo_array((np.ones(len(start)), (start, end)), shape=(count, count)).tocsr()
    corners = np.flatnonzero(np.bincount(hexahedra.ravel(), minlength=count) == 1)
    return shortest_path(edges, directed=False, unweighted=True, indices=corners), corners


def _same_cells(grid: Indices, hexahedra: Indices) -> bool:
    """Say whether the cells of a grid are the given hexahedra, in any sequence."""
    cells = np.stack(
        [grid[tuple(slice(d, n - 1 + d) for d, n in zip(at, grid.shape, strict=True))].ravel() for at in CORNERS],
        axis=-1,
    )
    one, other = (np.unique(np.sort(each, axis=1), axis=0) for each in (cells, hexahedra))
    return len(cells) == len(hexahedra) and np.array_equal(one, other)


def _aligned(grid: Indices, nodes: Array) -> Indices:
    """Turn a grid so that it is right-handed, its directions along x, y and z as nearly as may be."""
    along = _cell_edges(nodes[grid])
    jacobians = np.linalg.det(along)
    if not (jacobians.min() > 0 or jacobians.max() < 0):  # nor where they are no numbers
        raise GeometryError("its transfinite mesh is folded: split it into blocks of better shape")
    mean = along.reshape(-1, 3, 3).mean(axis=0)
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    hand = np.sign(jacobians.flat[0])
    turns = [  # new direction d is old direction axes[d], backwards where signs[d] is -1
        (axes, signs)
        for axes, signs in product(permutations(range(3)), product((1, -1), repeat=3))
        if np.linalg.det(np.eye(3)[list(axes)]) * np.prod(signs) * hand > 0
    ]
    axes, signs = max(turns, key=lambda turn: float(np.array(turn[1]) @ np.diag(mean[list(turn[0])])))
    return grid.transpose(axes)[tuple(slice(None, None, sign) for sign in signs)]


def _cell_edges(points: Array) -> Array:
    """Mean edges (a, b, c, 3, 3) of the cells of a grid of points, one row per direction."""
    edges = []
    for axis in range(3):
        along = np.diff(points, axis=axis)
        for other in {0, 1, 2} - {axis}:
            low, high = (np.take(along, np.arange(along.shape[other] - 1) + d, axis=other) for d in range(2))
            along = (low + high) / 2
        edges.append(along)
    return np.stack(edges, axis=-2)


def fitted(points: Array, name: str, degree: int = 3, spans: Sequence[int] | None = None) -> tuple[Patch, float]:
    """Fit a spline volume to a grid of points by least squares, its corners interpolated.

    Each direction is fitted in turn, its two end points interpolated. So the control points of a corner, an edge or a
    face depend on the points there alone: neighbours that share the points share the control points. Parameters and
    knots are uniform, for the neighbour may count from the other end.

    Parameters
    ----------
    points : (a + 1, b + 1, c + 1, 3)
        Positions [length].
    spans : (3,)
        Equal spans of each direction; left out, half as many as cells.

    Returns
    -------
    patch : Patch
    error : float
        Largest distance of a point from the patch at its parameters [length].

    Raises
    ------
    ValueError
        More control points than points in a direction.
    """
    cells = [n - 1 for n in points.shape[:3]]
    spans = [max(1, n // CELLS_PER_SPAN) for n in cells] if spans is None else spans
    knots = tuple(bspline.open_knots(np.linspace(0, 1, count + 1), degree) for count in spans)
    bases = [collocation(k, degree, np.linspace(0, 1, n + 1)).toarray() for k, n in zip(knots, cells, strict=True)]
    control_points = _tensor([_least_squares(basis) for basis in bases], points)
    error = np.linalg.norm(_tensor(bases, control_points) - points, axis=-1).max()
    return Patch(name, (degree,) * 3, knots, control_points), float(error)


def _least_squares(basis: Array) -> Array:
    """Make the matrix (n, m) that turns m values into n coefficients, with the first and last value interpolated."""
    count, unknowns = basis.shape
    if unknowns > count or np.linalg.matrix_rank(basis) < unknowns:
        raise ValueError(f"{count} points do not determine {unknowns} control points: take more spans or less degree")
    matrix = np.zeros((unknowns, count))
    matrix[0, 0] = matrix[-1, -1] = 1
    rest = np.eye(count) - basis[:, [0, -1]] @ matrix[[0, -1]]
    matrix[1:-1] = np.linalg.lstsq(basis[:, 1:-1], rest)[0]
    return matrix


def _tensor(matrices: Sequence[Array], points: Array) -> Array:
    """Apply one matrix to each direction of a grid (n_1, n_2, n_3, 3)."""
    for axis, matrix in enumerate(matrices):
        points = bspline.applied(matrix, points, axis)
    return points
