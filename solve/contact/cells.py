"""Quadrature cells of a contact: points shared by the two sides, by element or by segment."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from geom2iga.bspline import Array, Indices
from geom2iga.errors import CaseError
from geom2iga.model import Model
from geom2iga.patch import Face, Patch, evaluate
from geom2iga.projection import closest_points
from solve.case import Contact
from solve.contact.polygons import clip, triangle_points, triangulate
from solve.contact.search import find_span_pairs
from solve.face import CurvedError, Plane, Surface, area_vectors, find_plane, surface_of
from solve.space import FLAT, gauss_points, is_affine

FACING = 1e-3  # least cosine between one normal and the other's opposite
MORE_POINTS = 4  # points more per direction where a map is not affine, so that the integrand is no polynomial
USE_ELEMENTS = 'segment cells need plane faces with straight knot lines: use integration = "element"'
TOUCHING = 1e-14  # gaps below this fraction of the largest coordinate are rounding errors


@dataclass(frozen=True, eq=False)
class Cells:
    """Quadrature points that pair a secondary with a primary face.

    Parameters
    ----------
    secondary, primary : Face
    secondary_xi, primary_xi : (q, 2)
        Parametric points on either side.
    area : (q,)
        Weight on the secondary side [length²].
    primary_area : (q,)
        Weight of the same cell on the primary side [length²].
    normal : (q, 3)
        Outward normal of the primary side.
    gap : (q,)
        (x_s - x_m)·n_m [length], positive where open.                               paper, eq. (11)
    """

    secondary: Face
    primary: Face
    secondary_xi: Array
    primary_xi: Array
    area: Array
    primary_area: Array
    normal: Array
    gap: Array


def find_cells(model: Model, contact: Contact, remedy: str = USE_ELEMENTS) -> tuple[Cells, ...]:
    """Find the quadrature cells of a contact, for every secondary face and the primary faces opposite it.

    Parameters
    ----------
    remedy : str
        Who needs plane faces with straight knot lines, and what to do where they are curved.

    Raises
    ------
    CaseError
        Unknown faces, faces of one body, faces that do not lie opposite each other; curved ones with segment cells.
    """
    secondary, primary = ([surface_of(model, f) for f in model.faces(g)] for g in (contact.secondary, contact.primary))
    both = {model.body_of(s.face.patch) for s in secondary} & {model.body_of(s.face.patch) for s in primary}
    if both:
        raise CaseError(f'secondary and primary are both on body "{both.pop()}": contact needs two bodies')
    make = segment_cells if contact.integration == "segment" else element_cells
    try:
        cells = tuple(part for face in secondary for part in make(face, primary, contact.points) if len(part.area))
    except CurvedError as error:
        raise CaseError(f"{error}, but {remedy}") from None
    if not cells:
        names = f'"{contact.secondary}" and "{contact.primary}"'
        raise CaseError(f"{names} nowhere lie opposite and look at each other: choose faces that may touch")
    return cells


def element_cells(secondary: Surface, primary: Sequence[Surface], points: int | None = None) -> tuple[Cells, ...]:
    """Take the knot spans of the secondary side as cells, as the paper does.         paper, eqs. (30), (31)

    Each point is paired with the nearest primary face; left out are those whose closest point is a mere border point.

    Parameters
    ----------
    points : int
        Gauss points per span and direction; left out, degree + 1.
    """
    gauss = gauss_points(secondary.patch, None if points is None else (points, points))
    at, normal, stretch = area_vectors(secondary, gauss.xi)
    area = stretch * gauss.weights
    nearest, foot = nearest_feet(at, normal, primary)
    shares = ((surface, nearest == number) for number, surface in enumerate(primary))
    return tuple(_paired(secondary, surface, gauss.xi[own], foot[own], area[own]) for surface, own in shares)


def nearest_feet(points: Array, normal: Array, surfaces: Sequence[Surface]) -> tuple[Indices, Array]:
    """Find the nearest surface that each point, with its outward normal, looks at, and the closest point there.

    Parameters
    ----------
    points, normal : (q, 3)

    Returns
    -------
    nearest : (q,)
        Index of the surface; -1 where the point lies opposite none.
    xi : (q, 2)
        Parametric place of the closest point.                                       paper, eqs. (9), (10)
    """
    nearest, xi = np.full(len(points), -1), np.zeros((len(points), 2))
    distance = np.full(len(points), np.inf)
    for number, surface in enumerate(surfaces):
        foot = closest_points(surface.patch, points)
        facing = -np.einsum("qk,qk->q", normal, area_vectors(surface, foot.xi)[1]) >= FACING
        away = np.linalg.norm(points - foot.points, axis=1)
        closer = foot.inside & facing & (away < distance)
        nearest[closer], xi[closer], distance[closer] = number, foot.xi[closer], away[closer]
    return nearest, xi


def segment_cells(secondary: Surface, primary: Sequence[Surface], points: int | None = None) -> tuple[Cells, ...]:
    """Cut cells along the knot lines of both sides; what overhangs is cut off.

    All faces must be plane with straight knot lines, at any angle to each other within their planes. Span outlines
    are projected along the primary normal, clipped with each other and split into triangles, on which the rule is
    exact for products of a secondary and a primary basis function where both maps are affine; elsewhere it converges
    exponentially with the number of points. A primary face that a point sees behind a nearer one does not count.

    Parameters
    ----------
    points : int
        Points per triangle and direction; left out, secondary degree + primary degree + 1, and 4 more where a map
        is not affine.

    Raises
    ------
    CurvedError
        A face that is curved or has curved knot lines.
    """
    cells = {surface: _cut_cells(secondary, surface, points) for surface in primary if _facing(secondary, surface)}
    opposite = {surface: part for surface, part in cells.items() if len(part.area)}
    return tuple(_seen(secondary, surface, part, opposite.keys() - {surface}) for surface, part in opposite.items())


def _facing(secondary: Surface, primary: Surface) -> bool:
    return -float(find_plane(primary).normal @ find_plane(secondary).normal) >= FACING


def _cut_cells(secondary: Surface, primary: Surface, points: int | None) -> Cells:
    """Cut the cells of one pair of plane faces."""
    plane, other = find_plane(primary), find_plane(secondary)
    cosine = -float(plane.normal @ other.normal)
    outlines_s = _project(_span_corners(secondary), plane)
    outlines_m = _project(_span_corners(primary), plane)
    spans_s, spans_m = find_span_pairs(outlines_s, outlines_m)
    triangles, cell = triangulate(*clip(outlines_s[spans_s], outlines_m[spans_m]))
    count = points or _enough_points(secondary.patch, primary.patch)
    at, weights = triangle_points(triangles, count)
    cell = np.repeat(cell, count * count)
    on_primary = plane.origin + at @ plane.frame
    height = (other.origin - on_primary) @ other.normal / (plane.normal @ other.normal)
    on_secondary = on_primary + height[:, None] * plane.normal
    xi_s = closest_points(secondary.patch, on_secondary, _span_centres(secondary.patch)[spans_s[cell]]).xi
    xi_m = closest_points(primary.patch, on_primary, _span_centres(primary.patch)[spans_m[cell]]).xi
    return _paired(secondary, primary, xi_s, xi_m, weights / cosine)


def _enough_points(*sides: Patch) -> int:
    """Points per triangle and direction for a product of basis functions of both sides."""
    return sum(max(patch.degrees) for patch in sides) + 1 + (0 if all(map(is_affine, sides)) else MORE_POINTS)


def _seen(secondary: Surface, primary: Surface, cells: Cells, others: Iterable[Surface]) -> Cells:
    """Leave out the points that lie opposite a nearer primary face."""
    at = evaluate(secondary.patch, cells.secondary_xi)[0]
    hidden = np.zeros(len(at), dtype=bool)
    for other in others:
        plane = find_plane(other)
        nearer = np.flatnonzero(np.abs((at - plane.origin) @ plane.normal) < (1 - FLAT) * np.abs(cells.gap))
        hidden[nearer] |= closest_points(other.patch, at[nearer]).inside
    if not hidden.any():
        return cells
    kept = ~hidden
    return _paired(secondary, primary, cells.secondary_xi[kept], cells.primary_xi[kept], cells.area[kept])


def _paired(secondary: Surface, primary: Surface, xi_s: Array, xi_m: Array, area: Array) -> Cells:
    """Evaluate normal and gap at pairs of parametric points."""
    at_s, normal_s, _ = area_vectors(secondary, xi_s)
    at_m, normal, _ = area_vectors(primary, xi_m)
    primary_area = area * np.abs(np.einsum("qk,qk->q", normal, normal_s))
    gap = np.einsum("qk,qk->q", at_s - at_m, normal)
    gap[np.abs(gap) <= TOUCHING * np.abs(at_s).max(initial=0.0)] = 0.0
    return Cells(secondary.face, primary.face, xi_s, xi_m, area, primary_area, normal, gap)


def _span_corners(surface: Surface) -> Array:
    """Corners (s, 4, 3) of all spans, in sequence around each; raise CurvedError where knot lines are."""
    patch = surface.patch
    size = np.max(np.ptp(patch.control_points.reshape(-1, 3), axis=0))
    halves = [np.sort(np.concatenate([at, (at[1:] + at[:-1]) / 2])) for at in patch.breaks]
    grid = np.stack(np.meshgrid(*halves, indexing="ij"), axis=-1)
    fine = evaluate(patch, grid.reshape(-1, 2))[0].reshape(*grid.shape[:2], 3)
    for lines in (fine[::2], np.swapaxes(fine[:, ::2], 0, 1)):
        chords, middles = lines[:, 2::2] - lines[:, :-2:2], lines[:, 1::2] - lines[:, :-2:2]
        if np.max(np.linalg.norm(np.cross(chords, middles), axis=-1)) > FLAT * size**2:
            raise CurvedError(f"{surface.name} has curved knot lines")
    corners = fine[::2, ::2]
    around = [corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]]
    return np.stack(around, axis=2).reshape(-1, 4, 3)


def _span_centres(patch: Patch) -> Array:
    """Parametric centres (s, 2) of all spans, in the sequence of `_span_corners`."""
    centres = [(at[1:] + at[:-1]) / 2 for at in patch.breaks]
    return np.stack(np.meshgrid(*centres, indexing="ij"), axis=-1).reshape(-1, 2)


def _project(points: Array, plane: Plane) -> Array:
    """Coordinates in a plane, (..., 2) [length]."""
    return (points - plane.origin) @ plane.frame.T
