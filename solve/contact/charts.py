"""Maps between the parameter planes of two faces: along the primary normal, and back by the closest point."""

from typing import NamedTuple

import numpy as np

from geom2iga.bspline import Array, Indices, Mask
from geom2iga.patch import evaluate
from solve.face import Surface

FACING = 1e-3  # least cosine between one normal and the other's opposite
BEYOND = 1.0  # how far beyond its border a face's map is continued, in spans there
MAX_STEPS = 15
LAST = 1e-8  # a Newton step of this fraction of the parameter range leaves an error of its square
PARALLEL = 1e-12  # least sine between a normal and the other face
COLLAPSED = 1e-8  # least area per parametric area, in units of the largest, that has a normal
ASIDE = 1e-6  # how far towards the middle of its span a normal is taken where there is none, in spans


class Frame(NamedTuple):
    """Points of the primary side, and how its outward normal turns."""

    at: Array  # (q, 3) [length]
    tangents: Array  # (q, 3, 2)
    normal: Array  # (q, 3)
    turning: Array  # (q, 3, 2) derivatives of the normal


class Image(NamedTuple):
    """Points of the primary side as seen on the secondary side."""

    xi: Array  # (q, 2)
    gap: Array  # (q,) [length]
    slope: Array  # (q, 2, 2) derivatives of xi with respect to the primary's parameters
    seen: Mask  # (q,) the sides look at each other here, and no nearer point of the primary is passed on the way


def frame_at(surface: Surface, xi: Array, spans: Indices) -> Frame:
    """Evaluate points, tangents, outward normals and their derivatives, (q, ...), of the given spans' polynomials.

    Where an edge has no length the normal is that of a point beside it.
    """
    patch = surface.patch
    points, tangents, bends = evaluate(patch, xi, 2, spans=spans)
    normal, turning, stretch = _turning_normal(tangents, bends, surface.outward)
    poor = np.flatnonzero(stretch <= COLLAPSED * stretch.max(initial=0.0))
    if poor.size:
        middles = np.stack([(k[s] + k[s + 1]) / 2 for k, s in zip(patch.knots, spans[poor].T, strict=True)], axis=1)
        beside = xi[poor] + ASIDE * (middles - xi[poor])
        _, tangents_beside, bends_beside = evaluate(patch, beside, 2, spans=spans[poor])
        normal[poor] = _turning_normal(tangents_beside, bends_beside, surface.outward)[0]
        turning[poor] = 0.0
    return Frame(points, tangents, normal, turning)


def _turning_normal(tangents: Array, bends: Array, outward: int) -> tuple[Array, Array, Array]:
    """Unit normals (q, 3), their derivatives (q, 3, 2), area per parametric area (q,)."""
    first, second = tangents[:, :, 0], tangents[:, :, 1]
    directed = outward * np.cross(first, second)
    stretch = np.linalg.norm(directed, axis=1)
    size = np.where(stretch > 0, stretch, 1.0)[:, None]
    normal = directed / size
    turning = np.empty_like(tangents)
    for d in range(2):
        change = outward * (np.cross(bends[:, :, 0, d], second) + np.cross(first, bends[:, :, 1, d])) / size
        turning[:, :, d] = change - normal * np.einsum("qk,qk->q", normal, change)[:, None]
    return normal, turning, stretch


def image_of(secondary: Surface, frame: Frame, start: Array, outward: int, spans: Indices | None = None) -> Image:
    """Follow the primary normals to the secondary side: S_s(xi) = x_m + g n_m.   inverse of paper, eqs. (10), (11)

    Newton's method, all points at once, held within a span of the secondary's border, beyond which the polynomials
    there continue.

    Parameters
    ----------
    start : (q, 2)
    outward : 1 or -1
        Of the primary side.
    spans : (q, 2)
        Whose polynomial of the secondary to take, as knot index; left out, that of the span that holds the point.
    """
    low, high = _continued(secondary)
    last = LAST * np.array([at[-1] - at[0] for at in secondary.patch.breaks])
    xi = np.clip(start, low, high)
    pending, missed = np.arange(len(xi)), np.ones(len(xi), dtype=bool)
    for _ in range(MAX_STEPS):
        part = Frame(*(values[pending] for values in frame))
        own = None if spans is None else spans[pending]
        step = _along_normals(secondary, part, xi[pending], own)[0]
        moved = np.clip(xi[pending] + step, low, high)
        near, held = np.all(np.abs(step) <= last, axis=1), np.all(moved == xi[pending], axis=1)
        xi[pending] = moved
        missed[pending[near]] = False
        pending = pending[~(near | held)]
        if not pending.size:
            break
    step, gap, slope, facing = _along_normals(secondary, frame, xi, spans)
    xi = np.where(missed[:, None], xi, xi + step)
    offset = frame.tangents + gap[:, None, None] * frame.turning
    nearest = np.einsum("qkd,qkd->qd", frame.tangents, offset) >= 0  # positive definite: no focus is passed
    upright = outward * np.einsum("qk,qk->q", np.cross(offset[:, :, 0], offset[:, :, 1]), frame.normal) >= 0
    return Image(xi, gap, slope, ~missed & facing & upright & nearest.all(axis=1))


def _along_normals(
    secondary: Surface, frame: Frame, xi: Array, spans: Indices | None
) -> tuple[Array, Array, Array, Mask]:
    """One Newton step (q, 2), the gap (q,) after it, the slopes (q, 2, 2), and where the sides face each other.

    Where a normal runs along the secondary side there is no step.
    """
    points, tangents = evaluate(secondary.patch, xi, 1, spans=spans)
    first, second, normal = tangents[:, :, 0], tangents[:, :, 1], frame.normal
    own = np.cross(first, second)
    height, size = np.einsum("qk,qk->q", own, normal), np.linalg.norm(own, axis=1)
    parallel = np.abs(height) <= PARALLEL * size
    divisor = np.where(parallel, np.inf, height)[:, None]
    duals = np.stack([np.cross(second, normal) / divisor, np.cross(normal, first) / divisor], axis=1)
    way = frame.at - points
    gap = -np.einsum("qk,qk->q", own, way) / divisor[:, 0]
    slope = duals @ (frame.tangents + gap[:, None, None] * frame.turning)
    step = np.einsum("qdk,qk->qd", duals, way)
    return step, gap, slope, -secondary.outward * height >= FACING * size


def _continued(surface: Surface) -> tuple[Array, Array]:
    """The parameter range (2,), (2,) of a face and of what is continued beyond its border; all of a plane is."""
    if surface.is_affine:
        return np.full(2, -np.inf), np.full(2, np.inf)
    low = np.array([at[0] - BEYOND * (at[1] - at[0]) for at in surface.patch.breaks])
    high = np.array([at[-1] + BEYOND * (at[-1] - at[-2]) for at in surface.patch.breaks])
    return low, high


def closest_in_spans(surface: Surface, points: Array, start: Array, spans: Indices) -> tuple[Array, Mask]:
    """Find the closest points (q, 2) on the polynomials of given spans, and whether they are.   paper, eqs. (9), (10)

    Parameters
    ----------
    points : (q, 3)
    start : (q, 2)
    spans : (q, 2)
        As knot index.
    """
    size = np.array([at[-1] - at[0] for at in surface.patch.breaks])
    xi, found = start.copy(), np.zeros(len(start), dtype=bool)
    pending = np.arange(len(xi))
    for _ in range(MAX_STEPS):
        feet, tangents, bends = evaluate(surface.patch, xi[pending], 2, spans=spans[pending])
        offset = feet - points[pending]
        gradient = np.einsum("qk,qkd->qd", offset, tangents)
        a, b, c = (
            np.einsum("qk,qk->q", tangents[:, :, i], tangents[:, :, j])
            + np.einsum("qk,qk->q", offset, bends[:, :, i, j])
            for i, j in ((0, 0), (0, 1), (1, 1))
        )
        determinant = a * c - b * b
        convex = (a > 0) & (determinant > 0)
        divisor = np.where(convex, determinant, np.inf)
        step = np.stack([b * gradient[:, 1] - c * gradient[:, 0], b * gradient[:, 0] - a * gradient[:, 1]], axis=1)
        step = np.clip(step / divisor[:, None], -size, size)
        xi[pending] += step
        near = np.all(np.abs(step) <= LAST * size, axis=1)
        found[pending[near]] = convex[near]
        pending = pending[~near]
        if not pending.size:
            break
    return xi, found
