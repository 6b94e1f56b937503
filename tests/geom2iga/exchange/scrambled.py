"""Models of several glued patches whose directions run every which way, and other programs that read them."""

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, permutations, product
from typing import Any

import numpy as np

from geom2iga.bspline import Array
from geom2iga.glue import find_glued
from geom2iga.model import Glued, Model
from geom2iga.patch import Face, Patch, elevated, refined, reversed_along
from tests.cases import block_patch

CORNER = ((0, 0, 0), (1, 0, 0), (1, 1, 0))  # cells of three blocks around a corner
RING = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0))
CUBE = tuple(product(range(2), repeat=3))
DEGREES = (2, 3, 1)  # along x, y, z
INNER = (([0.3], [0.2, 0.6]), ([0.7, 0.7], [0.4]), ([0.1, 0.5], [0.8]))  # knots along x, y, z, in cells 0 and 1


def permuted(patch: Patch, axes: Sequence[int]) -> Patch:
    """The same body with its directions in another sequence."""
    return Patch(
        patch.name,
        tuple(patch.degrees[a] for a in axes),
        tuple(patch.knots[a] for a in axes),
        patch.control_points.transpose(*axes, 3),
        patch.weights.transpose(axes),
    )


def turnings() -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """The 24 ways to choose directions that keep a patch right-handed: their sequence, and which run backwards."""
    hands = {axes: round(np.linalg.det(np.eye(3)[list(axes)])) for axes in permutations(range(3))}
    every = product(hands, product(range(2), repeat=3))
    return [(axes, backwards) for axes, backwards in every if hands[axes] == (-1) ** sum(backwards)]


def turned_about(patch: Patch, turning: tuple[tuple[int, ...], tuple[int, ...]]) -> Patch:
    """The same body, its directions chosen in one of the ways of `turnings`."""
    axes, backwards = turning
    patch = permuted(patch, axes)
    for axis in np.flatnonzero(backwards):
        patch = reversed_along(patch, int(axis))
    return patch


def cell(name: str, place: Sequence[int], rational: bool = True) -> Patch:
    """One cell of a bent grid of unit blocks; neighbours have the same control points, weights and knots."""
    inner = [INNER[axis][place[axis] % 2] for axis in range(3)]
    patch = refined(elevated(block_patch(name, place), DEGREES), knots=inner)
    x, y, z = np.moveaxis(patch.control_points, -1, 0)
    bent = np.stack([x + 0.1 * np.sin(2 * y + z), y - 0.1 * np.cos(x + 2 * z), z + 0.1 * x * y], axis=-1)
    return replace(patch, control_points=bent, weights=1 + 0.3 * np.sin(x + 2 * y + 3 * z) if rational else None)


def scrambled_model(seed: int, cells: Sequence[Sequence[int]] = CORNER, rational: bool = True) -> Model:
    """Cells glued to one body, each turned at random, and beside it, in contact, the body "other".

    The group "body/low" holds all outer faces of "body" at the lower end of a first direction.
    """
    random = np.random.default_rng(seed)
    ways = turnings()
    patches = [
        turned_about(cell(f"body/{number}", place, rational), ways[random.integers(len(ways))])
        for number, place in enumerate(cells, 1)
    ]
    glued = find_glued(patches)
    inside = {face for pair in glued for face in (pair.first, pair.second)}
    low = tuple(face for face in (Face(patch.name, 0, 0) for patch in patches) if face not in inside)
    other = cell("other", (2, 0, 0), rational)
    by_name = {patch.name: patch for patch in (*patches, other)}
    bodies = {"body": tuple(patch.name for patch in patches), "other": ("other",)}
    groups = {"body/low": low, "other/top": (Face("other", 2, 1),)}
    return Model(by_name, bodies, groups, glued)


def count_control_points(model: Model) -> int:
    """Number of control points, those at one place of one body counted once."""
    return sum(
        len(np.unique(np.concatenate([_places(model.patches[name]) for name in names]), axis=0))
        for names in model.bodies.values()
    )


def _places(patch: Patch) -> Array:
    return np.round(patch.control_points.reshape(-1, 3), 9)


def ring(*turns: float, twist: float = 0.0) -> Model:
    """A ring of bent beams, glued end to end all the same way round, about the z axis from each turn to the next.

    Parameters
    ----------
    turns : angles at which the beams begin [degrees], increasing
    twist : 0 or 180, how far the cross-section turns on the whole way round [degrees]
    """
    every = np.radians([*turns, turns[0] + 360])
    angles, roll = every, np.radians(twist) * (every - every[0]) / (2 * np.pi)
    across, up = np.array([[-1.0, -1], [1, 1]]), np.array([[-1.0, 1], [-1, 1]])
    patches = []
    for number in range(len(turns)):
        points = np.empty((2, 2, 2, 3))
        for end, at in enumerate((number, number + 1)):
            radius = 4 + np.cos(roll[at]) * across - np.sin(roll[at]) * up
            height = np.sin(roll[at]) * across + np.cos(roll[at]) * up
            direction = [radius * np.cos(angles[at]), radius * np.sin(angles[at]), height]
            points[:, end] = np.stack(direction, axis=-1)
        straight = Patch(f"ring/{number + 1}", (1, 1, 1), ([0, 0, 1, 1],) * 3, points)
        bulge = elevated(straight, (1, 2, 2))
        middle = angles[number : number + 2].mean()
        outwards = np.array([np.cos(middle), np.sin(middle), 0]) * np.array([0, 2, 0])[None, :, None, None]
        bent = replace(bulge, control_points=bulge.control_points + outwards)
        patches.append(refined(bent, knots=([0.5], [0.2, 0.7], [0.5])))
    by_name = {patch.name: patch for patch in patches}
    ends = [(Face(name, 1, 1), Face(after, 1, 0)) for name, after in pairwise([*by_name, "ring/1"])]
    last = 6 if twist == 180 else 0
    glued = [Glued(*faces, last if faces[1].patch == "ring/1" else 0) for faces in ends]
    return Model(by_name, {"ring": tuple(by_name)}, {}, tuple(glued))


def run_apart(script: str, *arguments: Any) -> Any:
    """Run a script in a process of its own, which a crash of another program may take down; return what it says."""
    command = [sys.executable, "-W", "error", "-c", script, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
