"""From coarse patches to the mesh that a case asks for: degrees and spans, alike where patches meet."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from math import prod
from typing import NamedTuple

import numpy as np

from geom2iga.body_case import Grading, Mesh, OnePatch
from geom2iga.bspline import Array, breaks, open_knots
from geom2iga.errors import CaseError
from geom2iga.glue import Edge, in_space, respaced
from geom2iga.limits import check_memory
from geom2iga.model import Face, Glued
from geom2iga.patch import Patch, elevated, evaluate, refined
from geom2iga.spline import united

LENGTH_SAMPLES = 257  # points that measure the length of a line, between the breaks that a shape needs
LINES = (0.0, 0.25, 0.5, 0.75, 1.0)  # where in the other directions lengths are measured
MOST_SPANS = 10_000  # along one direction of a patch
MOST_POINTS = 100_000_000  # of a body: three gigabytes of coordinates and weights
CONTROL_POINT = 100  # bytes of a control point while it is made: 82 to 94 on blocks of degree 1, 2, 4, a pipe, a sphere
LONGER = 1e-4  # by which a span may exceed the size asked for: what those points leave open


class Growth(NamedTuple):
    """How spans grow from the faces where they are smallest."""

    ratio: float  # largest over smallest
    equal: int  # so many next to the faces are of one size


Ends = tuple[Growth | None, Growth | None]  # of the beginning and of the end of a direction


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
        A grading toward faces that do not exist, or two different ones toward one end of a direction.
    """
    toward = _graded_faces(mesh.grading, faces)

    def choose(edges: list[Edge], degree: int, knots: Array) -> tuple[int, Array]:
        wanted = max(degree, *(degrees[edge.axis] for edge in edges))
        ends = _ends(edges, patches, toward)
        inner = _break_points(breaks(knots), edges, patches, mesh, ends)
        return united([(degree, knots), (wanted, open_knots(inner, wanted))])

    spaces = respaced(patches, glued, choose)
    _check_size(spaces)
    return tuple(in_space(patch, wanted) for patch, wanted in zip(patches, spaces, strict=True))


def _check_size(spaces: Sequence[Sequence[tuple[int, Array]]]) -> None:
    """Raise CaseError where there would be too many control points to hold."""
    points = sum(prod(len(knots) - degree - 1 for degree, knots in each) for each in spaces)
    if points > MOST_POINTS:
        raise CaseError(f"the mesh asks for {points:.3g} control points, more than {MOST_POINTS:.0g}: take fewer spans")
    check_memory(f"{points} control points", CONTROL_POINT * points, "take fewer spans or a lower degree")


def _graded_faces(gradings: Sequence[Grading], faces: Mapping[str, Sequence[Face]]) -> dict[Face, set[Growth]]:
    """Find the faces at which spans are to be smallest, and how they are to grow from there."""
    found: dict[Face, set[Growth]] = {}
    for grading in gradings:
        toward = faces.get(grading.toward)
        if not toward:
            raise CaseError(f'grading toward "{grading.toward}": there is no such face; known: {", ".join(faces)}')
        for face in toward:
            found.setdefault(face, set()).add(Growth(grading.ratio, grading.equal))
    return found


def _ends(edges: Sequence[Edge], patches: Sequence[Patch], toward: Mapping[Face, set[Growth]]) -> Ends:
    """Find how spans grow from the beginning and from the end of a class of directions."""
    found: tuple[set[Growth], set[Growth]] = set(), set()
    for edge in edges:
        for side in range(2):
            found[side != edge.reversed].update(toward.get(Face(patches[edge.patch].name, edge.axis, side), ()))
    if max(map(len, found)) > 1:
        raise CaseError("two gradings lead toward the same end of a direction, and differ: leave one of them")
    first, last = (each.pop() if each else None for each in found)
    return first, last


def _break_points(at: Array, edges: Sequence[Edge], patches: Sequence[Patch], mesh: Mesh, ends: Ends) -> Array:
    """Cut the intervals between the breaks that a shape needs into spans."""
    if isinstance(mesh, OnePatch) and mesh.breaks is not None:
        return np.array(mesh.breaks[edges[0].axis])
    if mesh.span_size is None:
        return _graded(at, max((mesh.spans or (1, 1, 1))[edge.axis] for edge in edges), ends)
    fine, arcs = _arc_lengths(at, edges, patches)
    found, spans = at, len(at) - 1
    while (longest := _longest(found, fine, arcs)) > mesh.span_size * (1 + LONGER):
        spans = max(spans + 1, int(min(spans * longest / mesh.span_size, MOST_SPANS + 1)))
        if spans > MOST_SPANS:
            raise CaseError(
                f"span_size = {mesh.span_size:g} asks for more than {MOST_SPANS} spans along an edge of length "
                f"{arcs[:, -1].max():.4g}: is it in the unit of length of the model?"
            )
        found = _graded(at, spans, ends)
    return found


def _graded(at: Array, spans: int, ends: Ends) -> Array:
    """Cut [0, 1] into spans that grow from its ends but for the given breaks, which stay; at least so many."""
    graded = np.concatenate([[0.0], np.cumsum(_sizes(spans, ends))])
    graded /= graded[-1]
    flat = np.arange(spans + 1) / spans
    even = np.interp(at, graded, flat)
    counts = np.maximum(1, np.ceil(spans * np.diff(even) - 1e-9)).astype(int)
    each = zip(even[:-1], even[1:], counts, strict=True)
    fine = np.concatenate([*(np.linspace(low, high, n + 1)[:-1] for low, high, n in each), [1.0]])
    found = np.interp(fine, flat, graded)
    found[np.append(0, np.cumsum(counts))] = at
    return found


def _sizes(spans: int, ends: Ends) -> Array:
    """Sizes (spans,) that grow from an end to the other, or from both ends to the middle, up to one and the same."""
    places, sizes = np.arange(spans), np.ones(spans)
    reach = spans if None in ends else -(-spans // 2)
    for growth, place in zip(ends, (places, places[::-1]), strict=True):
        if growth is not None:
            steps = np.clip(place - growth.equal + 1, 0, None) / max(1, reach - growth.equal)
            sizes = np.minimum(sizes, growth.ratio ** (np.minimum(steps, 1) - 1))
    return sizes


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
    """Give a trilinear patch degrees and open knot vectors, whatever range these have; raise CaseError for too many."""
    _check_size([list(zip(degrees, wanted, strict=True))])
    ends = tuple(np.repeat(knots[[0, -1]], 2) for knots in wanted)
    coarse = elevated(replace(patch, knots=ends), degrees)
    return refined(coarse, knots=[knots[p + 1 : -p - 1] for knots, p in zip(wanted, degrees, strict=True)])
