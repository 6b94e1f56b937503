"""Strains that are too large for small deformation, which the equations assume and nothing else would tell."""

import logging
from collections.abc import Mapping

import numpy as np

from geom2iga.bspline import Array
from geom2iga.patch import Patch
from solve.bricks import Brick, find_bricks
from solve.metric import map_of, scaling
from solve.rules import gauss_rule
from solve.space import Space

log = logging.getLogger("geom2iga")

LARGE = 0.1  # principal strain from which on what small deformation leaves out is about a tenth of the answer

SPANS = 30_000  # in a brick, of one point each


def warn_of_strain(space: Space, displacement: Array) -> None:
    """Log a warning for each body whose strains are not small.

    Parameters
    ----------
    displacement : (n, 3)
        Of all control points [length].
    """
    for body, found in largest_strains(space, displacement).items():
        if found > LARGE:
            log.warning(
                'warning: body "%s": strains reach %.2g: small deformation no longer holds, check the units of loads '
                "and moduli",
                *(body, found),
            )


def largest_strains(space: Space, displacement: Array) -> Mapping[str, float]:
    """Find the largest size of a principal strain in each body, of those in the middle of its spans."""
    model = space.model
    return {
        body: max(_largest(model.patches[name], displacement[space.numbers[name]]) for name in patches)
        for body, patches in model.bodies.items()
    }


def _largest(patch: Patch, displacement: Array) -> float:
    """The same of a patch, from displacements (n, 3) of its control points."""
    first, second, third = (gauss_rule(knots, 1) for knots in patch.knots)
    scaled = np.moveaxis(displacement.reshape(*patch.shape, 3) * scaling(patch)[..., None], -1, 0)
    bricks = find_bricks(patch, (first, second, third), spans=SPANS)
    return max(_largest_in(brick, patch, scaled[:, *brick.functions]) for brick in bricks)


def _largest_in(brick: Brick, patch: Patch, coefficients: Array) -> float:
    """The same at the points of a brick, from displacements times weights (3, n_1, n_2, n_3)."""
    cofactors, determinant, weight, slopes = map_of(brick, patch)
    sampled = brick.gradients(coefficients, values=True)
    rates = sampled[:, :3] if slopes is None else sampled[:, :3] - sampled[:, 3:] * slopes
    gradient = np.einsum("iaq,ajq->qij", rates, cofactors) / (determinant * weight)[:, None, None]
    strain = (gradient + gradient.swapaxes(1, 2)) / 2
    return float(np.abs(np.linalg.eigvalsh(strain)).max())
