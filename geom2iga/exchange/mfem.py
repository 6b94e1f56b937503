"""MFEM: NURBS meshes of several patches, version 1.0."""

from collections import defaultdict
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from geom2iga.bspline import Indices
from geom2iga.errors import GeometryError
from geom2iga.exchange.common import one_line, outer_faces, rows
from geom2iga.files import replacing
from geom2iga.glue import Edge, normalised, parallel_edges
from geom2iga.model import Model, oriented
from geom2iga.patch import Face, Patch

HIGHEST_DEGREE = 10  # KnotVector::MaxOrder of MFEM
AROUND = ((0, 0), (1, 0), (1, 1), (0, 1))  # corners of a square, counter-clockwise
CUBE, SQUARE = 5, 3  # numbers of MFEM's shapes


class Topology(NamedTuple):
    """What MFEM wants to know of the patches before it sees their control points."""

    vertices: Indices  # (p, 2, 2, 2) numbers of the corners of each patch
    edges: Indices  # (e, 3) knot vector, first and last vertex


def write_mfem(path: str | Path, model: Model) -> None:
    """Write a model as "MFEM NURBS mesh v1.0".            https://mfem.org/mesh-format-v1.0/#nurbs-meshes

    Element attributes number the bodies, boundary attributes the groups, both from 1 in the sequence of the model;
    comments name them. Knots run from 0 to 1.

    Raises
    ------
    GeometryError
        Patches that MFEM cannot tell apart, or of too high a degree.
    """
    for patch in model.patches.values():
        if max(patch.degrees) > HIGHEST_DEGREE:
            raise GeometryError(
                f'patch "{patch.name}" has degrees {patch.degrees}: MFEM takes none above {HIGHEST_DEGREE}, '
                "choose a lower degree"
            )
    topology = find_topology(model)
    with replacing(Path(path)) as temporary:
        temporary.write_text("\n".join(_lines(model, topology)) + "\n", encoding="utf-8")


def find_topology(model: Model) -> Topology:
    """Number the corners and edges of the patches; glued ones share a number.

    Parallel edges run the same way, and every edge from its lower to its higher vertex: where it is not so, MFEM turns
    the knots of some patches round that it should leave, and the other way about (CheckKVDirection).

    Raises
    ------
    GeometryError
        Edges or faces that MFEM would take for one, or edges that cannot all rise.
    """
    labels = _labels(model)
    _check_told_apart(model, labels)
    corners = _numbered(labels[:, ::2, ::2, ::2])
    count = int(corners.max()) + 1
    edges = np.empty((0, 3), dtype=np.int64)
    for number, parallel in enumerate(parallel_edges(list(model.patches.values()), model.glued)):
        ends = np.concatenate([_ends(corners, edge) for edge in parallel])
        forwards = np.column_stack([np.full(len(ends), number), ends])
        ways = [np.concatenate([edges, way]) for way in (forwards, forwards[:, [0, 2, 1]])]
        rising = [way for way in ways if _can_rise(way, count)]
        if not rising:
            patch = list(model.patches)[parallel[0].patch]
            raise GeometryError(
                f'direction {parallel[0].axis} of patch "{patch}" leads through other patches back to itself, reversed '
                "or further on, and MFEM has no way to say so: leave one of the faces that it crosses unglued"
            )
        edges = rising[0]
    rising_numbers = _ranks(edges)
    edges[:, 1:] = rising_numbers[edges[:, 1:]]
    return Topology(rising_numbers[corners], np.unique(edges, axis=0))


def _ends(corners: Indices, edge: Edge) -> Indices:
    """Vertices (4, 2) between which the four edges of a patch run that are parallel to a direction."""
    ends = np.moveaxis(corners[edge.patch], edge.axis, -1).reshape(4, 2)
    return ends[:, ::-1] if edge.reversed else ends


def _can_rise(edges: Indices, count: int) -> bool:
    """Say whether vertices can be numbered so that all edges rise: no way along them comes back to where it began."""
    links = coo_array((np.ones(len(edges)), (edges[:, 1], edges[:, 2])), shape=(count, count))
    return connected_components(links, connection="strong", return_labels=False) == count


def _ranks(edges: Indices) -> Indices:
    """Number vertices so that all edges rise."""
    below = defaultdict(set)
    for _, low, high in edges.tolist():
        below[high].add(low)
    order = list(TopologicalSorter(below).static_order())
    return np.argsort(order)


def _labels(model: Model) -> Indices:
    """Label (p, 3, 3, 3) corners, middles of edges, of faces and of the patches so that glued ones are equal."""
    grids = np.arange(27 * len(model.patches)).reshape(-1, 3, 3, 3)
    by_name = dict(zip(model.patches, grids, strict=True))

    def on(face: Face) -> Indices:
        return np.take(by_name[face.patch], -face.side, axis=face.axis)

    pairs = [(on(pair.first), oriented(on(pair.second), pair.orientation)) for pair in model.glued]
    ends = np.array(pairs, dtype=np.int64).reshape(-1, 2, 9).swapaxes(0, 1).reshape(2, -1)
    links = coo_array((np.ones(ends.shape[1]), ends), shape=(grids.size, grids.size))
    return _numbered(connected_components(links, directed=False)[1].reshape(grids.shape))


def _numbered(labels: Indices) -> Indices:
    """Replace labels by numbers from 0 without gaps."""
    return np.unique(labels, return_inverse=True)[1].reshape(labels.shape).astype(np.int64)


def _check_told_apart(model: Model, labels: Indices) -> None:
    """Raise GeometryError where two edges, or two faces, have the same vertices: MFEM would take them for one."""
    along = [np.moveaxis(labels, 1 + axis, 1) for axis in range(3)]
    edges = [
        (grid[:, 1, ::2, ::2].reshape(-1), grid[:, ::2, ::2, ::2].transpose(0, 2, 3, 1).reshape(-1, 2))
        for grid in along
    ]
    faces = [(grid[:, ::2, 1, 1].reshape(-1), grid[:, ::2, ::2, ::2].reshape(-1, 4)) for grid in along]
    for what, cells in (("edges", edges), ("faces", faces)):
        own = np.concatenate([each for each, _ in cells])
        vertices = np.sort(np.concatenate([each for _, each in cells]), axis=1)
        _, first, kind = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
        other = first[kind.ravel()]
        wrong = (own != own[other]) | np.any(np.diff(vertices, axis=1) == 0, axis=1)
        if wrong.any():
            at = int(np.flatnonzero(wrong)[0])
            names = list(model.patches) * 3
            per_patch = len(own) // len(names)
            raise GeometryError(
                f"MFEM knows {what} by their corners, and those of patches "
                f'"{names[other[at] // per_patch]}" and "{names[at // per_patch]}" have the same ones: '
                "a ring takes three patches or more, split one"
            )


def _lines(model: Model, topology: Topology) -> Iterator[str]:
    """Yield the file, some lines at a time."""
    numbers = {name: number for number, name in enumerate(model.patches)}
    groups = outer_faces(model)
    yield "MFEM NURBS mesh v1.0\n\n# written by geom2iga"
    yield from (f"# element attribute {number}: {one_line(name)}" for number, name in enumerate(model.bodies, 1))
    yield from (f"# boundary attribute {number}: {name}" for number, name in enumerate(groups, 1))
    yield f"\ndimension\n3\n\nelements\n{len(numbers)}"
    bodies = {name: number for number, patches in enumerate(model.bodies.values(), 1) for name in patches}
    for name, vertices in zip(numbers, topology.vertices, strict=True):
        corners = [vertices[i, j, k] for k in range(2) for i, j in AROUND]
        yield _words(bodies[name], CUBE, *corners)
    yield f"\nboundary\n{sum(map(len, groups.values()))}"
    for attribute, faces in enumerate(groups.values(), 1):
        for face in faces:
            around = np.take(topology.vertices[numbers[face.patch]], face.side, axis=face.axis)
            yield _words(attribute, SQUARE, *(around[at] for at in AROUND[:: face.outward]))
    yield f"\nedges\n{len(topology.edges)}"
    yield from (_words(*edge) for edge in topology.edges.tolist())
    yield f"\nvertices\n{topology.vertices.max() + 1}\n\npatches"
    for patch in model.patches.values():
        yield from _patch_lines(normalised(patch))


def _patch_lines(patch: Patch) -> Iterator[str]:
    """Yield knots and control points of a patch, x y z w; the first direction runs fastest."""
    yield f"\n# {one_line(patch.name)}\nknotvectors\n3"
    for degree, count, knots in zip(patch.degrees, patch.shape, patch.knots, strict=True):
        yield f"{degree} {count} {rows(knots).strip()}"
    points = np.concatenate([patch.control_points, patch.weights[..., None]], axis=-1)
    yield f"dimension\n3\ncontrolpoints_cartesian\n{rows(points.reshape(-1, 4, order='F'))}"


def _words(*values: int) -> str:
    return " ".join(map(str, values))
