"""The map of a patch at the points of a brick."""

from typing import NamedTuple

import numpy as np

from geom2iga.bspline import Array
from geom2iga.errors import GeometryError
from geom2iga.patch import Patch
from solve.bricks import Brick, Floats, find_bricks, line
from solve.rules import Rules
from solve.space import is_straight, middle_jacobian


class Metric(NamedTuple):
    """What turns gradients of B-splines into physical ones, scaled so that squares of these sum up to integrals."""

    inverse: Floats  # (3, 3, q) sqrt(scale det J w) / W dxi_α/dx_j
    slopes: Floats | None  # (3, q) dW/dxi_α / W; None where all weights are the same

    def rounded(self, precision: np.dtype) -> "Metric":
        """The same in another precision."""
        inverse, slopes = self
        return Metric(inverse.astype(precision, copy=False), slopes if slopes is None else slopes.astype(precision))


class Map(NamedTuple):
    """The map of a patch at the q points of a brick."""

    cofactors: Floats  # (3, 3, q) det J dxi_α/dx_j
    determinant: Floats  # (q,) det J, positive
    weight: Floats  # (q,) or (1,) W
    slopes: Floats | None  # (3, q) dW/dxi_α / W; None where all weights are the same


def scaling(patch: Patch) -> Array:
    """What turns coefficients of NURBS into those of B-splines over W: weights, where these differ; (n_1, n_2, n_3)."""
    return patch.weights if patch.is_rational else np.ones(patch.shape)


def map_of(brick: Brick, patch: Patch) -> Map:
    """Evaluate the map of a patch at the points of a brick.

    Raises
    ------
    GeometryError
        The Jacobian is not positive at a point.
    """
    box, weight, slopes = brick.functions, np.ones(1), None
    points = patch.control_points - patch.control_points[0, 0, 0]  # so that a place far away costs no digits
    if patch.is_rational:
        homogeneous = np.concatenate([points * patch.weights[..., None], patch.weights[..., None]], axis=-1)
        sampled = brick.gradients(np.moveaxis(homogeneous, -1, 0)[:, *box], values=True)
        weight = sampled[3, 3]
        slopes = sampled[3, :3] / weight
        tangents = (sampled[:3, :3] - sampled[:3, 3:] * slopes) / weight
    else:
        tangents = brick.gradients(np.moveaxis(points, -1, 0)[:, *box])
    cofactors, determinant = cofactors_of(tangents)
    if determinant.min() <= 0:
        worst = int(np.argmin(determinant))
        at = ", ".join(f"{x:.3g}" for x in brick.point(worst))
        raise GeometryError(
            f'patch "{patch.name}": Jacobian {determinant[worst]:.3g} at xi = ({at}): the patch is folded there'
        )
    return Map(cofactors, determinant, weight, slopes)


def metric_of(brick: Brick, patch: Patch, scale: float) -> Metric:
    """Evaluate what turns gradients into physical ones; raise GeometryError as `map_of` does."""
    cofactors, determinant, weight, slopes = map_of(brick, patch)
    cofactors *= np.sqrt(scale * brick.weights / determinant) / weight
    return Metric(cofactors, slopes)


def shares_of(patch: Patch, rules: Rules) -> Array:
    """Integrate each basis function over a volume: ∫ R_a dV, (n_1, n_2, n_3) [length³]."""
    shares = np.zeros(patch.shape)
    if is_straight(patch):
        each = (line(*along) for along in zip(patch.knots, patch.degrees, rules, strict=True))
        first, second, third = (piece.weights @ piece.values for piece in each)
        return np.linalg.det(middle_jacobian(patch)) * first[:, None, None] * second[:, None] * third
    for brick in find_bricks(patch, rules):
        _, determinant, weight, _ = map_of(brick, patch)
        shares[brick.functions] += brick.moments((determinant * brick.weights / weight)[None])[0]
    return shares * scaling(patch)


def cofactors_of(tangents: Floats) -> tuple[Floats, Floats]:
    """From dx_j/dxi_α (3, 3, q) to det J dxi_α/dx_j (3, 3, q) and det J (q,)."""
    cofactors = np.empty_like(tangents)
    for d in range(3):
        cofactors[d] = _crossed(tangents[:, d - 2], tangents[:, d - 1])
    return cofactors, np.einsum("jq,jq->q", tangents[:, 0], cofactors[0])


def _crossed(one: Floats, other: Floats) -> Floats:
    """Cross products of vectors (3, q)."""
    return np.stack([one[i - 2] * other[i - 1] - one[i - 1] * other[i - 2] for i in range(3)])
