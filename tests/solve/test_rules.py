from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from geom2iga.bspline import basis, breaks, open_knots
from geom2iga.patch import refined
from solve.material import Material
from solve.operator import Stiffness
from solve.rules import exact_rules, full_rules, gauss_rule, smooth_rule, smooth_rules
from solve.space import number_control_points
from tests.cases import bent_patch, block_patch, hollow_cylinder, model_of
from tests.strategies import SEEDS, open_knot_vectors

STEEL = Material(200.0, 0.3)


@st.composite
def strongly_graded_knots(draw, highest=8):
    """Open knot vectors whose spans differ by up to 1e6 in size."""
    degree = draw(st.integers(1, highest))
    lengths = 10.0 ** np.array(draw(st.lists(st.floats(-6, 0), min_size=1, max_size=8)))
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    inner = draw(st.lists(st.integers(1, degree), min_size=len(at) - 2, max_size=len(at) - 2))
    return np.repeat(at, [degree + 1, *inner, degree + 1]), degree


KNOTS = open_knot_vectors(8, 6) | strongly_graded_knots()


def smooth_sections(knots, degree):
    """Runs of spans from kink to kink."""
    at, repeated = np.unique(knots, return_counts=True)
    kinks = np.concatenate([[0], np.flatnonzero(repeated[1:] >= degree) + 1])
    return [np.arange(start, stop) for start, stop in pairwise(kinks)], at


def points_per_span(knots, degree):
    """Points of every span, but for one more before each kink."""
    rule, sections = smooth_rule(knots, degree), smooth_sections(knots, degree)[0]
    return int(rule.counts.sum() - len(sections)) // len(rule.counts)


@given(KNOTS)
def test_smooth_points_integrate_continuous_splines_of_twice_the_degree_exactly(given_knots):
    """The integral of a B-spline of degree d is its support over d + 1 (de Boor 2001, ch. X)."""
    knots, degree = given_knots
    rule, twice = smooth_rule(knots, degree), 2 * points_per_span(knots, degree)
    sections, at = smooth_sections(knots, degree)
    for spans in sections:
        part, inside = rule.chosen(spans), at[spans[0] : spans[-1] + 2]
        continuous = np.repeat(inside, [twice + 1, *[twice] * (len(spans) - 1), twice + 1])
        first, values = basis(continuous, twice, part.points, 0)
        found = np.zeros(len(continuous) - twice - 1)
        np.add.at(found, first[:, None] + np.arange(twice + 1), part.weights[:, None] * values[0])
        expected = (continuous[twice + 1 :] - continuous[: -twice - 1]) / (twice + 1)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.diff(inside).max())


@given(KNOTS)
def test_no_rule_that_is_exact_for_these_splines_has_fewer_points(given_knots):
    """n points and weights are 2 n numbers, the splines of degree 2 k on s spans 2 k s + 1 conditions."""
    knots, degree = given_knots
    rule, twice = smooth_rule(knots, degree), 2 * points_per_span(knots, degree)
    for spans in smooth_sections(knots, degree)[0]:
        assert rule.counts[spans].sum() == np.ceil((twice * len(spans) + 1) / 2)
    assert rule.counts.sum() == len(rule.points) == len(rule.weights)


@given(KNOTS)
def test_up_to_degree_4_there_are_enough_points_to_integrate_the_stiffness_exactly(given_knots):
    knots, degree = given_knots
    assert points_per_span(knots, degree) >= min(degree, 4)


@pytest.mark.parametrize("spans", [2, 3, 6])
@pytest.mark.parametrize(
    ("degree", "multiplicity"),
    [*((p, 1) for p in range(1, 9)), *((p, p) for p in range(1, 9)), (3, 2), (4, 3), (7, 6)],
)
def test_between_kinks_there_are_as_many_points_as_functions(degree, multiplicity, spans):
    """Fewer would leave the stiffness singular."""
    knots = np.repeat(np.linspace(0, 1, spans + 1), [degree + 1, *[multiplicity] * (spans - 1), degree + 1])
    rule = smooth_rule(knots, degree)
    for part in smooth_sections(knots, degree)[0]:
        assert rule.counts[part].sum() >= degree + 1 + multiplicity * (len(part) - 1)


@given(KNOTS)
def test_smooth_points_lie_inside_their_spans_and_have_positive_weights(given_knots):
    knots, degree = given_knots
    rule, at = smooth_rule(knots, degree), breaks(knots)
    span = np.repeat(np.arange(len(rule.counts)), rule.counts)
    assert np.all(rule.weights > 0)
    assert np.all((at[span] <= rule.points) & (rule.points <= at[span + 1]))
    assert np.all(np.diff(rule.points) > 0)


@given(st.integers(1, 8), st.integers(1, 5))
def test_between_kinks_one_span_has_gauss_points(degree, spans):
    at = np.linspace(-1, 2, spans + 1)
    knots = np.repeat(at, [degree + 1, *[degree] * (spans - 1), degree + 1])
    smooth, gauss = smooth_rule(knots, degree), gauss_rule(knots, points_per_span(knots, degree) + 1)
    np.testing.assert_array_equal(smooth.counts, gauss.counts)
    np.testing.assert_allclose(smooth.points, gauss.points, rtol=0, atol=1e-12)
    np.testing.assert_allclose(smooth.weights, gauss.weights, rtol=0, atol=1e-12)


@given(open_knot_vectors(), st.integers(1, 9))
def test_gauss_points_integrate_polynomials_of_twice_their_number_less_one_in_each_span(given_knots, count):
    knots, _ = given_knots
    rule, at = gauss_rule(knots, count), breaks(knots)
    for span in range(len(at) - 1):
        part, middle = rule.chosen(np.array([span])), at[span : span + 2].mean()
        power = 2 * count - 2
        moment = part.weights @ (part.points - middle) ** power
        half = (at[span + 1] - at[span]) / 2
        assert moment == pytest.approx(2 * half ** (power + 1) / (power + 1), rel=1e-11)


def test_smooth_points_are_few():
    """Points of one direction with 32 spans, where Gauss needs (degree + 1) times 32."""
    found = {degree: len(smooth_rule(open_knots(np.linspace(0, 1, 33), degree), degree).points) for degree in (2, 3, 4)}
    assert found == {2: 65, 3: 97, 4: 129}


@given(st.tuples(*[st.integers(1, 4)] * 3), SEEDS)
@example((4, 4, 4), 0)
def test_on_affine_patches_up_to_degree_4_smooth_points_give_the_stiffness_of_gauss_points(degrees, seed):
    random = np.random.default_rng(seed)
    patch = block_patch("block", (1, -2, 0), (1, 3, 0.2), degrees)
    knots = [np.repeat(np.sort(random.random(2)), random.integers(1, p + 1, 2)) for p in degrees]
    space = number_control_points(model_of(refined(patch, knots=knots)))
    x = random.normal(size=space.dofs)
    smooth, full = (Stiffness(space, {"block": STEEL}, rules(space)) @ x for rules in (smooth_rules, full_rules))
    np.testing.assert_allclose(smooth, full, rtol=0, atol=1e-11 * np.abs(full).max())


def test_the_exact_rules_are_the_smooth_ones_for_affine_patches_up_to_degree_4_and_gauss_points_elsewhere():
    affine, high = block_patch("affine", degree=(4, 2, 1), spans=(4, 3, 2)), block_patch("high", degree=5)
    curved, rational = bent_patch(0, rational=False, name="curved"), hollow_cylinder(name="rational")
    space = number_control_points(model_of(affine, high, curved, rational))
    exact, smooth, full = exact_rules(space), smooth_rules(space), full_rules(space)
    for name in space.model.patches:
        same = smooth if name == "affine" else full
        for one, other in zip(exact[name], same[name], strict=True):
            np.testing.assert_array_equal(one.points, other.points)
    assert [rule.counts[0] for rule in full["rational"]] == list(space.point_counts["rational"])
