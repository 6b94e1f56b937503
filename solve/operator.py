"""Stiffness of isotropic linear elasticity as an operator that is applied and never stored."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator

from geom2iga.bspline import Array, Indices
from geom2iga.patch import Patch
from geom2iga.threads import thread_count
from solve.bricks import SPANS, THREADED, Brick, Empty, Floats, Scratch, find_bricks
from solve.material import Material
from solve.metric import Metric, metric_of, scaling
from solve.rules import Rules
from solve.space import Space, is_straight, middle_jacobian

SCRATCH = Scratch()


class Curved(NamedTuple):
    """Elasticity at the points of a brick whose map is curved."""

    metric: Metric  # scaled by sqrt(µ)
    ratio: float  # λ/µ

    def rounded(self, precision: np.dtype) -> "Curved":
        """The same in another precision."""
        return Curved(self.metric.rounded(precision), self.ratio)

    def forces(self, brick: Brick, coefficients: Floats, empty: Empty) -> Floats:
        """Forces (3, n_1, n_2, n_3) on the control points of a brick from their displacements."""
        inverse, slopes = self.metric
        gradients = brick.gradients(coefficients, slopes is not None, empty)
        if slopes is not None:
            gradients[:, :3] -= gradients[:, 3:] * slopes
        strain = empty((3, 3, gradients.shape[2]), gradients.dtype)
        np.einsum("iaq,ajq->ijq", gradients[:, :3], inverse, out=strain)
        pressure = self.ratio * (strain[0, 0] + strain[1, 1] + strain[2, 2])
        for i in range(3):
            for j in range(i):
                strain[i, j] += strain[j, i]
                strain[j, i] = strain[i, j]
            strain[i, i] *= 2
            strain[i, i] += pressure
        np.einsum("ijq,ajq->iaq", strain, inverse, out=gradients[:, :3])
        if slopes is not None:
            np.einsum("iaq,aq->iq", gradients[:, :3], -slopes, out=gradients[:, 3])
        return brick.integrated(gradients, empty)


class Straight(NamedTuple):
    """An affine map at the q points of a brick: the same elasticity tensor in the parameters everywhere."""

    tensor: Floats  # (9, 9) from du_i/dxi_α to what is conjugate to it
    weights: Floats  # (q,) parametric

    def rounded(self, precision: np.dtype) -> "Straight":
        """The same in another precision."""
        return Straight(self.tensor.astype(precision), self.weights.astype(precision, copy=False))

    def forces(self, brick: Brick, coefficients: Floats, empty: Empty) -> Floats:
        """Forces (3, n_1, n_2, n_3) on the control points of a brick from their displacements."""
        gradients = brick.gradients(coefficients, empty=empty)
        fluxes = empty((9, len(self.weights)), gradients.dtype)
        np.matmul(self.tensor, gradients.reshape(fluxes.shape), out=fluxes)
        fluxes *= self.weights
        return brick.integrated(fluxes.reshape(gradients.shape), empty)


def straight(patch: Patch, material: Material) -> Array:
    """The elasticity tensor (9, 9) of an affine map in the parameters: λ A_αi A_βj + µ A_αj A_βi + µ δ_ij A_αk A_βk."""
    jacobian = middle_jacobian(patch)
    inverse, (lame, shear) = np.linalg.inv(jacobian), material.lame
    tensor = lame * np.einsum("ai,bj->iajb", inverse, inverse) + shear * np.einsum("aj,bi->iajb", inverse, inverse)
    tensor += shear * np.einsum("ij,ak,bk->iajb", np.eye(3), inverse, inverse)
    return np.linalg.det(jacobian) * tensor.reshape(9, 9)


@dataclass(frozen=True, eq=False)
class _Part:
    """A patch: where its control points are, and what to do on each of its bricks."""

    shape: tuple[int, ...]
    scaling: Floats | None  # of coefficients
    numbers: Indices
    spread: csr_array
    bricks: tuple[Brick, ...]
    metric: Callable[[int], Curved | Straight]  # of a brick

    def forces(self, number: int, displacement: Floats) -> Floats:
        """Forces of one brick from the displacements (3, n_1, n_2, n_3) of the patch."""
        brick = self.bricks[number]
        return self.metric(number).forces(brick, displacement[:, *brick.functions], SCRATCH.restart())


class Stiffness(LinearOperator):
    """K u = ∫ λ div u div v + 2 µ ε(u):ε(v) dV by sum factorisation, brick by brick.

    Parameters
    ----------
    space : Space
    materials : body name to Material
    rules : patch name to three Rule
        Quadrature points of each direction.
    precision : dtype
        float, or float32 for half of the time and memory.
    stored : bool
        Whether the map is evaluated once, at nine to twelve numbers per point, or in each application.

    Raises
    ------
    GeometryError
        A patch with a Jacobian that is not positive, here or, where nothing is stored, when it is applied.
    """

    def __init__(
        self,
        space: Space,
        materials: Mapping[str, Material],
        rules: Mapping[str, Rules],
        precision: DTypeLike = float,
        stored: bool = True,
    ) -> None:
        super().__init__(np.dtype(precision), (space.dofs, space.dofs))
        self._threads = thread_count()
        self._pool = ThreadPoolExecutor(self._threads)
        self._parts = [
            self._part(space, name, materials[space.model.body_of(name)], rules[name], stored)
            for name in space.model.patches
        ]

    def _part(self, space: Space, name: str, material: Material, rules: Rules, stored: bool) -> _Part:
        """Cut a patch into bricks."""
        patch, numbers = space.model.patches[name], space.numbers[name]
        spread = space.spread(name).astype(self.dtype)
        factors = scaling(patch).astype(self.dtype) if patch.is_rational else None
        spans = SPANS * THREADED if self._threads > 1 else SPANS
        exact = tuple(find_bricks(patch, rules, float, spans))
        bricks = exact if self.dtype == float else tuple(find_bricks(patch, rules, self.dtype, spans))
        tensor = straight(patch, material) if is_straight(patch) else None

        def metric(number: int) -> Curved | Straight:
            brick = exact[number]
            if tensor is not None:
                return Straight(tensor, brick.weights).rounded(self.dtype)
            lame, shear = material.lame
            return Curved(metric_of(brick, patch, shear), lame / shear).rounded(self.dtype)

        if stored:
            return _Part(
                patch.shape,
                factors,
                numbers,
                spread,
                bricks,
                list(self._pool.map(metric, range(len(bricks)))).__getitem__,
            )
        return _Part(patch.shape, factors, numbers, spread, bricks, metric)

    def _matvec(self, displacement: Floats) -> Floats:
        """Forces (dofs,) from displacements (dofs,)."""
        result = np.zeros((self.shape[0] // 3, 3), dtype=self.dtype)
        points = displacement.astype(self.dtype, copy=False).reshape(-1, 3)
        for part in self._parts:
            result += part.spread @ self._forces(part, np.take(points, part.numbers, axis=0))
        return result.ravel()

    def _forces(self, part: _Part, displacement: Floats) -> Floats:
        """Forces (n, 3) on the control points of a patch."""
        grid = np.ascontiguousarray(displacement.T).reshape(3, *part.shape)
        if part.scaling is not None:
            grid *= part.scaling
        forces = np.zeros_like(grid)
        mapped = self._pool.map if min(self._threads, len(part.bricks)) > 1 else map
        found = mapped(partial(part.forces, displacement=grid), range(len(part.bricks)))
        for brick, local in zip(part.bricks, found, strict=True):
            forces[:, *brick.functions] += local
        if part.scaling is not None:
            forces *= part.scaling
        return np.ascontiguousarray(forces.reshape(3, -1).T)
