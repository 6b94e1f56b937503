"""Closest point on a NURBS surface."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from geom2iga.bspline import Array, Mask
from geom2iga.patch import Patch, evaluate

STARTS = 4  # trial points per span and direction
MAX_STEPS = 40
HALVINGS = 20
ROUNDING = 1e-13  # a step of this fraction of the parameter range is the last one


class Foot(NamedTuple):
    """Closest points of a surface."""

    xi: Array  # (q, 2)
    points: Array  # (q, 3) [length]
    inside: Mask  # (q,) bool: the connecting line is normal to the surface, so the foot is no mere border point


def closest_points(surface: Patch, points: Array, start: Array | None = None) -> Foot:
    """Project points onto a surface: grad d(xi) = 0 with d = |x - S(xi)|.         paper, eqs. (9), (10)

    Newton's method on d²/2, all points at once, held inside the parameter range; where the Hessian is not
    positive definite its Gauss-Newton part takes its place, where a step leads away it is halved.

    Parameters
    ----------
    points : (q, 3)
        Positions [length].
    start : (q, 2)
        Where to begin; left out, the nearest of a grid of trial points.
    """
    low = np.array([knots[0] for knots in surface.knots])
    high = np.array([knots[-1] for knots in surface.knots])
    xi = _nearest_trial(surface, points) if start is None else np.clip(start, low, high)
    pending = np.arange(len(points))
    for _ in range(MAX_STEPS):
        step = _newton_step(surface, points[pending], xi[pending], low, high)
        _halve_where_away(surface, points[pending], xi[pending], step)
        xi[pending] += step
        pending = pending[np.any(np.abs(step) > ROUNDING * (high - low), axis=1)]
        if not pending.size:
            break
    feet, tangents = evaluate(surface, xi, 1)
    slope = np.abs(np.einsum("qk,qkd->qd", feet - points, tangents))
    size = np.max(np.ptp(surface.control_points.reshape(-1, 3), axis=0))
    inside = np.all(slope <= 1e-9 * size * np.linalg.norm(tangents, axis=1), axis=1)
    return Foot(xi, feet, inside)


def _newton_step(surface: Patch, points: Array, xi: Array, low: Array, high: Array) -> Array:
    """One Newton step (q, 2); a direction that pushes out of the range at its end is left out."""
    feet, tangents, bends = evaluate(surface, xi, 2)
    offset = feet - points
    gradient = np.einsum("qk,qkd->qd", offset, tangents)
    metric = np.einsum("qkd,qke->qde", tangents, tangents)
    hessian = metric + np.einsum("qk,qkde->qde", offset, bends)
    convex = (hessian[:, 0, 0] > 0) & (np.linalg.det(hessian) > 1e-3 * np.linalg.det(metric))
    hessian = np.where(convex[:, None, None], hessian, metric)
    at_low, at_high = xi <= low + ROUNDING * (high - low), xi >= high - ROUNDING * (high - low)
    stuck = (at_low & (gradient > 0)) | (at_high & (gradient < 0))
    for _ in range(3):  # a step of both directions together may push out where the gradient alone does not
        gradient[stuck] = 0.0
        hessian[:, 0, 1][stuck.any(axis=1)] = hessian[:, 1, 0][stuck.any(axis=1)] = 0.0
        step = -np.linalg.solve(hessian, gradient[:, :, None])[:, :, 0]
        stuck = (at_low & (step < 0)) | (at_high & (step > 0))
    room = np.where(step > 0, high - xi, xi - low)  # shortened, not bent: a bent step could lead away
    share = np.min(np.where(np.abs(step) > room, room / np.where(step != 0, np.abs(step), 1.0), 1.0), axis=1)
    return np.clip(xi + share[:, None] * step, low, high) - xi


def _halve_where_away(surface: Patch, points: Array, xi: Array, step: Array) -> None:
    """Halve steps (q, 2), in place, until none ends farther from its point than it began."""
    before = np.linalg.norm(evaluate(surface, xi)[0] - points, axis=1)
    limit = before + ROUNDING * (before + np.abs(points).max(axis=1))
    away = np.arange(len(points))
    for _ in range(HALVINGS):
        after = np.linalg.norm(evaluate(surface, (xi + step)[away])[0] - points[away], axis=1)
        away = away[after > limit[away]]
        if not away.size:
            return
        step[away] /= 2


def _nearest_trial(surface: Patch, points: Array) -> Array:
    """Start values: the nearest point of a grid over the surface."""
    axes = [
        np.unique(np.concatenate([at[:-1] + np.diff(at) * k / STARTS for k in range(STARTS)] + [at[-1:]]))
        for at in surface.breaks
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    _, nearest = cKDTree(evaluate(surface, grid)[0]).query(points)
    return grid[nearest]
