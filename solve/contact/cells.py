"""Quadrature cells of a contact: points shared by the two sides, by element or by segment."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from geom2iga.bspline import Array, Indices, Mask, find_spans, sharp_breaks
from geom2iga.errors import CaseError
from geom2iga.model import Model
from geom2iga.patch import FLAT, Face, Patch
from geom2iga.progress import tracked
from geom2iga.projection import closest_points
from solve.case import Contact
from solve.contact.charts import FACING, frame_at
from solve.contact.search import may_lie_opposite
from solve.contact.segments import enough_points, find_segments, integration_points
from solve.face import Surface, area_vectors, surface_of
from solve.space import gauss_points

TOUCHING = 6.0  # gaps below so many roundings of control points are rounding errors


@dataclass(frozen=True, eq=False)
class Cells:
    """Quadrature points that pair a secondary with a primary face.

    Parameters
    ----------
    secondary, primary : Face
    secondary_xi, primary_xi : (q, 2)
        Parametric points on either side; a little outside of their span, or the face, where outlines are curved.
    secondary_spans, primary_spans : (q, 2)
        Whose polynomials are meant there, as knot indices.
    points : (q, 3)
        Positions on the secondary side [length].
    area : (q,)
        Weight on the secondary side [length²].
    primary_area : (q,)
        Weight of the same cell on the primary side [length²].
    normal : (q, 3)
        Outward normal of the primary side.
    gap : (q,)
        (x_s - x_m)·n_m [length], positive where open.                               paper, eq. (11)
    rounding : float
        What gaps may be off by, as control points are rounded [length].
    hidden : float
        Largest gap or overlap that is taken as none, because rounding makes such [length].
    """

    secondary: Face
    primary: Face
    secondary_xi: Array
    primary_xi: Array
    secondary_spans: Indices
    primary_spans: Indices
    points: Array
    area: Array
    primary_area: Array
    normal: Array
    gap: Array
    rounding: float = 0.0
    hidden: float = 0.0

    def chosen(self, kept: Mask | slice) -> "Cells":
        """Some of the points."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        some: dict[str, Any] = {name: array[kept] for name, array in values.items() if isinstance(array, np.ndarray)}
        return replace(self, **some)


def find_cells(model: Model, contact: Contact) -> tuple[Cells, ...]:
    """Find the quadrature cells of a contact, for every secondary face and the primary faces opposite it.

    Raises
    ------
    CaseError
        Unknown faces, faces of one body, faces that do not lie opposite each other.
    """
    secondary, primary, origin = _about_origin(model, contact)
    both = {model.body_of(s.face.patch) for s in secondary} & {model.body_of(s.face.patch) for s in primary}
    if both:
        raise CaseError(f'secondary and primary are both on body "{both.pop()}": contact needs two bodies')
    make = segment_cells if contact.integration == "segment" else element_cells
    faces = tracked(secondary, "secondary faces")
    parts = (part for face in faces for part in make(face, primary, contact.points, contact.reach))
    cells = tuple(part for part in parts if len(part.area))
    if not cells:
        names = f'"{contact.secondary}" and "{contact.primary}"'
        near = "" if contact.reach is None else f" within the reach of {contact.reach:g}"
        raise CaseError(f"{names} nowhere lie opposite and look at each other{near}: choose faces that may touch")
    return tuple(replace(part, points=part.points + origin) for part in cells)


def _about_origin(model: Model, contact: Contact) -> tuple[list[Surface], list[Surface], Array]:
    """Faces of the two sides, moved so that they lie about the origin, and where that was.

    A place far away costs no digits then, but for those that its control points lack.
    """
    sides = [[surface_of(model, face) for face in model.faces(g)] for g in (contact.secondary, contact.primary)]
    points = np.concatenate([surface.patch.control_points.reshape(-1, 3) for side in sides for surface in side])
    origin = points[0] + (points - points[0]).mean(axis=0)
    secondary, primary = ([surface.moved(-origin) for surface in side] for side in sides)
    return secondary, primary, origin


def element_cells(
    secondary: Surface, primary: Sequence[Surface], points: int | None = None, reach: float | None = None
) -> tuple[Cells, ...]:
    """Take the knot spans of the secondary side as cells, as the paper does.         paper, eqs. (30), (31)

    Each point is paired with the nearest primary face; left out are those whose closest point is a mere border point,
    and those that are farther away than the reach.

    Parameters
    ----------
    points : int
        Gauss points per span and direction; left out, degree + 1.
    reach : float
        Largest gap that is looked at [length]; left out, any.
    """
    gauss = gauss_points(secondary.patch, None if points is None else (points, points))
    at, normal, _ = area_vectors(secondary, gauss.xi)
    nearest, foot = nearest_feet(at, normal, primary, reach)
    cells = []
    for number, surface in enumerate(primary):
        own = nearest == number
        spans = _spans_at(surface.patch, foot[own])
        cells.append(_paired(secondary, surface, gauss.xi[own], foot[own], gauss.weights[own], gauss.spans[own], spans))
    return tuple(cells)


def _spans_at(patch: Patch, xi: Array) -> Indices:
    """Knot indices (q, 2) of the spans that hold points."""
    return np.stack([find_spans(k, p, at) for k, p, at in zip(patch.knots, patch.degrees, xi.T, strict=True)], axis=1)


def nearest_feet(
    points: Array, normal: Array, surfaces: Sequence[Surface], reach: float | None = None
) -> tuple[Indices, Array]:
    """Find the nearest surface that each point, with its outward normal, looks at, and the closest point there.

    Parameters
    ----------
    points, normal : (q, 3)
    reach : float
        How far to look at most [length]; left out, any distance.

    Returns
    -------
    nearest : (q,)
        Index of the surface; -1 where the point lies opposite none.
    xi : (q, 2)
        Parametric place of the closest point.                                       paper, eqs. (9), (10)
    """
    nearest, xi = np.full(len(points), -1), np.zeros((len(points), 2))
    distance = np.full(len(points), np.inf if reach is None else np.nextafter(reach, np.inf))
    for number, surface in enumerate(surfaces):
        away, foot = _feet(points, normal, surface)
        closer = away < distance
        nearest[closer], xi[closer], distance[closer] = number, foot[closer], away[closer]
    return nearest, xi


def _feet(points: Array, normal: Array, surface: Surface) -> tuple[Array, Array]:
    """Distance (q,) and place (q, 2) of the closest points of a surface, infinitely far where none lies opposite."""
    foot = closest_points(surface.patch, points)
    facing = -np.einsum("qk,qk->q", normal, area_vectors(surface, foot.xi)[1]) >= FACING
    away = np.linalg.norm(points - foot.points, axis=1)
    return np.where(foot.inside & facing, away, np.inf), foot.xi


def segment_cells(
    secondary: Surface, primary: Sequence[Surface], points: int | None = None, reach: float | None = None
) -> tuple[Cells, ...]:
    """Cut cells along the knot lines of both sides; what overhangs is cut off.

    The knot lines of the primary side are drawn in the secondary's parameter plane, along the primary normals. Where
    both maps are affine the rule is exact for products of a secondary and a primary basis function; elsewhere it
    converges exponentially with the number of points. A primary face that a point sees behind a nearer one does not
    count.

    Parameters
    ----------
    points : int
        Points per direction in each part of a cell; left out, as many as are exact between planes, and as many more
        as uniform pressure needs to balance.
    reach : float
        Largest gap that is looked at [length]: cells all beyond it are left out. Left out, any.
    """
    near = [surface for surface in primary if may_lie_opposite(secondary, surface)]
    parts = [(surface, _cut_cells(secondary, surface, points, reach)) for surface in tracked(near, "primary faces")]
    opposite = [(surface, part) for surface, part in parts if part is not None and len(part.area)]
    return tuple(_seen(secondary, surface, part, [other for other, _ in opposite]) for surface, part in opposite)


def _cut_cells(secondary: Surface, primary: Surface, points: int | None, reach: float | None) -> Cells | None:
    """Cut the cells of one pair of faces, if any."""
    segments = find_segments(secondary, primary, reach)
    if not len(segments.owner):
        return None
    counts = np.full(len(segments.owner), points) if points else enough_points(segments)
    rule = integration_points(segments, counts)
    spans_s, spans_m = segments.spans[rule.segment], segments.outlines.spans[segments.owner[rule.segment]]
    cells = _paired(secondary, primary, rule.secondary_xi, rule.primary_xi, rule.weights, spans_s, spans_m)
    kept = rule.found
    if reach is not None:
        within = np.bincount(rule.segment, np.abs(cells.gap) <= reach, len(segments.owner)) > 0
        kept &= within[rule.segment]
    return cells if kept.all() else cells.chosen(kept)


def _seen(secondary: Surface, primary: Surface, cells: Cells, opposite: Sequence[Surface]) -> Cells:
    """Leave out the points that lie opposite a nearer primary face, or a nearer flank of one with kinks."""
    rivals = [other for other in opposite if other is not primary or _is_kinked(primary)]
    if not rivals:
        return cells
    at, hidden = cells.points, np.zeros(len(cells.area), dtype=bool)
    for other in rivals:
        corners = other.patch.control_points.reshape(-1, 3)
        beside = np.maximum(0, np.maximum(corners.min(axis=0) - at, at - corners.max(axis=0)))
        rival = np.flatnonzero(np.linalg.norm(beside, axis=1) < (1 - FLAT) * np.abs(cells.gap))
        if not rival.size:
            continue
        _, normal, _ = area_vectors(secondary, cells.secondary_xi[rival], cells.secondary_spans[rival])
        away, _ = _feet(at[rival], normal, other)
        hidden[rival] = hidden[rival] | (away < (1 - FLAT) * np.abs(cells.gap[rival]))
    return cells.chosen(~hidden) if hidden.any() else cells


def _is_kinked(surface: Surface) -> bool:
    """Whether the tangents may jump along a knot line."""
    directions = zip(surface.patch.knots, surface.patch.degrees, strict=True)
    return any(len(sharp_breaks(*direction)) > 2 for direction in directions) and not surface.is_affine


def _paired(
    secondary: Surface, primary: Surface, xi_s: Array, xi_m: Array, weights: Array, spans_s: Indices, spans_m: Indices
) -> Cells:
    """Evaluate area, normal and gap at pairs of parametric points with parametric weights on the secondary side."""
    at_s, normal_s, stretch = area_vectors(secondary, xi_s, spans_s)
    at_m, normal, _ = area_vectors(primary, xi_m, spans_m)
    gap = np.einsum("qk,qk->q", at_s - at_m, normal)
    rounding = max(secondary.rounding, primary.rounding)
    none = np.abs(gap) <= TOUCHING * rounding
    hidden = float(np.abs(gap[none]).max(initial=0.0))
    gap[none] = 0.0
    spread = _spread(primary, xi_m, spans_m, gap)
    area = weights * stretch
    primary_area = area * np.abs(np.einsum("qk,qk->q", normal, normal_s)) / spread
    places = (xi_s, xi_m, spans_s, spans_m, at_s)
    return Cells(secondary.face, primary.face, *places, area, primary_area, normal, gap, rounding, hidden)


def _spread(surface: Surface, xi: Array, spans: Indices, gap: Array) -> Array:
    """Area (q,) of the surface at a distance along the normals, per area of the surface itself."""
    if surface.is_affine or not gap.any():
        return np.ones(len(gap))
    frame = frame_at(surface, xi, spans)
    offset = frame.tangents + gap[:, None, None] * frame.turning
    areas = (np.cross(part[:, :, 0], part[:, :, 1]) for part in (offset, frame.tangents))
    one, other = (np.einsum("qk,qk->q", part, frame.normal) for part in areas)
    return one / other
