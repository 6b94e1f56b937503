"""From coarse patches to the mesh that a case asks for: degrees and spans, alike where patches meet."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from math import prod

import numpy as np

from geom2iga.body_case import Grading, Mesh, OnePatch
from geom2iga.bspline import Array, breaks, open_knots
from geom2iga.errors import CaseError
from geom2iga.glue import Edge, in_space, respaced
from geom2iga.model import Face, Glued
from geom2iga.patch import Patch, elevated, evaluate, refined
from geom2iga.spline import united

LENGTH_SAMPLES = 257  # points that measure the length of a line, between the breaks that a shape needs
LINES = (0.0, 0.25, 0.5, 0.75, 1.0)  # where in the other directions lengths are measured
MOST_SPANS = 10_000  # along one direction of a patch
MOST_POINTS = 100_000_000  # of a body: three gigabytes of coordinates and weights
LONGER = 1e-4  # by which a span may exceed the size asked for: what those points leave open


def meshed(
    patches: Sequence[Patch],
    glued: Sequence[Glued],
    mesh: Mesh,
    degrees: Sequence[int],
    faces: Mapping[str, Sequence[Face]],
) -> tuple[Patch, ...]:
    """Raise degrees and insert knots as a mesh asks for; the maps stay the same.

    Directions that glue ties together get the same knots: the most spans that any of their patches asks for.

    Parameters
    ----------
    patches : coarse volumes whose knots run from 0 to 1
    degrees : (3,)
        At least these; a shape may need more.
    faces : name to faces
        What the gradings of the mesh refer to.

    Raises
    ------
    CaseError
        A grading toward faces that do not exist, or toward both ends of one direction.
    """
    toward = _graded_ends(mesh.grading, faces)

    def choose(edges: list[Edge], degree: int, knots: Array) -> tuple[int, Array]:
        wanted = max(degree, *(degrees[edge.axis] for edge in edges))
        ratio = _ratio(edges, patches, toward)
        inner = _break_points(breaks(knots), edges, patches, mesh, ratio)
        return united([(degree, knots), (wanted, open_knots(inner, wanted))])

    spaces = respaced(patches, glued, choose)
    _check_size(spaces)
    return tuple(in_space(patch, wanted) for patch, wanted in zip(patches, spaces, strict=True))


def _check_size(spaces: Sequence[Sequence[tuple[int, Array]]]) -> None:
    """Raise CaseError where there would be too many control points to hold."""
    points = sum(prod(len(knots) - degree - 1 for degree, knots in each) for each in spaces)
    if points > MOST_POINTS:
        raise CaseError(f"the mesh asks for {points:.3g} control points, more than {MOST_POINTS:.0g}: take fewer spans")


def _graded_ends(gradings: Sequence[Grading], faces: Mapping[str, Sequence[Face]]) -> dict[Face, float]:
    """Find the faces at which spans are to be smallest, and by which ratio."""
    ends: dict[Face, float] = {}
    for grading in gradings:
        found = faces.get(grading.toward)
        if not found:
            raise CaseError(f'grading toward "{grading.toward}": there is no such face; known: {", ".join(faces)}')
        ends |= {face: grading.ratio for face in found}
    return ends


def _ratio(edges: Sequence[Edge], patches: Sequence[Patch], toward: Mapping[Face, float]) -> float:
    """Find the last span over the first along a class of directions, below 1 where its end is to be fine."""
    ratios = set()
    for edge in edges:
        for side in range(2):
            ratio = toward.get(Face(patches[edge.patch].name, edge.axis, side))
            if ratio is not None:
                ratios.add(ratio if side == edge.reversed else 1 / ratio)
    if len(ratios) > 1:
        raise CaseError("gradings lead toward both ends of one direction, or with two ratios: leave one of them")
    return ratios.pop() if ratios else 1.0


def _break_points(at: Array, edges: Sequence[Edge], patches: Sequence[Patch], mesh: Mesh, ratio: float) -> Array:
    """Cut the intervals between the breaks that a shape needs into spans."""
    if isinstance(mesh, OnePatch) and mesh.breaks is not None:
        return np.array(mesh.breaks[edges[0].axis])
    if mesh.span_size is None:
        return _graded(at, max((mesh.spans or (1, 1, 1))[edge.axis] for edge in edges), ratio)
    fine, arcs = _arc_lengths(at, edges, patches)
    found, spans = at, len(at) - 1
    while (longest := _longest(found, fine, arcs)) > mesh.span_size * (1 + LONGER):
        spans = max(spans + 1, int(min(spans * longest / mesh.span_size, MOST_SPANS + 1)))
        if spans > MOST_SPANS:
            raise CaseError(
                f"span_size = {mesh.span_size:g} asks for more than {MOST_SPANS} spans along an edge of length "
                f"{arcs[:, -1].max():.4g}: is it in the unit of length of the model?"
            )
        found = _graded(at, spans, ratio)
    return found


def _graded(at: Array, spans: int, ratio: float) -> Array:
    """Cut [0, 1] into spans that form a geometric sequence but for the given breaks, which stay; at least so many."""
    stretch = _stretch(ratio, spans)
    even = np.log1p(at * np.expm1(stretch)) / stretch if stretch else at
    counts = np.maximum(1, np.ceil(spans * np.diff(even) - 1e-9)).astype(int)
    each = zip(even[:-1], even[1:], counts, strict=True)
    flat = np.concatenate([*(np.linspace(low, high, n + 1)[:-1] for low, high, n in each), [1.0]])
    return np.expm1(flat * stretch) / np.expm1(stretch) if stretch else flat


def _stretch(ratio: float, spans: int) -> float:
    """Exponent of the map under which equal spans become a geometric sequence with a given last over first."""
    return float(np.log(ratio)) * spans / (spans - 1) if spans > 1 else 0.0


def _arc_lengths(at: Array, edges: Sequence[Edge], patches: Sequence[Patch]) -> tuple[Array, Array]:
    """Measure lines along a class of directions: parameters (m,), and the length up to each, (lines, m) [length]."""
    fine = np.unique(at[:-1, None] + np.diff(at)[:, None] * np.linspace(0, 1, LENGTH_SAMPLES))
    arcs = []
    for edge in edges:
        along = 1 - fine if edge.reversed else fine
        for across in product(LINES, LINES):
            xi = np.insert(np.tile(np.array(across), (len(along), 1)), edge.axis, along, axis=1)
            steps = np.linalg.norm(np.diff(evaluate(patches[edge.patch], xi)[0], axis=0), axis=1)
            arcs.append(np.concatenate([[0.0], np.cumsum(steps)]))
    return fine, np.array(arcs)


def _longest(at: Array, fine: Array, arcs: Array) -> float:
    """Find the longest piece of any line between breaks [length]."""
    return max(float(np.diff(np.interp(at, fine, arc)).max()) for arc in arcs)


def with_knots(patch: Patch, degrees: Sequence[int], wanted: Sequence[Array]) -> Patch:
    """Give a trilinear patch degrees and open knot vectors, whatever range these have."""
    ends = tuple(np.repeat(knots[[0, -1]], 2) for knots in wanted)
    coarse = elevated(replace(patch, knots=ends), degrees)
    return refined(coarse, knots=[knots[p + 1 : -p - 1] for knots, p in zip(wanted, degrees, strict=True)])
