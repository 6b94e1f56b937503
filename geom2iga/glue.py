"""Patches of one body that meet: which faces coincide, and degrees and knots that make them conform."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from geom2iga.bspline import Array, Indices
from geom2iga.errors import GeometryError
from geom2iga.model import Face, Glued, oriented
from geom2iga.patch import Patch, evaluate, resolution, surface
from geom2iga.spline import Spline, adapted, united

MEETS = 1e-7  # how far apart corners and faces may lie that are one, in sizes of the body: OpenCASCADE's own tolerance
SAMPLES = np.linspace(0, 1, 5)


@dataclass(frozen=True)
class Edge:
    """A parametric direction of a patch, seen from a class of parallel ones."""

    patch: int
    axis: int
    reversed: bool


def normalised(patch: Patch) -> Patch:
    """Let all knots run from 0 to 1; the same map otherwise."""
    knots = tuple((k - k[0]) / (k[-1] - k[0]) for k in patch.knots)
    return Patch(patch.name, patch.degrees, knots, patch.control_points, patch.weights)


def all_faces(patches: Sequence[Patch]) -> list[Face]:
    """List the six faces of each patch."""
    return [Face(patch.name, axis, side) for patch in patches for axis in range(3) for side in range(2)]


def find_glued(patches: Sequence[Patch]) -> tuple[Glued, ...]:
    """Find the faces that coincide: the same corners and the same points between them.

    Parameters
    ----------
    patches : volumes whose knots run from 0 to 1; degrees and knots may differ

    Returns
    -------
    tuple of Glued
        Each face once at most, in the sequence of the patches.

    Raises
    ------
    GeometryError
        Several patches, one so thin that its opposite faces could be one.
    """
    faces = all_faces(patches)
    by_name = {patch.name: patch for patch in patches}
    surfaces = [surface(by_name[face.patch], face) for face in faces]
    corners = np.array([s.control_points[np.ix_([0, -1], [0, -1])].reshape(4, 3) for s in surfaces])
    reach = MEETS * float(np.ptp(corners.reshape(-1, 3), axis=0).max()) + resolution(corners)
    if _is_thin(patches, reach):
        return ()
    numbers = clusters(corners.reshape(-1, 3), reach).reshape(-1, 4)
    alike = defaultdict(list)
    for number, around in enumerate(numbers):
        alike[tuple(sorted(around))].append(number)
    glued, used = [], set()
    for one, other in (pair for group in alike.values() for pair in combinations(group, 2)):
        if one in used or other in used:
            continue
        grids = numbers[one].reshape(2, 2), numbers[other].reshape(2, 2)
        orientation = _orientation(surfaces[one], surfaces[other], *grids, reach)
        if orientation is not None:
            used |= {one, other}
            glued.append(Glued(faces[one], faces[other], orientation))
    return tuple(glued)


def _is_thin(patches: Sequence[Patch], reach: float) -> bool:
    """Whether opposite faces of a patch lie as near as faces that are one; raise GeometryError for one of several."""
    for patch in patches:
        thickness = min(float(np.ptp(patch.control_points, axis=axis).max()) for axis in range(3))
        if thickness <= reach and len(patches) > 1:
            raise GeometryError(
                f'patch "{patch.name}" is {thickness:.3g} thick, less than {MEETS:g} of its body: which faces touch '
                "cannot be told; make it thicker, or the body smaller"
            )
        if thickness <= reach:
            return True
    return False


def clusters(points: Array, reach: float) -> Indices:
    """Number points (n, 3) so that those nearer than `reach` share a number."""
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(points),) * 2)
    return connected_components(links, directed=False)[1].astype(np.int64)


def _orientation(first: Patch, second: Patch, corners: Indices, others: Indices, reach: float) -> int | None:
    """Find how two faces with the same corners lie on each other; None where they differ in between."""
    grid = np.stack(np.meshgrid(SAMPLES, SAMPLES, indexing="ij"), axis=-1).reshape(-1, 2)
    points, theirs = (evaluate(s, grid)[0].reshape(len(SAMPLES), len(SAMPLES), 3) for s in (first, second))
    for orientation in range(8):
        apart = np.abs(points - oriented(theirs, orientation)).max()
        if np.array_equal(corners, oriented(others, orientation)) and apart <= reach:
            return orientation
    return None


def parallel_edges(patches: Sequence[Patch], glued: Sequence[Glued]) -> list[list[Edge]]:
    """Find the classes of parametric directions that glue ties together, each with its sense.

    Returns
    -------
    list of classes
        Every direction of every patch stands in one class; in both senses where a ring of patches comes back twisted.
    """
    place = {patch.name: number for number, patch in enumerate(patches)}
    links = []
    for pair in glued:
        swap, flips = pair.orientation & 1, (pair.orientation >> 1 & 1, pair.orientation >> 2 & 1)
        for k in range(2):
            here = 3 * place[pair.first.patch] + pair.first.axes[k]
            there = 3 * place[pair.second.patch] + pair.second.axes[1 - k if swap else k]
            links += [(2 * here, 2 * there + flips[k]), (2 * here + 1, 2 * there + 1 - flips[k])]
    count = 6 * len(patches)  # each direction stands twice, forwards and backwards
    ends = np.array(links, dtype=np.int64).reshape(-1, 2).T
    _, labels = connected_components(coo_array((np.ones(ends.shape[1]), ends), shape=(count, count)), directed=False)
    classes, seen = [], set()
    for label in labels:
        if label in seen:
            continue
        members = np.flatnonzero(labels == label)
        seen |= set(labels[members ^ 1])
        seen.add(label)
        classes.append([Edge(int(m) // 6, int(m) // 2 % 3, bool(m % 2)) for m in members])
    return classes


def respaced(
    patches: Sequence[Patch], glued: Sequence[Glued], choose: Callable[[list[Edge], int, Array], tuple[int, Array]]
) -> list[list[tuple[int, Array]]]:
    """Choose degree and knots once per class of parallel directions; return them per patch and direction.

    Parameters
    ----------
    patches : volumes whose knots run from 0 to 1
    choose : function of (edges, degree, knots)
        Of a class and of the smallest space that holds what its patches have: the degree and knots to take.
    """
    spaces: list[list[tuple[int, Array]]] = [[(0, np.empty(0))] * 3 for _ in patches]
    for edges in parallel_edges(patches, glued):
        degree, knots = choose(edges, *united([_space_along(patches[edge.patch], edge) for edge in edges]))
        for edge in edges:
            spaces[edge.patch][edge.axis] = degree, 1 - knots[::-1] if edge.reversed else knots
    return spaces


def conformed(patches: Sequence[Patch], glued: Sequence[Glued]) -> tuple[Patch, ...]:
    """Raise degrees and insert knots so that glued faces have the same ones; the maps stay the same.

    Parameters
    ----------
    patches : volumes whose knots run from 0 to 1
    """
    spaces = respaced(patches, glued, lambda edges, degree, knots: (degree, knots))
    return tuple(in_space(patch, wanted) for patch, wanted in zip(patches, spaces, strict=True))


def _space_along(patch: Patch, edge: Edge) -> tuple[int, Array]:
    """Degree and knots of a direction in the sense of its class."""
    knots = patch.knots[edge.axis]
    return patch.degrees[edge.axis], 1 - knots[::-1] if edge.reversed else knots


def in_space(patch: Patch, spaces: Sequence[tuple[int, Array]]) -> Patch:
    """Write a patch with higher degrees and more knots, one (degree, knots) per direction; the same map."""
    return adapted(Spline(patch.degrees, patch.knots, patch.homogeneous), spaces).patch(patch.name)
