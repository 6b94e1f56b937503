"""Volumes of a CAD model with six four-sided faces to patches."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from geom2iga.bspline import Array, Indices
from geom2iga.cad.faces import FaceSpline
from geom2iga.cad.topology import CadFace, Solid, Topology
from geom2iga.coons import coons
from geom2iga.errors import GeometryError
from geom2iga.model import oriented
from geom2iga.spline import Spline, points_of


@dataclass(frozen=True, eq=False)
class Hexahedron:
    """A volume whose boundary is combinatorially that of a cube.

    Parameters
    ----------
    tag : int
    corners : (2, 2, 2)
        Tags of the vertices, one of the 48 ways to run three directions through it.
    faces : (3, 2)
        Tags of the faces at the lower and the upper end of each direction.
    """

    tag: int
    corners: Indices
    faces: Indices


def check_block(topology: Topology, solid: Solid) -> None:
    """Raise GeometryError, with what to do, unless a volume has six faces of four edges each.

    Seams, poles, holes and cavities are named first: they are what makes the number of faces another one.
    """
    where = f"volume {solid.tag}"
    if len(solid.shells) != 1:
        raise GeometryError(
            f"{where} has {len(solid.shells)} shells (an inner cavity): split it into blocks around it (occ.fragment)"
        )
    faces = [topology.faces[tag] for tag in solid.faces]
    for face in faces:
        _check_loops(where, face, topology)
    if len(faces) != 6:
        hint = _split_by_seam(faces)
        number = "1 face" if len(faces) == 1 else f"{len(faces)} faces"
        raise GeometryError(f"{where} has {number}, a block has 6: split it (occ.fragment){hint}")
    for face in faces:
        if len(face.edges) != 4:
            verb = "merge or split" if len(face.edges) > 4 else "split the volume"
            raise GeometryError(f"{where}: face {face.tag} has {len(face.edges)} edges, a block face has 4: {verb}")


def _check_loops(where: str, face: CadFace, topology: Topology) -> None:
    """Raise GeometryError where a face has a hole, a seam or a pole."""
    name, kind = f"{where}: face {face.tag}", face.surface.kind
    poles = [edge for edge in face.edges if topology.edges[edge].kind == "pole"]
    edges = [edge for edge in face.edges if edge not in poles]
    if len(set(edges)) < len(edges) and kind == "plane":
        inner = next(edge for edge in edges if edges.count(edge) > 1)
        raise GeometryError(f"{name} meets itself along edge {inner}, which lies inside it: remove that edge")
    if len(set(edges)) < len(edges):
        pole = " and holds a pole" if poles else ""
        raise GeometryError(
            f"{name} meets itself along a seam{pole}: rotate the {kind} so that the seam lies on a cut, and cut it "
            "into four-sided pieces (occ.fragment)"
        )
    if poles:
        shape = "triangle" if len(edges) == 3 else f"{kind} of {len(edges)} edges"
        raise GeometryError(f"{name} is a {shape} with a pole: split the octant into 4 blocks or rotate the {kind}")
    if len(face.loops) != 1:
        raise GeometryError(f"{name} has {len(face.loops)} loops (a hole): split the volume around it (occ.fragment)")


def _split_by_seam(faces: list[CadFace]) -> str:
    """Name two neighbouring faces that lie on one cylinder or the like."""
    for number, face in enumerate(faces):
        for other in faces[number + 1 :]:
            if (
                face.surface is other.surface
                and face.surface.kind not in ("plane", "Bezier", "B-spline")
                and np.array_equal(face.matrix, other.matrix)
            ):
                return f"; faces {face.tag} and {other.tag} lie on one {face.surface.kind}: remove its seam"
    return ""


def labellings(topology: Topology, solid: Solid) -> Iterator[Hexahedron]:
    """Yield the 48 ways to run three directions through a hexahedron.

    Raises
    ------
    GeometryError
        Its six faces do not bound a hexahedron.
    """
    neighbours: dict[int, set[int]] = {}
    for tag in {edge for face in solid.faces for edge in topology.faces[face].edges}:
        start, end = topology.edges[tag].ends
        neighbours.setdefault(start, set()).add(end)
        neighbours.setdefault(end, set()).add(start)
    around = {
        frozenset(v for e in topology.faces[tag].edges for v in topology.edges[e].ends): tag for tag in solid.faces
    }
    if sorted(map(len, neighbours.values())) != [3] * 8 or sorted(map(len, around)) != [4] * 6:
        raise GeometryError(f"volume {solid.tag}: its six faces do not bound a hexahedron: split it into blocks")
    for origin, beside in neighbours.items():
        for u, v, w in permutations(sorted(beside)):
            yield _labelled(solid, neighbours, around, origin, (u, v, w))


def _labelled(
    solid: Solid,
    neighbours: Mapping[int, set[int]],
    around: Mapping[frozenset[int], int],
    origin: int,
    next_to: tuple[int, int, int],
) -> Hexahedron:
    """Run the three directions from a corner to its three neighbours."""
    u, v, w = next_to
    uv, vw, uw = (_opposite(around, origin, a, b) for a, b in ((u, v), (v, w), (u, w)))
    far = next(iter(set(neighbours) - {origin, u, v, w, uv, vw, uw}))
    corners = np.array([[[origin, w], [v, vw]], [[u, uw], [uv, far]]])
    try:
        faces = [
            [around[frozenset(np.take(corners, side, axis=axis).ravel().tolist())] for side in range(2)]
            for axis in range(3)
        ]
    except KeyError:
        raise GeometryError(
            f"volume {solid.tag}: its six faces do not bound a hexahedron: split it into blocks"
        ) from None
    return Hexahedron(solid.tag, corners, np.array(faces))


def _opposite(around: Mapping[frozenset[int], int], origin: int, a: int, b: int) -> int:
    """Find the fourth corner of the face that holds `origin` between its neighbours a and b."""
    face = next(corners for corners in around if {origin, a, b} <= corners)
    return next(iter(face - {origin, a, b}))


def block_spline(
    topology: Topology, solid: Solid, faces: Mapping[int, FaceSpline], axes: Array
) -> tuple[Spline, Indices]:
    """Blend the faces of a hexahedral volume.

    Parameters
    ----------
    axes : (3, 3)
        Rows: where the three parametric directions should point as nearly as may be.

    Returns
    -------
    spline : Spline
        Right-handed, in homogeneous coordinates.
    faces : (3, 2)
        Tags of the faces at the lower and the upper end of each direction.
    """
    ways = sorted(labellings(topology, solid), key=lambda way: -_alignment(topology, way, axes))
    spline = _blended(ways[0], faces)
    if signed_volume(spline) > 0:
        return spline, ways[0].faces
    turned = next(way for way in ways if _handedness(way, ways[0]) < 0)
    return _blended(turned, faces), turned.faces


def _alignment(topology: Topology, way: Hexahedron, axes: Array) -> float:
    """Sum of the cosines between the mean edges of each direction and the wanted axes."""
    corners = np.array([topology.vertices[tag] for tag in way.corners.ravel().tolist()]).reshape(2, 2, 2, 3)
    edges = np.array([np.diff(corners, axis=d).reshape(-1, 3).mean(axis=0) for d in range(3)])
    lengths = np.linalg.norm(edges, axis=1, keepdims=True)
    return round(float(np.sum(edges / np.where(lengths > 0, lengths, 1) * axes)), 9)


def _handedness(way: Hexahedron, other: Hexahedron) -> int:
    """Tell whether two ways through a hexahedron are of the same (1) or of opposite (-1) handedness."""
    place = {int(tag): np.array(index) * 2 - 1 for index, tag in np.ndenumerate(other.corners)}
    origin = place[int(way.corners[0, 0, 0])]
    steps = [place[int(way.corners[index])] - origin for index in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    return int(np.sign(round(float(np.linalg.det(np.array(steps))))))


def _blended(way: Hexahedron, faces: Mapping[int, FaceSpline]) -> Spline:
    """Turn each face to where it is needed and blend the six."""
    sides = []
    for axis in range(3):
        pair = []
        for side in range(2):
            face = faces[int(way.faces[axis, side])]
            wanted = np.take(way.corners, side, axis=axis)
            turn = next(o for o in range(8) if np.array_equal(oriented(face.corners, o), wanted))
            pair.append(face.spline.oriented(turn))
        sides.append((pair[0], pair[1]))
    return coons(sides)


def signed_volume(spline: Spline) -> float:
    """Estimate the volume of a homogeneous spline, negative where it is left-handed [length³]."""
    at = np.linspace(0, 1, 5)
    points = points_of(spline.at(at, at, at))
    edges = [np.diff(points, axis=d) for d in range(3)]
    along = [edges[0][:, :-1, :-1], edges[1][:-1, :, :-1], edges[2][:-1, :-1]]
    return float(np.einsum("abci,abci->", np.cross(along[0], along[1]), along[2]))
