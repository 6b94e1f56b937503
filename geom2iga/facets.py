"""Facets in place of curved patches, as finite elements of degree 1 have them."""

from dataclasses import replace

import numpy as np

from geom2iga.bspline import open_knots
from geom2iga.model import Model
from geom2iga.patch import Patch, evaluate


def faceted(model: Model) -> Model:
    """Replace each patch by one of degree 1 through the crossings of its knot lines, to compare with.

    Bodies, groups and glued faces stay; certificates are those of the curved patches and are left out.
    """
    return replace(model, patches={name: _faceted(p) for name, p in model.patches.items()}, certificates={})


def _faceted(patch: Patch) -> Patch:
    grid = np.stack(np.meshgrid(*patch.breaks, indexing="ij"), axis=-1)
    points = evaluate(patch, grid.reshape(-1, patch.directions))[0].reshape(*grid.shape[:-1], 3)
    knots = tuple(open_knots(at, 1) for at in patch.breaks)
    return Patch(patch.name, (1,) * patch.directions, knots, points)
