import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from geom2iga.patch import elevated, evaluate
from geom2iga.quality import bernstein
from tests.cases import bent_patch
from tests.oracles import assert_same_map
from tests.strategies import SEEDS, bent_patches

DEGREES = st.tuples(*[st.integers(0, 5)] * 3)


def valued(coefficients, xi):
    """Values (..., q, q, q) of polynomials (..., n_1, n_2, n_3) on the grid of xi (q,)."""
    for axis in (-3, -2, -1):
        degree = coefficients.shape[axis] - 1
        table = bernstein.values(degree, xi)[0] if degree else np.ones((len(xi), 1))
        coefficients = bernstein.along(table, coefficients, axis)
    return coefficients


@given(SEEDS, DEGREES, DEGREES)
def test_a_product_has_the_values_of_its_factors_multiplied(seed, first_degrees, second_degrees):
    random = np.random.default_rng(seed)
    first = random.normal(size=(2, 3, *(p + 1 for p in first_degrees)))
    second = random.normal(size=(2, 3, *(p + 1 for p in second_degrees)))
    found = bernstein.product(bernstein.scaled(first, 3), bernstein.scaled(second, 3))
    xi = np.linspace(0, 1, 4)
    expected = (valued(first, xi) * valued(second, xi)).sum(axis=1)
    np.testing.assert_allclose(valued(bernstein.unscaled(found, 3), xi), expected, atol=1e-13)


@given(SEEDS, st.integers(1, 24))
def test_the_halves_of_a_polynomial_have_its_values(seed, degree):
    coefficients = np.random.default_rng(seed).normal(size=degree + 1)
    xi = np.linspace(0, 1, 7)
    for half, shift in zip(bernstein.halves(degree), (0.0, 0.5), strict=True):
        found = bernstein.values(degree, xi)[0] @ half @ coefficients
        expected = bernstein.values(degree, shift + xi / 2)[0] @ coefficients
        np.testing.assert_allclose(found, expected, atol=1e-13)


@given(bent_patches())
def test_elements_have_the_positions_of_their_patch(patch):
    pieces = bernstein.bezier(patch)
    assert_same_map(pieces, patch)
    spans = np.prod([len(at) - 1 for at in patch.breaks])
    coefficients, start, size = bernstein.elements(pieces, slice(1, spans))  # all but the first
    assert len(coefficients) == spans - 1
    middles = valued(coefficients, np.array([0.5]))[..., 0, 0, 0]
    np.testing.assert_allclose(middles[:, :3] / middles[:, 3:], evaluate(patch, start + size / 2)[0], atol=1e-13)


def test_a_patch_of_bezier_spans_is_left_as_it_is():
    patch = bent_patch(0, (2, 1, 3), (1, 2, 1))
    assert bernstein.bezier(patch) is patch
    assert bernstein.bezier(elevated(patch, (2, 2, 3))).shape == (3, 5, 4)
