from itertools import combinations
from math import comb, prod

import numpy as np
import pytest
import splinepy
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from geom2iga import bspline
from geom2iga.bspline import open_knots
from tests.oracles import assert_tangent
from tests.strategies import SEEDS, graded_breaks, open_knot_vectors


def dense_basis(knots, degree, xi, order=0):
    """All basis functions at points, (order + 1, q, n)."""
    first, values = bspline.basis(knots, degree, xi, order)
    dense = np.zeros((order + 1, len(xi), len(knots) - degree - 1))
    np.put_along_axis(dense, np.broadcast_to(first[:, None] + np.arange(degree + 1), values.shape), values, axis=2)
    return dense


def points_over(knots, count=15):
    """Points anywhere, on every knot line and at both ends."""
    inside = np.random.default_rng(0).uniform(knots[0], knots[-1], count)
    return np.concatenate([inside, np.unique(knots)])


def inserted_knots(draw, knots, degree):
    """New knots, anew or onto old ones, but never more than `degree` at one place."""
    at, counts = np.unique(knots, return_counts=True)
    onto = [b for b, k in zip(at[1:-1], counts[1:-1], strict=True) for _ in range(draw(st.integers(0, degree - k)))]
    shares = draw(st.lists(st.floats(0.01, 0.99), max_size=4, unique=True))
    return np.array([*onto, *(at[0] + np.array(shares) * (at[-1] - at[0]))])


@given(open_knot_vectors())
def test_basis_functions_and_up_to_three_derivatives_equal_scipys(spline):
    knots, degree = spline
    xi = points_over(knots)
    expected = BSpline(knots, np.eye(len(knots) - degree - 1), degree)
    for order, found in enumerate(dense_basis(knots, degree, xi, min(3, degree))):  # beyond, scipy 1.13 crashes
        np.testing.assert_allclose(found, expected(xi, order), rtol=0, atol=1e-13 * max(1, abs(found).max()))


@given(open_knot_vectors())
def test_basis_functions_are_nonnegative_and_sum_to_one(spline):
    knots, degree = spline
    values = dense_basis(knots, degree, points_over(knots), 1)
    assert values[0].min() >= 0
    np.testing.assert_allclose(values[0].sum(axis=1), 1, rtol=0, atol=1e-14)
    np.testing.assert_allclose(values[1].sum(axis=1), 0, rtol=0, atol=1e-13 * abs(values[1]).max())


@given(open_knot_vectors())
def test_only_the_first_and_last_function_live_at_the_ends(spline):
    knots, degree = spline
    values = dense_basis(knots, degree, knots[[0, -1]])[0]
    np.testing.assert_array_equal(values, np.eye(values.shape[1])[[0, -1]])


@given(open_knot_vectors())
def test_polynomials_up_to_the_degree_are_reproduced(spline):
    """Marsden's identity: the coefficients of x^k are means of products of k different knots."""
    knots, degree = spline
    xi = points_over(knots)
    basis = dense_basis(knots, degree, xi)[0]
    windows = np.lib.stride_tricks.sliding_window_view(knots[1:-1], degree)
    for power in range(degree + 1):
        means = [sum(prod(c) for c in combinations(window, power)) / comb(degree, power) for window in windows]
        np.testing.assert_allclose(basis @ means, xi**power, rtol=0, atol=1e-13 * max(1, abs(xi).max() ** power))


@given(open_knot_vectors())
def test_greville_points_are_the_coefficients_of_the_identity(spline):
    knots, degree = spline
    xi = points_over(knots)
    greville = bspline.greville(knots, degree)
    assert np.all(np.diff(greville) > 0)
    np.testing.assert_allclose(dense_basis(knots, degree, xi)[0] @ greville, xi, rtol=0, atol=1e-14 * abs(knots).max())


@given(open_knot_vectors())
def test_derivatives_of_basis_functions_equal_differences(spline):
    knots, degree = spline
    at = np.unique(knots)
    middle = (at[:-1] + at[1:]) / 2  # differences must not step over a knot
    for order in range(min(degree, 3)):
        for xi in middle:
            assert_tangent(
                lambda x, order=order: dense_basis(knots, degree, x, order)[order, 0],
                dense_basis(knots, degree, [xi], order + 1)[order + 1, 0][:, None],
                np.array([xi]),
            )


@given(open_knot_vectors(), st.integers(1, 4))
def test_derivatives_beyond_the_degree_vanish(spline, excess):
    knots, degree = spline
    _, values = bspline.basis(knots, degree, points_over(knots), degree + excess)
    assert not values[degree + 1 :].any()
    assert values[degree].any()


@given(open_knot_vectors(), SEEDS)
def test_a_named_span_continues_its_polynomial_beyond_its_ends(spline, seed):
    knots, degree = spline
    random = np.random.default_rng(seed)
    at = np.unique(knots)
    span = bspline.find_spans(knots, degree, random.choice(at[:-1], 1))
    inside = np.linspace(*knots[[span[0], span[0] + 1]], degree + 2)[:-1]
    xi = random.uniform(knots[0], knots[-1], 5)
    _, samples = bspline.basis(knots, degree, inside, spans=np.repeat(span, len(inside)))
    _, found = bspline.basis(knots, degree, xi, spans=np.repeat(span, len(xi)))
    for k in range(degree + 1):
        expected = np.polynomial.Polynomial.fit(inside, samples[0, :, k], degree)(xi)
        np.testing.assert_allclose(found[0, :, k], expected, rtol=0, atol=1e-9 * max(1, abs(found).max()))


@given(open_knot_vectors())
def test_a_point_lies_in_the_nonempty_span_to_its_right(spline):
    knots, degree = spline
    at = np.unique(knots)
    spans = bspline.find_spans(knots, degree, at)
    np.testing.assert_array_equal(knots[spans[:-1]], at[:-1])
    np.testing.assert_array_equal(knots[spans[:-1] + 1], at[1:])
    assert spans[-1] == spans[-2]  # the right end belongs to the last span


@given(open_knot_vectors(), SEEDS)
def test_the_blossom_is_symmetric_in_its_arguments(spline, seed):
    knots, degree = spline
    random = np.random.default_rng(seed)
    spans = bspline.find_spans(knots, degree, random.uniform(knots[0], knots[-1], 6))
    arguments = random.uniform(knots[0], knots[-1], (6, degree))
    found = bspline.blossom(knots, degree, spans, arguments)
    shuffled = bspline.blossom(knots, degree, spans, random.permuted(arguments, axis=1))
    np.testing.assert_allclose(shuffled, found, rtol=0, atol=1e-12 * abs(found).max())


@given(open_knot_vectors(), SEEDS, st.floats(-1, 2))
def test_the_blossom_is_affine_in_each_argument(spline, seed, share):
    knots, degree = spline
    random = np.random.default_rng(seed)
    spans = bspline.find_spans(knots, degree, random.uniform(knots[0], knots[-1], 6))
    one, other = np.repeat(random.uniform(knots[0], knots[-1], (1, 6, degree)), 2, axis=0)
    which = random.integers(degree)
    other[:, which] = random.uniform(knots[0], knots[-1], 6)
    between = (1 - share) * one + share * other
    low, high, found = (bspline.blossom(knots, degree, spans, a) for a in (one, other, between))
    scale = max(abs(low).max(), abs(high).max())
    np.testing.assert_allclose(found, (1 - share) * low + share * high, rtol=0, atol=1e-12 * scale)


@given(open_knot_vectors())
def test_the_blossom_on_the_diagonal_is_the_basis(spline):
    knots, degree = spline
    xi = points_over(knots)
    spans = bspline.find_spans(knots, degree, xi)
    _, values = bspline.basis(knots, degree, xi)
    blossoms = bspline.blossom(knots, degree, spans, np.repeat(xi[:, None], degree, axis=1))
    np.testing.assert_array_equal(blossoms, values[0])


@given(open_knot_vectors(), st.data())
def test_knot_insertion_equals_scipys_one_knot_at_a_time(spline, data):
    knots, degree = spline
    inserted = inserted_knots(data.draw, knots, degree)
    refined, matrix = bspline.insertion(knots, degree, inserted)
    expected = BSpline(knots, np.eye(len(knots) - degree - 1), degree)
    for knot in inserted:
        expected = expected.insert_knot(knot)
    np.testing.assert_array_equal(refined, expected.t)
    np.testing.assert_allclose(matrix.toarray(), expected.c[: len(refined) - degree - 1], rtol=0, atol=1e-12)


@given(open_knot_vectors(), st.data())
def test_knot_insertion_keeps_the_function(spline, data):
    knots, degree = spline
    refined, matrix = bspline.insertion(knots, degree, inserted_knots(data.draw, knots, degree))
    xi = points_over(refined)
    before, after = dense_basis(knots, degree, xi)[0], dense_basis(refined, degree, xi)[0]
    np.testing.assert_allclose(after @ matrix, before, rtol=0, atol=1e-13)


@given(open_knot_vectors(highest=4), st.integers(1, 3))
def test_degree_elevation_keeps_the_function_and_its_smoothness(spline, times):
    knots, degree = spline
    raised, matrix = bspline.elevation(knots, degree, times)
    xi = points_over(raised)
    before, after = dense_basis(knots, degree, xi)[0], dense_basis(raised, degree + times, xi)[0]
    np.testing.assert_allclose(after @ matrix, before, rtol=0, atol=1e-13)
    (at, counts), (raised_at, raised_counts) = (np.unique(k, return_counts=True) for k in (knots, raised))
    np.testing.assert_array_equal(raised_at, at)
    np.testing.assert_array_equal(raised_counts, counts + times)


@given(open_knot_vectors(), st.data())
def test_new_coefficients_are_means_of_old_ones(spline, data):
    """So a spline stays inside the convex hull of its coefficients."""
    knots, degree = spline
    _, inserted = bspline.insertion(knots, degree, inserted_knots(data.draw, knots, degree))
    _, raised = bspline.elevation(knots, degree, 2)
    for matrix in (inserted, raised):
        assert matrix.toarray().min() >= -1e-14
        np.testing.assert_allclose(matrix.sum(axis=1), 1, rtol=0, atol=1e-13)


@given(open_knot_vectors(highest=4), SEEDS)
def test_degree_elevation_equals_splinepys(spline, seed):
    knots, degree = spline
    coefficients = np.random.default_rng(seed).normal(size=(len(knots) - degree - 1, 2))
    expected = splinepy.BSpline([degree], [knots], coefficients)
    expected.elevate_degrees([0])
    raised, matrix = bspline.elevation(knots, degree)
    np.testing.assert_allclose(raised, expected.knot_vectors[0], rtol=1e-15)
    np.testing.assert_allclose(matrix @ coefficients, expected.control_points, rtol=0, atol=1e-12)


def test_elevation_by_nothing_changes_nothing():
    knots = open_knots([0, 0.5, 1], 2)
    raised, matrix = bspline.elevation(knots, 2, 0)
    np.testing.assert_array_equal(raised, knots)
    np.testing.assert_array_equal(matrix.toarray(), np.eye(4))


@given(graded_breaks(), st.integers(1, 5))
def test_knots_over_breaks_are_open_and_as_smooth_as_can_be(at, degree):
    knots = open_knots(at, degree)
    bspline.check_knots(knots, degree)
    values, counts = np.unique(knots, return_counts=True)
    np.testing.assert_array_equal(values, at)
    np.testing.assert_array_equal(bspline.breaks(knots), at)
    assert counts.tolist() == [degree + 1, *[1] * (len(at) - 2), degree + 1]


@given(open_knot_vectors())
def test_any_open_knot_vector_is_accepted(spline):
    bspline.check_knots(*spline)


@pytest.mark.parametrize(
    ("knots", "degree", "fault"),
    [
        ([0, 1], 1, "at least 4"),
        ([], 1, "at least 4"),
        ([[0, 0, 1, 1]], 1, "at least 4"),
        ([0, 0, 0, 1, 1], 2, "at least 6"),
        ([0, 0, np.nan, 1, 1], 1, "finite"),
        ([0, 0, np.inf, np.inf], 1, "finite"),
        ([0, 0, 0.7, 0.2, 1, 1], 1, "0.7 before 0.2"),
        ([3, 3, 3, 3], 1, "equal 3"),
        ([0, 0.1, 0.9, 1], 1, "not open"),
        ([0, 0, 0, 1, 1], 1, "2 times, found 3 and 2"),
        ([0, 0, 1, 1, 1], 1, "2 times, found 2 and 3"),
        ([0, 0, 0, 0.5, 1, 1], 2, "3 times, found 3 and 2"),
        ([0, 0, 0.25, 0.25, 1, 1], 1, "knot 0.25"),
        ([0, 0, 0, 0.25, 0.5, 0.5, 0.5, 1, 1, 1], 2, "knot 0.5"),
    ],
)
def test_knots_that_are_no_open_knot_vector_are_refused(knots, degree, fault):
    with pytest.raises(ValueError, match=fault):
        bspline.check_knots(np.array(knots, dtype=float), degree)
