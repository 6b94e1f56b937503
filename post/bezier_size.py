"""How large the Bézier elements of the bodies are; without VTK, which takes long to import."""

from math import prod

from geom2iga.model import Model
from geom2iga.patch import Patch

CELL = 8 + 1 + 4 + 24  # bytes of a cell: where it ends, its type, body and degrees
FIELDS = {"points": 3, "RationalWeights": 1, "displacement": 3, "stress": 6}


def grid_shape(patch: Patch) -> tuple[int, ...]:
    """Control points of the Bézier elements of a patch in each direction."""
    return tuple(p * (len(at) - 1) + 1 for p, at in zip(patch.degrees, patch.breaks, strict=True))


def size_of_bezier(model: Model) -> int:
    """Length of the file [bytes], but for its header: a row of doubles per point, and what a cell consists of."""
    size = 0
    for patch in model.patches.values():
        cells = prod(len(at) - 1 for at in patch.breaks)
        corners = prod(degree + 1 for degree in patch.degrees)
        size += 8 * prod(grid_shape(patch)) * sum(FIELDS.values()) + cells * (8 * corners + CELL)
    return size
