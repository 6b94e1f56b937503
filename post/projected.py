"""Stress as a smooth field: the spline nearest to it in the mean square, body by body.

Derivatives of splines jump at knots and between patches; of all fields of the spline space that displacements are
sought in, the L² projection is nearest to them: ∫ R_a (Σ_b R_b c_b - stress) dV = 0. The mass matrix is applied by sum
factorisation and never stored. Conjugate gradients take few iterations whatever the mesh and the degree, for with
D its diagonal and C_1, C_2, C_3 the mass matrices of the three directions, each with its rows and columns scaled so
that its diagonal is one, D^½ (C_1 x C_2 x C_3) D^½ is near it (Loli, Sangalli & Tani 2022); of patches that are glued
the inverses add up, each weighted by the share of its patch in D.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator, cg

from geom2iga.bspline import Array, Indices, applied
from geom2iga.errors import GeometryError
from geom2iga.patch import Patch
from post.gauss import gauss_bricks
from solve.bricks import Brick, line
from solve.metric import scaling
from solve.result import Result
from solve.rules import exact_rules, gauss_rule
from solve.space import Space

EXACT = 1e-13  # residual over the right-hand side at which iterations end
MOST_ITERATIONS = 500


class Sampled(NamedTuple):
    """A field at the points of a brick."""

    brick: Brick
    weight: Array  # (q,) volume that a point stands for [length³]
    values: Array  # (q, k)


Field = Callable[[str], Iterable[Sampled]]  # from the name of a patch


def project_stress(result: Result) -> dict[str, Array]:
    """Project the stress on the spline space.

    It is continuous within a body, as the displacement is, and may jump between bodies, at contacts and materials.

    Returns
    -------
    dict
        Patch name to control-point values (n, 6) in its flat numbering: xx yy zz xy yz xz, tension positive.

    Raises
    ------
    GeometryError
        A map is folded, or so distorted that the iterations do not end.
    """
    rules = exact_rules(result.space)
    found: dict[str, Array] = {}

    def field(name: str) -> Iterable[Sampled]:
        return (Sampled(brick, at.weight, at.stress) for brick, at in gauss_bricks(result, name, rules[name]))

    for body in result.model.bodies:
        found |= project(result.space, body, field)
    return found


def project(space: Space, body: str, field: Field) -> dict[str, Array]:
    """Project any field on the spline space of a body.

    Returns
    -------
    dict
        Patch name to control-point values (n, k).

    Raises
    ------
    GeometryError
        The iterations do not end.
    """
    numbers = space.body_numbers(body)
    local = {name: np.searchsorted(numbers, space.numbers[name]) for name in space.model.bodies[body]}
    parts = {name: _part(space.model.patches[name], own, len(numbers), field(name)) for name, own in local.items()}
    mass = _Mass(body, list(parts.values()), len(numbers))
    coefficients = mass.solved(np.sum([part.spread @ part.moments for part in parts.values()], axis=0))
    return {name: coefficients[own] for name, own in local.items()}


@dataclass(frozen=True, eq=False)
class _Part:
    """What a patch gives to the mass matrix.

    Parameters
    ----------
    shape : (3,)
    numbers : (n,)
        Of its control points in the body.
    spread : (size, n)
        Adds up what they have.
    scaling : (n_1, n_2, n_3)
        Weights of its control points.
    bricks : tuple of Brick
    densities : tuple of (q,)
        det J w / W² at the points of each.
    inverses : three (n_d, n_d)
        C_d^-1
    diagonal : (n,)
        D
    moments : (n, k)
        Integrals of each function times the field.
    """

    shape: tuple[int, ...]
    numbers: Indices
    spread: csr_array
    scaling: Array
    bricks: tuple[Brick, ...]
    densities: tuple[Array, ...]
    inverses: tuple[Array, ...]
    diagonal: Array
    moments: Array

    def applied(self, coefficients: Array) -> Array:
        """Multiply the mass matrix into coefficients (n, k)."""
        grid = np.ascontiguousarray(coefficients.T).reshape(-1, *self.shape) * self.scaling
        found = np.zeros_like(grid)
        for brick, density in zip(self.bricks, self.densities, strict=True):
            values = brick.evaluated(grid[:, *brick.functions])
            values *= density
            found[:, *brick.functions] += brick.moments(values)
        found *= self.scaling
        return found.reshape(len(found), -1).T

    def conditioned(self, residual: Array) -> Array:
        """Multiply C_1^-1 x C_2^-1 x C_3^-1 into residuals (n, k)."""
        grid = np.ascontiguousarray(residual.T).reshape(-1, *self.shape)
        for axis, inverse in enumerate(self.inverses, start=1):
            grid = applied(inverse, grid, axis)
        return grid.reshape(len(grid), -1).T


class _Mass:
    """The mass matrix of a body, its rows and columns scaled so that its diagonal is one."""

    def __init__(self, body: str, parts: Sequence[_Part], size: int) -> None:
        self._body, self._parts, self._size = body, parts, size
        diagonal = np.sum([part.spread @ part.diagonal for part in parts], axis=0)
        self._scale = 1 / np.sqrt(diagonal)[:, None]
        self._shares = [np.sqrt(part.diagonal)[:, None] * self._scale[part.numbers] for part in parts]

    def solved(self, right: Array) -> Array:
        """Solve for coefficients (size, k)."""
        shape = (right.size, right.size)
        matrix, near = (LinearOperator(shape, apply, dtype=float) for apply in (self._applied, self._conditioned))
        scaled = (right * self._scale).ravel()
        found, left = cg(matrix, scaled, rtol=EXACT, maxiter=MOST_ITERATIONS, M=near)
        if left:
            raise GeometryError(
                f'body "{self._body}": the smooth stress was not found in {MOST_ITERATIONS} iterations; its patches '
                "are too distorted: look at the quality of their maps"
            )
        return found.reshape(right.shape) * self._scale

    def _applied(self, scaled: Array) -> Array:
        """Apply D^-½ M D^-½."""
        coefficients = scaled.reshape(self._size, -1) * self._scale
        total = sum(part.spread @ part.applied(np.take(coefficients, part.numbers, axis=0)) for part in self._parts)
        return (total * self._scale).ravel()

    def _conditioned(self, residual: Array) -> Array:
        """Apply the preconditioner."""
        rows, total = residual.reshape(self._size, -1), np.zeros((self._size, 1))
        for part, share in zip(self._parts, self._shares, strict=True):
            total = total + part.spread @ (part.conditioned(np.take(rows, part.numbers, axis=0) * share) * share)
        return total.ravel()


def _part(patch: Patch, numbers: Indices, size: int, field: Iterable[Sampled]) -> _Part:
    """Integrate what is needed of a patch."""
    factors = scaling(patch)
    bricks: list[Brick] = []
    densities: list[Array] = []
    moments, diagonal = np.zeros((0, *patch.shape)), np.zeros((1, *patch.shape))
    for brick, volume, values in field:
        box = brick.functions
        weight = brick.evaluated(factors[None, *box])[0]
        if not bricks:
            moments = np.zeros((values.shape[1], *patch.shape))
        moments[:, *box] += brick.moments(np.ascontiguousarray(values.T) * (volume / weight))
        bricks.append(brick)
        densities.append(volume / weight**2)
        diagonal[:, *box] += squared(brick).moments(densities[-1][None])
    return _Part(
        patch.shape,
        numbers,
        csr_array((np.ones(len(numbers)), (numbers, np.arange(len(numbers)))), shape=(size, len(numbers))),
        factors,
        tuple(bricks),
        tuple(densities),
        tuple(_correlation_inverse(*along) for along in zip(patch.knots, patch.degrees, strict=True)),
        (diagonal[0] * factors**2).ravel(),
        (moments * factors).reshape(len(moments), -1).T,
    )


def _correlation_inverse(knots: Array, degree: int) -> Array:
    """C^-1 (n, n) of a direction."""
    piece = line(knots, degree, gauss_rule(knots, degree + 1))
    mass = (piece.values.T * piece.weights) @ piece.values
    scale = 1 / np.sqrt(mass.diagonal())
    return np.linalg.inv(mass * scale[:, None] * scale)


def squared(brick: Brick) -> Brick:
    """The brick with the squares of its functions in their place."""
    first, second, third = (piece._replace(values=piece.values**2) for piece in brick.pieces)
    return Brick((first, second, third))
