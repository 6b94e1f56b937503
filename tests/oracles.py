"""Laws that many tests assert."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import prod
from typing import Any, NamedTuple

import numpy as np

from geom2iga.bspline import Array, Indices
from geom2iga.errors import GeometryError
from geom2iga.model import Model
from geom2iga.patch import CHUNK, Patch, basis, chunks, evaluate
from solve.material import Material
from solve.space import Space, gauss_points, point_counts
from tests.cases import sample_points


def assert_symmetric(matrix: Any, tolerance: float = 1e-12) -> None:
    """A matrix, sparse or not, equals its transpose, up to a fraction of its largest entry."""
    assert abs(matrix - matrix.T).max() <= tolerance * abs(matrix).max()


def assert_tangent(
    function: Callable[[Array], Any], derivative: Any, at: Array, step: float = 1e-6, tolerance: float = 1e-6
) -> None:
    """A derivative (..., n) of a function of (n,) equals central differences, up to a fraction of its largest entry."""
    columns = [
        (np.asarray(function(at + step * axis)) - np.asarray(function(at - step * axis))) / (2 * step)
        for axis in np.eye(len(at))
    ]
    differences = np.stack(columns, axis=-1)
    scale = max(np.abs(differences).max(initial=0.0), np.abs(np.asarray(derivative)).max(initial=0.0), 1e-12)
    np.testing.assert_allclose(derivative, differences, rtol=0, atol=tolerance * scale)


def assert_order(errors: Sequence[float], sizes: Sequence[float], order: float, tolerance: float = 0.15) -> None:
    """Errors on the finest two of several sizes fall with a power of the size."""
    observed = np.log(errors[-2] / errors[-1]) / np.log(sizes[-2] / sizes[-1])
    assert abs(observed - order) <= tolerance, f"observed order {observed:.3f}, expected {order}; errors {errors}"


def assert_rigid_motion_costs_nothing(operator: Any, points: Array, tolerance: float = 1e-11) -> None:
    """A matrix (r, 3 n) takes the three slides and the three turns of points (n, 3) to zero, up to rounding."""
    size = np.ptp(points, axis=0).max()
    arm = (points - points.mean(axis=0)) / size
    motions = [np.broadcast_to(axis, points.shape) for axis in np.eye(3)] + [np.cross(axis, arm) for axis in np.eye(3)]
    for motion in motions:
        assert np.abs(operator @ motion.ravel()).max() <= tolerance * abs(operator).max()


def assert_balanced(forces: Array, points: Array, tolerance: float = 1e-12) -> None:
    """Forces (n, 3) at points (n, 3) add up to no force and no moment, up to a fraction of the sum of their sizes."""
    total = np.linalg.norm(forces, axis=1).sum()
    assert np.abs(forces.sum(axis=0)).max() <= tolerance * total
    assert np.abs(np.cross(points, forces).sum(axis=0)).max() <= tolerance * total * max(1.0, np.abs(points).max())


def assert_round_trip(there: Callable[[Any], Any], back: Callable[[Any], Any], thing: Any, same: Any) -> None:
    """There and back again gives the same thing; `same` asserts that two things are."""
    same(back(there(thing)), thing)


def assert_same_patch(found: Patch, expected: Patch) -> None:
    """Two patches agree bit for bit."""
    assert (found.name, found.degrees) == (expected.name, expected.degrees)
    assert [knots.tobytes() for knots in found.knots] == [knots.tobytes() for knots in expected.knots]
    for name in ("control_points", "weights"):
        assert getattr(found, name).shape == getattr(expected, name).shape
        assert getattr(found, name).tobytes() == getattr(expected, name).tobytes(), name


def assert_same_model(found: Model, expected: Model) -> None:
    """Two models agree bit for bit, and in the sequence of all names."""
    for name in ("patches", "bodies", "groups"):
        assert list(getattr(found, name)) == list(getattr(expected, name)), name
    assert dict(found.bodies) == dict(expected.bodies)
    assert dict(found.groups) == dict(expected.groups)
    assert found.glued == expected.glued
    for name, patch in expected.patches.items():
        assert_same_patch(found.patches[name], patch)


def assert_same_map(found: Patch, expected: Patch, tolerance: float = 1e-13) -> None:
    """Two patches map the same parametric points to the same places, up to a fraction of the farthest control point."""
    xi = sample_points(expected)
    scale = np.abs(expected.control_points).max()
    np.testing.assert_allclose(evaluate(found, xi)[0], evaluate(expected, xi)[0], rtol=0, atol=tolerance * scale)


def stiffness_by_spans(space: Space, materials: Mapping[str, Material]) -> Array:
    """The stiffness matrix (dofs, dofs), dense: the weak form at all points, added up span by span."""
    stiffness = np.zeros((space.size, 3, space.size, 3))
    for name, patch in space.model.patches.items():
        lame, mu = materials[space.model.body_of(name)].lame
        for part in volume_quadrature(patch, space.point_counts[name]):
            products = np.einsum("eqai,eqbj,eq->eaibj", part.gradients, part.gradients, part.volume, optimize=True)
            shear = np.einsum("eakbk,ij->eaibj", products, np.eye(3))
            local = lame * products + mu * (products.swapaxes(2, 4) + shear)
            numbers = space.numbers[name][part.indices]
            np.add.at(stiffness, (numbers[:, :, None], slice(None), numbers[:, None]), local.swapaxes(2, 3))
    return stiffness.reshape(space.dofs, space.dofs)


class Quadrature(NamedTuple):
    """Basis functions of a volume at its Gauss points, for a run of whole spans."""

    indices: Indices  # (e, a) flat control-point numbers of the patch
    values: Array  # (e, q, a)
    gradients: Array  # (e, q, a, 3) with respect to position [1/length]
    volume: Array  # (e, q) [length^3]


def volume_quadrature(patch: Patch, counts: Sequence[int] | None = None) -> Iterator[Quadrature]:
    """Yield the quadrature tables of a volume, as many spans at a time as fit a bounded memory.

    Parameters
    ----------
    counts : (3,)
        Gauss points per span and direction; left out, `point_counts`.

    Raises
    ------
    GeometryError
        The Jacobian is not positive at a Gauss point.
    """
    points = gauss_points(patch, point_counts(patch) if counts is None else counts)
    per_span, width = points.per_span, prod(p + 1 for p in patch.degrees)
    run = per_span * max(1, CHUNK // (9 * width * max(per_span, width)))
    for part in chunks(len(points.xi), run):
        functions = basis(patch, points.xi[part], 1, points.spans[part])
        local = patch.control_points.reshape(-1, 3)[functions.indices]
        jacobian = np.einsum("qak,qad->qkd", local, functions.gradients, optimize=True)
        determinant = np.linalg.det(jacobian)
        if determinant.min() <= 0:
            worst = np.argmin(determinant)
            at = ", ".join(f"{x:.3g}" for x in points.xi[part][worst])
            raise GeometryError(
                f'patch "{patch.name}": Jacobian {determinant[worst]:.3g} at xi = ({at}): the patch is folded there'
            )
        gradients = functions.gradients @ np.linalg.inv(jacobian)
        yield Quadrature(
            functions.indices[::per_span],
            functions.values.reshape(-1, per_span, width),
            gradients.reshape(-1, per_span, width, 3),
            (determinant * points.weights[part]).reshape(-1, per_span),
        )
