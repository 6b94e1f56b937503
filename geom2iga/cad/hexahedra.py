"""Transfinite hexahedral meshes of volumes of the open gmsh model, and how far points lie from its faces."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import gmsh
import numpy as np

from geom2iga.bspline import Array, Indices
from geom2iga.errors import GeometryError

HEXAHEDRON = 5  # gmsh's number of the linear hexahedron
OPTIONS = {  # what would turn the linear hexahedra into something else, or mesh more than was asked for
    "Mesh.ElementOrder": 1,
    "Mesh.FlexibleTransfinite": 0,
    "Mesh.MeshOnlyVisible": 1,
    "Mesh.SubdivisionAlgorithm": 0,
}


class HexahedralMesh(NamedTuple):
    """The mesh of one volume."""

    nodes: Array  # (n, 3) [length]
    hexahedra: Indices  # (m, 8) node numbers: four around the bottom, the four above them
    faces: Mapping[int, Indices]  # by gmsh tag: numbers of the nodes on a face and its edges


def mesh_volumes(tags: Sequence[int], cells: int) -> dict[int, HexahedralMesh]:
    """Mesh volumes of the open gmsh model by transfinite interpolation, with equal cells along each edge.

    Volumes that share a face share its nodes. Options and visibility are left as they were; a mesh and
    constraints on the mesh that the model had are lost.

    Parameters
    ----------
    cells : int
        Number of hexahedra along every edge.

    Returns
    -------
    dict
        By volume, cells³ linear hexahedra.

    Raises
    ------
    GeometryError
        A volume without six faces of four edges each, or of which gmsh made anything else.
    """
    for tag in tags:
        _check_block(tag)
    with _only(tags):
        for tag in tags:
            _constrain(tag, cells)
        reason = ""
        try:
            gmsh.model.mesh.generate(3)
        except Exception as error:  # gmsh raises nothing finer
            reason = f" ({str(error).strip()})"
        numbers, positions, _ = gmsh.model.mesh.getNodes()
        sequence = np.argsort(numbers)
        nodes = np.reshape(positions, (-1, 3))[sequence]
        return {tag: _read_mesh(tag, cells, numbers[sequence], nodes, reason) for tag in tags}


def distances(face: int, points: Array) -> Array:
    """Measure how far points (q, 3) lie from the surface of a face of the open gmsh model, (q,) [length]."""
    closest, _ = gmsh.model.getClosestPoint(2, face, points.ravel())
    return np.linalg.norm(np.reshape(closest, (-1, 3)) - points, axis=1)


@contextmanager
def _only(tags: Sequence[int]) -> Iterator[None]:
    """Let gmsh mesh only some volumes, anew and by our rules; clean up afterwards."""
    entities = gmsh.model.getEntities()
    visible = [gmsh.model.getVisibility(*entity) for entity in entities]
    options = {name: gmsh.option.getNumber(name) for name in OPTIONS}
    _forget_mesh(entities)
    try:
        for name, value in OPTIONS.items():
            gmsh.option.setNumber(name, value)
        gmsh.model.setVisibility(entities, 0)
        gmsh.model.setVisibility([(3, tag) for tag in tags], 1, recursive=True)
        yield
    finally:
        for name, value in options.items():
            gmsh.option.setNumber(name, value)
        for entity, value in zip(entities, visible, strict=True):
            gmsh.model.setVisibility([entity], value)
        _forget_mesh(entities)


def _forget_mesh(entities: Sequence[tuple[int, int]]) -> None:
    gmsh.model.mesh.clear()
    gmsh.model.mesh.removeConstraints(entities)


def _faces(tag: int) -> list[int]:
    return [face for _, face in gmsh.model.getBoundary([(3, tag)], combined=False, oriented=False)]


def _curves(face: int) -> list[int]:
    return [abs(curve) for _, curve in gmsh.model.getBoundary([(2, face)], combined=False, oriented=False)]


def _check_block(tag: int) -> None:
    """Raise GeometryError unless a volume has six faces with four edges each."""
    faces = _faces(tag)
    if len(faces) != 6:
        raise GeometryError(
            f"volume {tag} has {len(faces)} faces, a block has 6: split it (occ.fragment) or merge faces that continue "
            "each other"
        )
    for face in faces:
        curves = _curves(face)
        if len(set(curves)) < len(curves):
            raise GeometryError(f"volume {tag}: face {face} meets itself along a seam: split it there into blocks")
        if len(curves) != 4:
            raise GeometryError(
                f"volume {tag}: face {face} has {len(curves)} edges, a block face has 4: merge edges or split it"
            )


def _constrain(tag: int, cells: int) -> None:
    """Ask for a transfinite mesh: gmsh's own setTransfiniteAutomatic passes over volumes without a word."""
    for face in _faces(tag):
        for curve in _curves(face):
            gmsh.model.mesh.setTransfiniteCurve(curve, cells + 1)
        gmsh.model.mesh.setTransfiniteSurface(face)
        gmsh.model.mesh.setRecombine(2, face)
    gmsh.model.mesh.setTransfiniteVolume(tag)


def _read_mesh(tag: int, cells: int, numbers: Indices, nodes: Array, reason: str) -> HexahedralMesh:
    """Read the hexahedra of a volume, given all nodes by increasing gmsh number."""
    kinds, elements, corners = gmsh.model.mesh.getElements(3, tag)
    if list(kinds) != [HEXAHEDRON] or len(elements[0]) != cells**3:
        names = [gmsh.model.mesh.getElementProperties(kind)[0] for kind in kinds]
        made = ", ".join(f"{len(e)} {name}" for e, name in zip(elements, names, strict=True)) or "nothing"
        raise GeometryError(
            f"volume {tag}: gmsh cannot mesh it with {cells} x {cells} x {cells} hexahedra, it made {made}{reason}: "
            "split it into blocks"
        )
    used, hexahedra = np.unique(corners[0], return_inverse=True)
    on_face = {face: np.unique(gmsh.model.mesh.getNodes(2, face, includeBoundary=True)[0]) for face in _faces(tag)}
    return HexahedralMesh(
        nodes[np.searchsorted(numbers, used)],
        hexahedra.reshape(-1, 8).astype(np.int64),
        {face: np.searchsorted(used, found) for face, found in on_face.items()},
    )
