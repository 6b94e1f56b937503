"""Quadrature cells of a contact: points shared by the two sides, by element or by segment."""

from dataclasses import dataclass

import numpy as np

from geom2iga.bspline import Array
from geom2iga.errors import CaseError
from geom2iga.model import Model
from geom2iga.patch import Face, Patch, evaluate
from solve.case import Contact
from solve.contact.polygons import clip, triangle_points, triangulate
from solve.contact.projection import closest_points
from solve.contact.search import find_span_pairs
from solve.face import FLAT, Plane, Surface, area_vectors, find_plane, surface_of
from solve.space import gauss_points

FACING = 1e-3  # least cosine between one normal and the other's opposite
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


def find_cells(model: Model, contact: Contact) -> tuple[Cells, ...]:
    """Find the quadrature cells of a contact, for every secondary with every primary face.

    Raises
    ------
    CaseError
        Unknown faces, faces of one body, faces that do not lie opposite each other.
    """
    secondary, primary = model.faces(contact.secondary), model.faces(contact.primary)
    both = {model.body_of(face.patch) for face in secondary} & {model.body_of(face.patch) for face in primary}
    if both:
        raise CaseError(f'secondary and primary are both on body "{both.pop()}": contact needs two bodies')
    make = segment_cells if contact.integration == "segment" else element_cells
    cells = tuple(make(surface_of(model, s), surface_of(model, m), contact.points) for s in secondary for m in primary)
    if not any(len(part.area) for part in cells):
        raise CaseError(f'"{contact.secondary}" and "{contact.primary}" nowhere lie opposite each other')
    return cells


def element_cells(secondary: Surface, primary: Surface, points: int | None = None) -> Cells:
    """Take the knot spans of the secondary side as cells, as the paper does.         paper, eqs. (30), (31)

    Points whose closest point on the primary side is a mere border point are left out.

    Parameters
    ----------
    points : int
        Gauss points per span and direction; left out, degree + 1.
    """
    gauss = gauss_points(secondary.patch, None if points is None else (points, points))
    at, normal, stretch = area_vectors(secondary, gauss.xi)
    foot = closest_points(primary.patch, at)
    facing = -np.einsum("qk,qk->q", normal, area_vectors(primary, foot.xi)[1]) >= FACING
    if foot.inside.any() and not (foot.inside & facing).any():
        raise _turned_away(secondary, primary)
    keep = foot.inside & facing
    return _paired(secondary, primary, gauss.xi[keep], foot.xi[keep], (stretch * gauss.weights)[keep])


def segment_cells(secondary: Surface, primary: Surface, points: int | None = None) -> Cells:
    """Cut cells along the knot lines of both sides; what overhangs is cut off.

    Both faces must be plane with straight knot lines, at any angle to each other within their planes. Span outlines
    are projected along the primary normal, clipped with each other and split into triangles, on which the rule is
    exact for products of a secondary and a primary basis function where both maps are affine.

    Parameters
    ----------
    points : int
        Points per triangle and direction; left out, secondary degree + primary degree + 1.

    Raises
    ------
    CaseError
        A face that is curved or has curved knot lines, or faces that do not look at each other.
    """
    plane, other = find_plane(primary), find_plane(secondary)
    cosine = -float(plane.normal @ other.normal)
    if cosine < FACING:
        raise _turned_away(secondary, primary)
    outlines_s = _project(_span_corners(secondary), plane)
    outlines_m = _project(_span_corners(primary), plane)
    spans_s, spans_m = find_span_pairs(outlines_s, outlines_m)
    triangles, cell = triangulate(*clip(outlines_s[spans_s], outlines_m[spans_m]))
    count = points or max(secondary.patch.degrees) + max(primary.patch.degrees) + 1
    at, weights = triangle_points(triangles, count)
    cell = np.repeat(cell, count * count)
    on_primary = plane.origin + at @ plane.frame
    height = (other.origin - on_primary) @ other.normal / (plane.normal @ other.normal)
    on_secondary = on_primary + height[:, None] * plane.normal
    xi_s = closest_points(secondary.patch, on_secondary, _span_centres(secondary.patch)[spans_s[cell]]).xi
    xi_m = closest_points(primary.patch, on_primary, _span_centres(primary.patch)[spans_m[cell]]).xi
    return _paired(secondary, primary, xi_s, xi_m, weights / cosine)


def _turned_away(secondary: Surface, primary: Surface) -> CaseError:
    return CaseError(f"{secondary.name} and {primary.name} do not look at each other: choose opposite faces")


def _paired(secondary: Surface, primary: Surface, xi_s: Array, xi_m: Array, area: Array) -> Cells:
    """Evaluate normal and gap at pairs of parametric points."""
    at_s, normal_s, _ = area_vectors(secondary, xi_s)
    at_m, normal, _ = area_vectors(primary, xi_m)
    primary_area = area * np.abs(np.einsum("qk,qk->q", normal, normal_s))
    gap = np.einsum("qk,qk->q", at_s - at_m, normal)
    gap[np.abs(gap) <= TOUCHING * np.abs(at_s).max(initial=0.0)] = 0.0
    return Cells(secondary.face, primary.face, xi_s, xi_m, area, primary_area, normal, gap)


def _span_corners(surface: Surface) -> Array:
    """Corners (s, 4, 3) of all spans, in sequence around each; raise CaseError where knot lines are curved."""
    patch = surface.patch
    size = np.max(np.ptp(patch.control_points.reshape(-1, 3), axis=0))
    halves = [np.sort(np.concatenate([at, (at[1:] + at[:-1]) / 2])) for at in patch.breaks]
    grid = np.stack(np.meshgrid(*halves, indexing="ij"), axis=-1)
    fine = evaluate(patch, grid.reshape(-1, 2))[0].reshape(*grid.shape[:2], 3)
    for lines in (fine[::2], np.swapaxes(fine[:, ::2], 0, 1)):
        chords, middles = lines[:, 2::2] - lines[:, :-2:2], lines[:, 1::2] - lines[:, :-2:2]
        if np.max(np.linalg.norm(np.cross(chords, middles), axis=-1)) > FLAT * size**2:
            raise CaseError(f'{surface.name} has curved knot lines: use integration = "element"')
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
