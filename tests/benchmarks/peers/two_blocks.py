"""Meshes of the contact benchmark for finite elements: two unit cubes, one on the other, of unlike hexahedra.

The bottom does not move along z, the faces at x = 0 and y = 0 not along their normals, a pressure acts on the top: the
stress is uniform.
"""

import json
import sys
from typing import Any, NamedTuple

import numpy as np

YOUNG, POISSON, PRESSURE = 1000.0, 0.3, 1.0
STRESS = np.array([0.0, 0.0, -PRESSURE, 0.0, 0.0, 0.0])  # exact: xx, yy, zz, and shear
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])


class Block(NamedTuple):
    """Nodes and hexahedra of one cube, numbered from 0."""

    points: Any  # (n, 3)
    elements: Any  # (e, 8), the lower face counter-clockwise from above, then the upper one

    def at(self, axis: int, place: float) -> Any:
        """Numbers of the nodes in a plane."""
        return np.flatnonzero(np.abs(self.points[:, axis] - place) < 1e-9)

    def layer(self, top: bool) -> Any:
        """Numbers of the elements at the top or the bottom."""
        count = round(len(self.elements) ** (1 / 3))
        height = np.arange(len(self.elements)) % count
        return np.flatnonzero(height == (count - 1 if top else 0))


def block(spans: int, bottom: float) -> Block:
    """A unit cube, z running fastest."""
    at = np.linspace(0, 1, spans + 1)
    points = np.stack(np.meshgrid(at, at, at, indexing="ij"), axis=-1).reshape(-1, 3) + np.array([0, 0, bottom])
    numbers = np.arange(len(points)).reshape((spans + 1,) * 3)
    first = np.stack(np.meshgrid(*[np.arange(spans)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    return Block(points, numbers[tuple(np.moveaxis(first + CORNERS, 2, 0))])


def blocks() -> tuple[Block, Block]:
    """The lower cube, and the upper one with one span less, by the spans on the command line."""
    spans = int(sys.argv[1])
    return block(spans, 0.0), block(spans - 1, 1.0)


def report(**found: Any) -> None:
    """Print what was found as the last line."""
    print(json.dumps(found), flush=True)
