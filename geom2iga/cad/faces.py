"""Faces of a CAD model as four-sided surface splines, whose edges are those that their neighbours have."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from geom2iga.bspline import Array, Indices, open_knots
from geom2iga.cad.brep import Elementary, Free, Trace
from geom2iga.cad.exact import distances, plane_curve, surface_spline
from geom2iga.cad.fit import fit, within
from geom2iga.cad.topology import CadFace, Edge, Topology
from geom2iga.coons import coons
from geom2iga.errors import GeometryError
from geom2iga.glue import MEETS
from geom2iga.patch import Patch
from geom2iga.progress import tracked
from geom2iga.projection import closest_points
from geom2iga.sphere import closing_angle, find_turns, spherical_patch
from geom2iga.spline import Spline, adapted, collocation, points_of, product, united

EXACT = 1e-12  # how far an exact surface may lie off its CAD face, in sizes of the model
ROUNDING = 4e-15  # how far rounding moves a point, in distances from the origin
SAME_PARAMETER = 1e-7  # how far an iso-line may deviate, in parameter ranges
HIGHEST_FACTOR = 4  # degree of the polynomials by which homogeneous forms of one curve may differ


class Quad(NamedTuple):
    """A four-sided face: corners (2, 2) and, per direction, the lower and the upper side as (edge, reversed)."""

    corners: Indices
    sides: tuple[tuple[tuple[int, bool], tuple[int, bool]], ...]


@dataclass(frozen=True, eq=False)
class FaceSpline:
    """A face as a homogeneous spline.

    Parameters
    ----------
    tag : int
    corners : (2, 2)
        Tags of the vertices.
    spline : Spline
    distance : float
        Largest distance of sample points from the CAD face's surface [length].
    fitted : bool
        Whether it is an approximation.
    edges_off : float
        Largest distance of the edges of a fitted face from its surface [length], 0 where they lie on it: what the CAD
        model itself is off.
    kind : str
        Of the surface.
    """

    tag: int
    corners: Indices
    spline: Spline
    distance: float
    fitted: bool
    edges_off: float
    kind: str


def convert_faces(topology: Topology, accuracy: float, exact: bool = True) -> dict[int, FaceSpline]:
    """Turn all faces of a model into splines; neighbours agree on their edges in homogeneous coordinates.

    Each face takes the first of these ways that fits:

    1. four iso-lines of its surface as edges: the rectangle between them;
    2. four circular arcs on a sphere: a biquartic patch;
    3. Coons interpolation of its edges, where that lies on the surface: all planes, oblique cuts of cylinders;
    4. a fit over the Coons interpolation that keeps the edges.

    Parameters
    ----------
    topology : Topology
        Faces with one loop of four edges.
    accuracy : float
        What a fit should reach, in sizes of the model.
    exact : bool
        Whether no face may be fitted.

    Raises
    ------
    GeometryError
        A face that no exact way reaches, where none may be fitted.
    """
    quads = {tag: find_quad(face, topology.edges) for tag, face in topology.faces.items()}
    rectangles = {tag: _iso_rectangle(face, quads[tag], topology) for tag, face in topology.faces.items()}
    spherical = [tag for tag, found in rectangles.items() if found is None and _on_sphere(topology, tag)]
    arcs = {tag: _arcs(topology, quads[tag]) for tag in spherical}
    turns = _find_turns(topology, quads, arcs)
    edges = {tag: _turned(_normalised(edge.curve), turns.get(tag, 0.0)) for tag, edge in topology.edges.items()}
    result = {}
    for tag, quad in tracked(quads.items(), "faces"):
        sides = [(_along(edges, low), _along(edges, high)) for low, high in quad.sides]
        face = topology.faces[tag]
        spline = None
        if tag in arcs and turns:
            spline = _sphere(arcs[tag], face, [turns[edge] for edge in _bottom_first(quad)], sides)
        elif (rectangle := rectangles[tag]) is not None:
            spline = _with_edges(rectangle, sides, topology.size)
        result[tag] = _finished(face, quad, sides, spline, topology.size, accuracy)
        if exact and result[tag].fitted:
            raise _inexact(result[tag])
    return result


def _inexact(face: FaceSpline) -> GeometryError:
    own = f" (its edges by {face.edges_off:.2g} in the CAD model itself)" if face.edges_off > 0 else ""
    return GeometryError(
        f"face {face.tag}, a trimmed {face.kind}, was fitted: off by {face.distance:.2g}{own}; accept that "
        "with exact = false, or cut the volume along lines of constant parameter"
    )


def _finished(face: CadFace, quad: Quad, sides: Any, spline: Spline | None, size: float, accuracy: float) -> FaceSpline:
    """Take the spline of a face, or the Coons interpolation of its sides, or a fit over that; measure its distance."""
    exact = EXACT * size + ROUNDING * float(np.abs(points_of(sides[0][0].coefficients)).max())
    if spline is None:
        spline = coons(sides)
    distance = distance_from(face, spline)
    edges_off = 0.0
    fitted = distance > exact
    if fitted:
        spline = fit(spline, lambda points: _nearest(face, points), accuracy * size)
        distance = distance_from(face, spline)
        off = max(distance_from(face, side) for pair in sides for side in pair)
        edges_off = off if off > exact else 0.0
    return FaceSpline(face.tag, quad.corners, spline, distance, fitted, edges_off, face.surface.kind)


def _sphere(arcs: list[Patch], face: CadFace, turns: list[float], sides: Any) -> Spline | None:
    """Span a patch on a sphere; None where it is too large for one."""
    try:
        patch = spherical_patch(arcs, *_ball(face), turns)
    except GeometryError:
        return None
    return _sewn(Spline(patch.degrees, patch.knots, patch.homogeneous), sides)


def find_quad(face: CadFace, edges: Mapping[int, Edge]) -> Quad:
    """Run around a face of four edges from one of its corners."""
    remaining = list(face.edges)
    first = remaining.pop(0)
    start, corner = edges[first].ends
    around = [start, corner]
    chain = [(first, False)]
    while remaining:
        following = next((tag for tag in remaining if corner in edges[tag].ends), None)
        if following is None:
            break
        remaining.remove(following)
        one, other = edges[following].ends
        chain.append((following, corner != one))
        corner = other if corner == one else one
        around.append(corner)
    if len(chain) != 4 or around[4] != start or len(set(around[:4])) != 4:
        raise GeometryError(f"face {face.tag}: its four edges do not run around it once: split it")
    a, b, c, d = around[:4]  # u from a to b, v from a to d
    bottom, right, (top, top_turned), (left, left_turned) = chain
    sides = (((left, not left_turned), right), (bottom, (top, not top_turned)))
    return Quad(np.array([[a, d], [b, c]]), sides)


def _along(edges: Mapping[int, Spline], side: tuple[int, bool]) -> Spline:
    """Take an edge in the sense of a side."""
    edge, turned = side
    return edges[edge].backwards(0) if turned else edges[edge]


def _bottom_first(quad: Quad) -> list[int]:
    """Edges at v = 0, v = 1, u = 0, u = 1."""
    (left, right), (bottom, top) = quad.sides
    return [bottom[0], top[0], left[0], right[0]]


def _normalised(curve: Spline) -> Spline:
    """Let the weights at the ends of a curve be 1: multiply by a linear polynomial, a constant where they are equal."""
    return _scaled(curve, 1 / curve.corners[..., 3])


def _scaled(spline: Spline, factors: Array) -> Spline:
    """Multiply by the polynomial, linear in each direction, with given values (2, ...) at the corners."""
    if np.ptp(factors) <= 1e-14 * np.abs(factors).max():
        return Spline(spline.degrees, spline.knots, spline.coefficients * factors.flat[0])
    count = len(spline.degrees)
    return product(spline, Spline((1,) * count, (open_knots([0, 1], 1),) * count, factors[..., None]))


def _turned(curve: Spline, turn: float) -> Spline:
    """Multiply an edge of a face on a sphere by the quadratic 1, cos(turn), 1."""
    if turn == 0.0:
        return curve
    return product(curve, Spline((2,), (open_knots([0, 1], 2),), np.array([[1], [np.cos(turn)], [1]])))


def _find_turns(topology: Topology, quads: Mapping[int, Quad], arcs: Mapping[int, list[Patch]]) -> dict[int, float]:
    """Find the turns of edges that close the faces on spheres; none where they do not close all at once."""
    if not arcs:
        return {}
    try:
        angles = [closing_angle(arcs[tag], *_ball(topology.faces[tag])) for tag in arcs]
        return dict(find_turns([_bottom_first(quads[tag]) for tag in arcs], angles))  # type: ignore[arg-type]
    except GeometryError:
        return {}


def _on_sphere(topology: Topology, tag: int) -> bool:
    """Whether a face lies on a sphere between four arcs short enough for one piece."""
    face = topology.faces[tag]
    edges = [topology.edges[edge] for edge in face.edges]
    return face.surface.kind == "sphere" and all(e.kind == "circle" and len(e.curve.coefficients) == 3 for e in edges)


def _arcs(topology: Topology, quad: Quad) -> list[Patch]:
    """Edges of a face at v = 0, v = 1, u = 0, u = 1 as patches of one direction."""
    curves = {tag: edge.curve for tag, edge in topology.edges.items()}
    (left, right), (bottom, top) = quad.sides
    return [_along(curves, side).patch(f"edge {side[0]}") for side in (bottom, top, left, right)]


def _ball(face: CadFace) -> tuple[Array, float]:
    """Centre and radius of a face on a sphere."""
    sphere = face.surface
    assert isinstance(sphere, Elementary)
    return face.matrix[:, :3] @ sphere.vectors[0] + face.matrix[:, 3], sphere.numbers[0]


def _iso_rectangle(face: CadFace, quad: Quad, topology: Topology) -> Spline | None:
    """Cut out of the surface of a face what lies between four iso-lines; None where its edges are none."""
    lines = [_iso_line(face.traces.get(edge)) for edge in face.edges]
    ranges = np.empty((2, 2))
    for axis in range(2):
        values = [value for fixed, value in filter(None, lines) if fixed == axis]
        if len(values) != 2 or abs(values[0] - values[1]) <= SAME_PARAMETER:
            return None
        ranges[axis] = min(values), max(values)
    try:
        spline = surface_spline(face.surface, ranges).moved(face.matrix)
    except GeometryError as error:
        raise GeometryError(f"face {face.tag}: {error}") from None
    spline = _scaled(spline, 1 / spline.corners[..., 3])
    wanted = np.array([[topology.vertices[tag] for tag in row] for row in quad.corners])
    turned = [spline.oriented(orientation) for orientation in range(8)]
    errors = [np.abs(points_of(each.corners) - wanted).max() for each in turned]
    return turned[int(np.argmin(errors))] if min(errors) <= MEETS * topology.size else None


def _iso_line(trace: Trace | None) -> tuple[int, float] | None:
    """Find which parameter is constant along an edge, and its value."""
    if trace is None:
        return None
    points = _plane_points(trace)
    spread = np.ptp(points, axis=0)
    fixed = int(np.argmin(spread))
    return (fixed, float(points[0, fixed])) if spread[fixed] <= SAME_PARAMETER * spread.max() else None


def _with_edges(spline: Spline, sides: Any, size: float) -> Spline | None:
    """Multiply a surface so that its sides are the given ones; None where they run at other parameters.

    One curve at the same parameters can have several homogeneous forms, which differ by a polynomial factor. The
    factors of the four sides are blended over the face.
    """
    factors = []
    for axis, pair in enumerate(sides):
        found = [_factor(spline.end(axis, side), wanted, size) for side, wanted in enumerate(pair)]
        if found[0] is None or found[1] is None:
            return None
        factors.append((found[0], found[1]))
    if any(np.ptp(factor.coefficients) > EXACT for pair in factors for factor in pair):
        spline = product(spline, coons(factors))
    return _sewn(spline, sides)


def _sewn(spline: Spline, sides: Any) -> Spline:
    """Write a surface in a space that holds its sides, and take these over to the last digit."""
    spaces = []
    for axis in range(2):
        across = sides[1 - axis]
        spaces.append(
            united([(s.degrees[0], s.knots[0]) for s in across] + [(spline.degrees[axis], spline.knots[axis])])
        )
    spline = adapted(spline, spaces)
    for axis, pair in enumerate(sides):
        for side, curve in enumerate(pair):
            edge = adapted(curve, [spaces[1 - axis]]).coefficients
            np.moveaxis(spline.coefficients, axis, 0)[-side] = edge
    return spline


def _factor(found: Spline, wanted: Spline, size: float) -> Spline | None:
    """Find the polynomial by which one homogeneous form of a curve differs from another; None where there is none."""
    at = (1 - np.cos(np.linspace(0, np.pi, 33))) / 2
    ours, theirs = found.at(at), wanted.at(at)
    if np.abs(points_of(ours) - points_of(theirs)).max() > MEETS * size:
        return None
    ratio = theirs[:, 3] / ours[:, 3]
    for degree in range(1, HIGHEST_FACTOR + 1):
        knots = np.repeat([0.0, 1.0], degree + 1)
        functions = collocation(knots, degree, at).toarray()
        coefficients = np.linalg.lstsq(functions, ratio, rcond=None)[0]
        if np.abs(functions @ coefficients - ratio).max() <= EXACT:
            return Spline((degree,), (knots,), coefficients[:, None])
    return None


def distance_from(face: CadFace, spline: Spline) -> float:
    """Measure the largest distance of sample points of a homogeneous spline from the surface of a face [length]."""
    back = np.linalg.inv(face.matrix[:, :3])
    scale = float(np.cbrt(abs(np.linalg.det(face.matrix[:, :3]))))
    points = points_of(spline.at(*[within(knots) for knots in spline.knots])).reshape(-1, 3)
    return scale * float(distances(face.surface, (points - face.matrix[:, 3]) @ back.T, _ranges(face)).max())


def _nearest(face: CadFace, points: Array) -> Array:
    """Find the closest points (q, 3) of the surface of a face."""
    surface = surface_spline(face.surface, _ranges(face)).moved(face.matrix)
    return closest_points(surface.patch(f"face {face.tag}"), points).points


def _ranges(face: CadFace) -> Array:
    """Find a rectangle (2, 2) of parameters that holds a face."""
    points = [_plane_points(trace) for trace in face.traces.values()]
    if not points:
        return np.array([[0.0, 1], [0, 1]])
    low, high = np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)
    if not isinstance(face.surface, Free):
        return np.stack([low, high], axis=1)
    ends = np.array([[knots[0], knots[-1]] for knots in face.surface.knots])
    inside = np.stack([np.maximum(low, ends[:, 0]), np.minimum(high, ends[:, 1])], axis=1)
    return np.where(np.array(face.surface.periodic)[:, None], np.stack([low, high], axis=1), inside)


def _plane_points(trace: Trace) -> Array:
    """Points (n, 2) whose hull holds an edge in the parameter plane."""
    if isinstance(trace.curve, Elementary) and trace.curve.kind == "line":
        return trace.curve.vectors[0] + np.outer(trace.range, trace.curve.vectors[1])
    curve = plane_curve(trace.curve, *trace.range)
    return curve.coefficients[:, :-1] / curve.coefficients[:, -1:]
