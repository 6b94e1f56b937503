"""How near the closest points come to brute force, how fast, and how often one start alone ends at another minimum.

OMP_NUM_THREADS=1 python -m tests.benchmarks.closest_points

Brute force is the nearest of a fine grid of samples, refined by ever smaller grids around it. Does not measure faces
of several surfaces, nor points farther away than the size of a face.
"""

import time
from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from geom2iga.bspline import Array, greville, open_knots
from geom2iga.patch import Patch, evaluate
from geom2iga.projection import closest_points

POINTS = 100_000
SAMPLES = 500  # of brute force, in each direction
ZOOMS = 11  # each halves the grid around the best sample


def arc(angle: float) -> tuple[Array, Array]:
    """Control points (3, 2) and weights (3,) of a circle's arc of radius 1 about (0, 0), symmetric to the x axis."""
    half = np.cos(angle / 2)
    return np.array([[half, -np.sin(angle / 2)], [1 / half, 0], [half, np.sin(angle / 2)]]), np.array([1, half, 1])


def sphere_cap(angle: float = 2.0) -> Patch:
    """A piece of the unit sphere, spanned by an arc turned about an axis."""
    points, weights = arc(angle)
    turned = [[[r * x, r * y, z] for x, y in points] for r, z in points]
    knots = open_knots([0, 1], 2)
    return Patch("sphere cap", (2, 2), (knots, knots), turned, np.outer(weights, weights))


def cylinder(spans: int = 4) -> Patch:
    """A full cylinder of radius 1 and height 2, of arcs that meet with equal slope; its seam is closed."""
    points, weights = arc(2 * np.pi / spans)
    angles = 2 * np.pi * np.arange(spans) / spans
    turns = np.array([[[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]] for a in angles])
    around = np.concatenate([*((points @ turn)[:2] for turn in turns), points[:1]])
    knots = np.concatenate([[0.0], np.repeat(np.arange(spans + 1.0), 2), [spans]])
    heights = np.array([-1.0, 1])
    at = np.array([[[x, y, z] for z in heights] for x, y in around])
    return Patch(
        "cylinder",
        (2, 1),
        (knots, open_knots([0, 1], 1)),
        at,
        np.outer(np.append(np.tile(weights[:2], spans), 1), [1, 1]),
    )


def graph(name: str, height: Callable[[Array, Array], Array], degree: int, spans: int) -> Patch:
    """A graph over the square of side 2, its control points lifted by a function of their place."""
    knots = open_knots(np.linspace(-1, 1, spans + 1), degree)
    at = greville(knots, degree)
    x, y = np.meshgrid(at, at, indexing="ij")
    return Patch(name, (degree, degree), (knots, knots), np.stack([x, y, height(x, y)], axis=-1))


def saddle() -> Patch:
    """The surface z = x² - y² (the products of its control points stand for the squares)."""
    at = np.array([-1.0, 0, 1])
    x, y = np.meshgrid(at, at, indexing="ij")
    square = np.array([1.0, -1, 1])
    knots = open_knots([-1, 1], 2)
    return Patch("saddle", (2, 2), (knots, knots), np.stack([x, y, square[:, None] - square], axis=-1))


def wavy_sheet() -> Patch:
    """A sheet of degree 3 with three waves of either direction."""
    return graph("wavy sheet", lambda x, y: 0.15 * np.sin(9 * x) * np.cos(8 * y), 3, 16)


SURFACES = (sphere_cap, saddle, cylinder, wavy_sheet)


def points_around(surface: Patch, count: int, seed: int = 0) -> Array:
    """Random points (q, 3): half in a box half as large again as the surface, half near the surface."""
    random = np.random.default_rng(seed)
    corners = surface.control_points.reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    size = (high - low).max()
    anywhere = random.uniform(low - size / 4, high + size / 4, (count - count // 2, 3))
    xi = np.stack([random.uniform(at[0], at[-1], count // 2) for at in surface.breaks], axis=1)
    near = evaluate(surface, xi)[0] + random.normal(scale=size / 50, size=(count // 2, 3))
    return np.concatenate([anywhere, near])


def brute_force(surface: Patch, points: Array, samples: int = SAMPLES, zooms: int = ZOOMS) -> Array:
    """Distances (q,): never below the true ones."""
    low, high = (np.array([at[end] for at in surface.breaks]) for end in (0, -1))
    axes = np.linspace(low, high, samples)
    grid = np.stack(np.meshgrid(*axes.T, indexing="ij"), axis=-1).reshape(-1, 2)
    distance, nearest = cKDTree(evaluate(surface, grid)[0]).query(points)
    xi, step = grid[nearest], (high - low) / (samples - 1)
    ring = np.stack(np.meshgrid([-2, -1, 0, 1, 2], [-2, -1, 0, 1, 2], indexing="ij"), axis=-1).reshape(-1, 2) / 2
    for _ in range(zooms):
        tried = np.clip(xi[:, None] + ring * step, low, high)
        away = np.linalg.norm(
            evaluate(surface, tried.reshape(-1, 2))[0].reshape(*tried.shape[:2], 3) - points[:, None], axis=2
        )
        best = away.argmin(axis=1)
        xi, distance = tried[np.arange(len(points)), best], away.min(axis=1)
        step = step / 2
    return distance


def single_start(surface: Patch, points: Array) -> Array:
    """Distances (q,) at the minima downhill from the nearest of four samples per span and direction."""
    axes = [
        np.unique(np.concatenate([at[:-1] + np.diff(at) * k / 4 for k in range(4)] + [at[-1:]]))
        for at in surface.breaks
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    start = grid[cKDTree(evaluate(surface, grid)[0]).query(points)[1]]
    return np.linalg.norm(closest_points(surface, points, start).points - points, axis=1)


def main() -> None:
    """Print the table."""
    print(f"{'surface':12} {'points':>8} {'above brute force':>18} {'points/s':>9} {'one start wrong':>16}")
    for make in SURFACES:
        surface = make()
        points = points_around(surface, POINTS)
        began = time.perf_counter()
        foot = closest_points(surface, points)
        seconds = time.perf_counter() - began
        found = np.linalg.norm(foot.points - points, axis=1)
        excess = (found - brute_force(surface, points)).max()
        wrong = np.count_nonzero(single_start(surface, points) > found + 1e-10)
        print(f"{surface.name:12} {POINTS:8} {excess:18.1e} {POINTS / seconds:9.0f} {wrong:16}")


if __name__ == "__main__":
    main()
