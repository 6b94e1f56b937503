"""What bounds what in a CAD model: solids, faces, edges and vertices by their gmsh tags."""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from geom2iga.bspline import Array
from geom2iga.cad.brep import Brep, Location, Trace, Use, combined, read_brep
from geom2iga.cad.exact import Record, curve_spline, plane_curve, straight, surface_spline
from geom2iga.errors import GeometryError
from geom2iga.glue import MEETS, clusters
from geom2iga.spline import Spline, points_of

ENTITY = re.compile(r'name="([0-3]:\d+)" reference="(\d+)"')


@dataclass(frozen=True, eq=False)
class Edge:
    """An edge of a CAD model.

    Parameters
    ----------
    tag : int
        Of gmsh.
    ends : (2,)
        Tags of its vertices, in the sense of the curve.
    curve : Spline
        Exact, in homogeneous coordinates.
    kind : str
        Of the curve; "pole" where the edge is a mere point.
    """

    tag: int
    ends: tuple[int, int]
    curve: Spline
    kind: str


@dataclass(frozen=True, eq=False)
class CadFace:
    """A face of a CAD model.

    Parameters
    ----------
    tag : int
    surface : Record
    matrix : (3, 4)
        Where the surface is put.
    loops : tuple of loops
        Tags of the edges around it; a hole is another loop, a seam stands twice.
    traces : edge tag to Trace
        The edges in the parameter plane, where the model gives them.
    """

    tag: int
    surface: Record
    matrix: Array
    loops: tuple[tuple[int, ...], ...]
    traces: Mapping[int, Trace]

    @property
    def edges(self) -> tuple[int, ...]:
        """Tags of all its edges."""
        return tuple(edge for loop in self.loops for edge in loop)


@dataclass(frozen=True, eq=False)
class Solid:
    """A volume of a CAD model: per shell the tags of its faces."""

    tag: int
    shells: tuple[tuple[int, ...], ...]

    @property
    def faces(self) -> tuple[int, ...]:
        """Tags of all its faces."""
        return tuple(face for shell in self.shells for face in shell)


@dataclass(frozen=True, eq=False)
class Topology:
    """Solids, faces and edges by tag, and the positions (3,) of the vertices."""

    vertices: Mapping[int, Array]
    edges: Mapping[int, Edge]
    faces: Mapping[int, CadFace]
    solids: Mapping[int, Solid]

    @property
    def size(self) -> float:
        """Largest extent along x, y or z [length]."""
        return float(np.ptp(np.array(list(self.vertices.values())), axis=0).max()) if self.vertices else 0.0


def read_topology(xao: str) -> Topology:
    """Read a model from the text of an XAO file whose entities are named by dimension and tag, such as "2:7".

    Raises
    ------
    GeometryError
        The boundary representation in it cannot be read, or holds an offset curve.
    """
    text, rest = split_xao(xao)
    entities = rest.partition("<groups")[0]  # users' names follow there, and gmsh does not escape them: no XML parser
    names = {int(number): name for name, number in ENTITY.findall(entities)}
    return _Reader(read_brep(text), names).topology()


def split_xao(xao: str) -> tuple[str, str]:
    """Take the boundary representation out of the text of an XAO file; return it, and what follows it."""
    text, _, rest = xao.partition("<![CDATA[")[2].partition("]]>")
    return text, rest


Key = tuple[int, Location]  # a shape in its place, however it is turned


class _Reader:
    """Walks through the shapes of a boundary representation."""

    def __init__(self, brep: Brep, names: Mapping[int, str]) -> None:
        self.brep = brep
        numbered = dict(enumerate(self.walk(brep.root, ()), start=1))
        self.tags: dict[Key, int] = {}
        self.found: dict[int, dict[int, Key]] = {dimension: {} for dimension in range(4)}
        for number, name in names.items():
            dimension, _, tag = name.partition(":")
            self.tags[numbered[number]] = int(tag)
            self.found[int(dimension)][int(tag)] = numbered[number]

    def walk(self, root: Use, seen_from: Location) -> Iterator[Key]:
        """Yield every shape once, before what it consists of: OpenCASCADE's numbering."""
        seen: set[Key] = set()
        waiting = [(root.shape, combined(seen_from, root.location))]
        while waiting:
            key = waiting.pop()
            if key in seen:
                continue
            seen.add(key)
            yield key
            waiting.extend(child for child, _ in reversed(list(self.children(key))))

    def children(self, key: Key) -> Iterator[tuple[Key, bool]]:
        """Yield what a shape consists of, and whether it is turned around in it."""
        number, location = key
        for use in self.brep.shapes[number].children:
            yield (use.shape, combined(location, use.location)), use.reversed

    def topology(self) -> Topology:
        vertices = {tag: self.position(key) for tag, key in self.found[0].items()}
        edges = {tag: self.edge(tag, key) for tag, key in self.found[1].items()}
        faces = {tag: self.face(tag, key) for tag, key in self.found[2].items()}
        solids = {}
        for tag, key in self.found[3].items():
            shells = [tuple(self.tags[face] for face, _ in self.children(shell)) for shell, _ in self.children(key)]
            solids[tag] = Solid(tag, tuple(shells))
        return Topology(vertices, edges, faces, solids)

    def position(self, key: Key) -> Array:
        matrix = self.brep.matrix(key[1])
        return matrix @ [*self.brep.shapes[key[0]].point, 1.0]

    def edge(self, tag: int, key: Key) -> Edge:
        shape = self.brep.shapes[key[0]]
        ends = {turned: self.tags[vertex] for vertex, turned in self.children(key)}
        start, end = ends.get(False, ends.get(True, 0)), ends.get(True, ends.get(False, 0))
        trace = next((trace for trace in shape.traces if not trace.surface and trace.curve is not None), None)
        if shape.degenerate or trace is None:
            point = self.position(self.found[0][start])
            return Edge(tag, (start, end), straight(point, point), "pole")
        try:
            curve = curve_spline(trace.curve, *trace.range)
        except GeometryError as error:
            raise GeometryError(f"edge {tag}: {error}") from None
        return Edge(
            tag, (start, end), curve.moved(self.brep.matrix(combined(key[1], trace.location))), trace.curve.kind
        )

    def face(self, tag: int, key: Key) -> CadFace:
        shape = self.brep.shapes[key[0]]
        loops, traces = [], {}
        for wire, _ in self.children(key):
            around = [edge for edge, _ in self.children(wire)]
            loops.append(tuple(self.tags[edge] for edge in around))
            for edge in around:
                for trace in self.brep.shapes[edge[0]].traces:
                    if trace.surface == shape.surface and self.same_place(key, shape.location, edge, trace.location):
                        traces[self.tags[edge]] = trace
        matrix = self.brep.matrix(combined(key[1], shape.location))
        return CadFace(tag, self.brep.surfaces[shape.surface], matrix, tuple(loops), _on_one_side(traces))

    def same_place(self, face: Key, on_face: Location, edge: Key, on_edge: Location) -> bool:
        """Whether a trace belongs to the surface of a face where that lies."""
        return combined(face[1], on_face) == combined(edge[1], on_edge)


def _on_one_side(traces: Mapping[int, Trace]) -> dict[int, Trace]:
    """Choose for an edge on the seam of a closed surface the trace that the traces beside it lead to."""
    ends = {tag: _plane_ends(trace) for tag, trace in traces.items()}
    chosen = {}
    for tag, trace in traces.items():
        beside = [other for other, around in traces.items() if other != tag and around.other is None]
        if trace.other is not None and beside:
            turned = trace._replace(curve=trace.other)
            places = np.concatenate([ends[other] for other in beside])
            apart = [_farthest(_plane_ends(each), places) for each in (trace, turned)]
            trace = trace if apart[0] <= apart[1] else turned
        chosen[tag] = trace
    return chosen


def _plane_ends(trace: Trace) -> Array:
    """Ends (2, 2) of an edge in the parameter plane."""
    curve = plane_curve(trace.curve, *trace.range)
    return curve.coefficients[[0, -1], :-1] / curve.coefficients[[0, -1], -1:]


def _farthest(points: Array, places: Array) -> float:
    """Largest distance of points (n, 2) from the nearest of some places (m, 2)."""
    return float(np.linalg.norm(points[:, None] - places, axis=2).min(axis=1).max())


def merged(topology: Topology, solids: Mapping[int, Solid]) -> Topology:
    """Let solids share vertices, edges and faces that coincide: a STEP file writes them once per solid.

    Vertices are one where they lie within OpenCASCADE's tolerance; edges with the same ends, faces with the same
    edges where their middles do, too.
    """
    faces = {tag: topology.faces[tag] for solid in solids.values() for tag in solid.faces}
    edges = {tag: topology.edges[tag] for face in faces.values() for tag in face.edges}
    vertices = {tag: topology.vertices[tag] for edge in edges.values() for tag in edge.ends}
    reach = MEETS * float(np.ptp(np.array(list(vertices.values())), axis=0).max())
    vertex = _representatives(vertices, reach)
    edges = {tag: replace(edge, ends=(vertex[edge.ends[0]], vertex[edge.ends[1]])) for tag, edge in edges.items()}
    middles = {tag: points_of(edge.curve.at(np.array([0.5])))[0] for tag, edge in edges.items()}
    same_middle = _representatives(middles, reach)
    one_edge = _first_of({tag: (frozenset(edge.ends), same_middle[tag]) for tag, edge in edges.items()})
    faces = {
        tag: replace(
            face,
            loops=tuple(tuple(one_edge[edge] for edge in loop) for loop in face.loops),
            traces={one_edge[edge]: trace for edge, trace in face.traces.items()},
        )
        for tag, face in faces.items()
    }
    one_face = _same_faces(faces, reach)
    shared = {
        tag: Solid(tag, tuple(tuple(one_face[face] for face in shell) for shell in solid.shells))
        for tag, solid in solids.items()
    }
    return Topology(vertices, edges, faces, shared)


def _same_faces(faces: Mapping[int, CadFace], reach: float) -> dict[int, int]:
    """Choose one tag for all faces with the same edges and the same middle: two surfaces may share all their edges."""
    chosen: dict[int, int] = {}
    alike: dict[object, list[int]] = defaultdict(list)
    for tag, face in faces.items():
        known = alike[frozenset(face.edges), face.surface.kind]
        middle = _middle(face) if known else None
        same = (other for other in known if middle is not None and _is_near(middle, _middle(faces[other]), reach))
        chosen[tag] = next(same, tag)
        if chosen[tag] == tag:
            known.append(tag)
    return chosen


def _is_near(point: Array, other: Array | None, reach: float) -> bool:
    return other is not None and float(np.linalg.norm(point - other)) <= reach


def _middle(face: CadFace) -> Array | None:
    """Point (3,) in the middle of the parameters of a face; None where no spline can represent its surface.

    Of a plane, which its edges determine, the origin.
    """
    if face.surface.kind == "plane":
        return np.zeros(3)
    places = np.concatenate([_plane_ends(trace) for trace in face.traces.values()] or [np.array([[0.0, 0], [1, 1]])])
    try:
        surface = surface_spline(face.surface, np.array([places.min(axis=0), places.max(axis=0)]).T)
    except GeometryError:
        return None
    return points_of(surface.moved(face.matrix).at(np.array([0.5]), np.array([0.5])))[0, 0]


def _representatives(points: Mapping[int, Array], reach: float) -> dict[int, int]:
    """Choose one tag for all that lie within reach of each other."""
    labels = clusters(np.array(list(points.values())), reach)
    return _first_of(dict(zip(points, labels.tolist(), strict=True)))


def _first_of(keys: Mapping[int, object]) -> dict[int, int]:
    """Choose for each tag the first one with an equal key."""
    first: dict[object, int] = {}
    return {tag: first.setdefault(key, tag) for tag, key in keys.items()}
