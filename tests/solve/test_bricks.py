import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geom2iga.patch import Patch, basis
from solve.bricks import find_bricks
from solve.rules import gauss_rule, smooth_rule
from tests.strategies import SEEDS, patches

SIZES = st.sampled_from([1, 4, 512])  # spans of a brick
RULES = {
    "Gauss": lambda patch: tuple(
        gauss_rule(knots, degree + 1) for knots, degree in zip(patch.knots, patch.degrees, strict=True)
    ),
    "smooth": lambda patch: tuple(map(smooth_rule, patch.knots, patch.degrees)),
}


def cut(patch, size=512, rules="Gauss", precision=float):
    return list(find_bricks(patch, RULES[rules](patch), precision, size))


def points_of(brick):
    return np.array([brick.point(number) for number in range(len(brick.weights))])


def splines(patch, coefficients, xi):
    """Derivatives (c, 3, q) and values (c, 1, q) of splines (without weights) with coefficients (c, n_1, n_2, n_3)."""
    plain = Patch(patch.name, patch.degrees, patch.knots, patch.control_points)
    functions = basis(plain, xi, 1)
    local = coefficients.reshape(len(coefficients), -1)[:, functions.indices]
    slopes = np.einsum("cqa,qad->cdq", local, functions.gradients)
    return slopes, np.einsum("cqa,qa->cq", local, functions.values)[:, None]


@given(patches((3,), 4), SEEDS, SIZES, st.sampled_from(list(RULES)))
def test_bricks_differentiate_and_evaluate_splines_as_their_basis_does(patch, seed, size, rules):
    coefficients = np.random.default_rng(seed).normal(size=(2, *patch.shape))
    for brick in cut(patch, size, rules):
        own = coefficients[:, *brick.functions]
        slopes, values = splines(patch, coefficients, points_of(brick))
        tolerance = 1e-11 * np.abs(slopes).max()
        np.testing.assert_allclose(brick.gradients(own), slopes, rtol=0, atol=tolerance)
        both = brick.gradients(own, values=True)
        np.testing.assert_allclose(both[:, :3], slopes, rtol=0, atol=tolerance)
        np.testing.assert_allclose(both[:, 3:], values, rtol=0, atol=1e-12 * np.abs(values).max())


@given(patches((3,), 4), SEEDS, SIZES, st.booleans())
def test_integration_is_the_transpose_of_differentiation(patch, seed, size, values):
    random = np.random.default_rng(seed)
    for brick in cut(patch, size):
        coefficients = random.normal(size=(3, *[part.stop - part.start for part in brick.functions]))
        gradients = brick.gradients(coefficients, values)
        fluxes = random.normal(size=gradients.shape)
        integrated = brick.integrated(fluxes)
        assert integrated.shape == coefficients.shape
        scale = np.linalg.norm(fluxes) * np.linalg.norm(gradients)
        assert abs(np.vdot(gradients, fluxes) - np.vdot(coefficients, integrated)) <= 1e-12 * scale


@given(patches((3,), 3), SIZES, st.sampled_from(list(RULES)))
def test_bricks_hold_every_point_of_the_rules_once_with_its_weight(patch, size, rules):
    parts = cut(patch, size, rules)
    found = np.concatenate([points_of(brick) for brick in parts])
    weights = np.concatenate([brick.weights for brick in parts])
    along = RULES[rules](patch)
    expected = np.stack(np.meshgrid(*[rule.points for rule in along], indexing="ij"), axis=-1).reshape(-1, 3)
    products = np.einsum("i,j,k->ijk", *[rule.weights for rule in along]).ravel()
    order, other = np.lexsort(found.T), np.lexsort(expected.T)
    np.testing.assert_array_equal(found[order], expected[other])
    np.testing.assert_allclose(weights[order], products[other], rtol=1e-14)


@given(patches((3,), 3), SIZES)
def test_bricks_have_few_spans_and_only_functions_that_live_on_them(patch, size):
    for brick in cut(patch, size):
        spans = np.prod(
            [len(np.unique(np.searchsorted(at, p.points))) for at, p in zip(patch.breaks, brick.pieces, strict=True)]
        )
        assert spans <= 2 * size
        for piece in brick.pieces:
            assert np.all(np.abs(piece.values).max(axis=0) > 0)


@pytest.mark.parametrize("values", [False, True])
def test_in_single_precision_bricks_stay_in_single_precision_and_are_as_exact_as_it_allows(values):
    random = np.random.default_rng(0)
    knots = np.array([0, 0, 0, 0.3, 1, 1, 1.0])
    patch = Patch("cube", (2, 2, 2), (knots,) * 3, random.normal(size=(4, 4, 4, 3)))
    (fine,), (coarse,) = cut(patch), cut(patch, precision=np.float32)
    coefficients = random.normal(size=(3, 4, 4, 4))
    exact, rounded = fine.gradients(coefficients, values), coarse.gradients(coefficients.astype(np.float32), values)
    assert rounded.dtype == coarse.integrated(rounded).dtype == np.float32
    np.testing.assert_allclose(rounded, exact, rtol=0, atol=1e-5 * np.abs(exact).max())
    back = fine.integrated(exact)
    np.testing.assert_allclose(coarse.integrated(rounded), back, rtol=0, atol=1e-5 * np.abs(back).max())
