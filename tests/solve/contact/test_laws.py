import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solve.case import Contact
from solve.contact.laws import STIFF, Law, Penalty, find_law, find_penalty, joined, penalty_law, stiffness_scale
from solve.material import Material
from solve.space import number_control_points
from tests.cases import block_patch, model_of
from tests.oracles import assert_tangent
from tests.strategies import SEEDS, rotations
from tests.verification.glued_bodies import glued_model, wall

SIDES = {"secondary": "upper/bottom", "primary": "lower/top"}
SCALES = st.floats(1e-3, 1e9)


def contact(**values):
    return Contact(**SIDES, **values)


@given(SEEDS, st.integers(1, 6))
def test_pressure_is_what_the_energy_loses_per_area_and_gap(seed, count):
    random = np.random.default_rng(seed)
    law = Penalty(random.uniform(1, 100, count))
    area, gap = random.uniform(0.5, 2, count), random.choice([-1, 1], count) * random.uniform(0.01, 1, count)
    assert_tangent(lambda gap: law.energy(gap, area), -law.pressure(gap) * area, gap)


@given(SEEDS)
def test_only_overlap_has_pressure(seed):
    random = np.random.default_rng(seed)
    law, gap = Penalty(random.uniform(1, 100, 5)), random.normal(size=5)
    pressure = law.pressure(gap)
    assert np.all(pressure >= 0)
    np.testing.assert_array_equal(pressure > 0, gap < 0)
    np.testing.assert_array_equal(pressure * np.maximum(gap, 0), 0)
    assert law.energy(np.abs(gap), np.ones(5)) == 0


@given(SCALES, st.floats(1e-6, STIFF))
def test_a_moderate_penalty_is_its_own_spring_and_needs_no_multiplier(scale, share):
    law = penalty_law(share * scale, 3, scale)
    assert law.multiplier == "none"
    np.testing.assert_array_equal(law.stiffness, share * scale)
    np.testing.assert_array_equal(law.softness, 0)


@given(SCALES, st.floats(1.001 * STIFF, 1e15))
def test_a_stiff_penalty_is_found_with_soft_springs_and_a_multiplier(scale, share):
    law = penalty_law(share * scale, 3, scale)
    assert law.multiplier == "solved"
    assert np.all(law.stiffness <= STIFF * scale)
    np.testing.assert_allclose(law.compliance, 1 / (share * scale), rtol=1e-15)


@given(SCALES, st.floats(1e-3, 1e15), SEEDS)
def test_the_springs_give_the_pressure_of_the_penalty_once_the_multiplier_is_it(scale, share, seed):
    """Where p = -g / c, the springs, closed sooner by what the multiplier shifts, have the pressure p, too."""
    pressure = np.random.default_rng(seed).uniform(0, 2, 4) * scale
    law = penalty_law(share * scale, 4, scale)
    gap = -law.compliance * pressure
    np.testing.assert_allclose(law.springs.pressure(gap - law.softness * pressure), pressure, rtol=1e-12)


@pytest.mark.parametrize("enforcement", ["augmented-lagrange", "lagrange"])
@given(SCALES, SEEDS)
def test_laws_without_overlap_have_their_whole_pressure_in_the_multiplier(enforcement, scale, seed):
    law = find_law(contact(enforcement=enforcement), 4, scale)
    pressure = np.random.default_rng(seed).uniform(0, 2, 4) * scale
    np.testing.assert_array_equal(law.compliance, 0)
    np.testing.assert_allclose(law.springs.pressure(-law.softness * pressure), pressure, rtol=1e-14)


@pytest.mark.parametrize(
    ("values", "penalty", "way"),
    [
        ({}, 20.0, "none"),
        ({"penalty": 123.0}, 123.0, "none"),
        ({"penalty": 2.1 * STIFF}, 2.1 * STIFF, "solved"),
        ({"enforcement": "augmented-lagrange"}, 20.0, "updated"),
        ({"enforcement": "augmented-lagrange", "penalty": 123.0}, 123.0, "updated"),
        ({"enforcement": "lagrange"}, np.inf, "solved"),
    ],
)
def test_the_case_names_the_penalty_and_the_way_to_the_multiplier(values, penalty, way):
    assert find_penalty(contact(**values), scale=2.0) == penalty
    law = find_law(contact(**values), 3, scale=2.0)
    assert law.multiplier == way
    assert len(law.stiffness) == len(law.compliance) == 3


@pytest.mark.parametrize("enforcement", ["penalty", "augmented-lagrange"])
@pytest.mark.parametrize("penalty", ["auto", 5.0])
def test_a_pass_that_carries_a_share_of_the_pressure_has_that_share_of_the_stiffness(enforcement, penalty):
    one = contact(enforcement=enforcement, penalty=penalty)
    assert find_penalty(one, 3.0, share=0.5) == find_penalty(one, 3.0) / 2
    np.testing.assert_array_equal(find_law(one, 2, 3.0, 0.5).stiffness, find_law(one, 2, 3.0).stiffness / 2)


def test_joined_laws_stand_one_after_the_other_and_the_most_demanding_way_counts():
    ways = ("none", "updated", "solved")
    laws = [Law(np.full(n, 1.0 + n), np.full(n, 0.1 * n), way) for n, way in enumerate(ways, start=1)]
    both = joined(laws)
    assert [joined(laws[:n]).multiplier for n in range(4)] == ["none", *ways]
    assert joined(laws[::-1]).multiplier == "solved"
    np.testing.assert_array_equal(both.stiffness, [2, 3, 3, 4, 4, 4])
    np.testing.assert_allclose(both.compliance, [0.1, 0.2, 0.2, 0.3, 0.3, 0.3])
    np.testing.assert_array_equal(both.softness, np.concatenate([law.softness for law in laws]))
    assert joined([]).stiffness.shape == joined([]).softness.shape == (0,)


@given(rotations(), st.floats(0.1, 10), st.integers(1, 3), st.floats(1, 1000), st.floats(1, 1000))
def test_the_stiffness_scale_is_the_softer_modulus_over_the_span_size(turn, size, degree, soft, other):
    upper = block_patch("upper", size=(2 * size, 2 * size, size), degree=degree, spans=(4, 4, 1), turn=turn)
    space = number_control_points(model_of(block_patch("lower"), upper))
    materials = {"lower": Material(soft, 0.3), "upper": Material(other, 0.3)}
    assert stiffness_scale(space, contact(), materials) == pytest.approx(min(soft, other) / (size / 2), rel=1e-12)


def test_the_stiffness_scale_takes_the_root_of_the_area_of_spans_that_are_no_squares():
    upper = block_patch("upper", size=(4, 1, 1), spans=(2, 3, 1))
    space = number_control_points(model_of(block_patch("lower"), upper))
    materials = dict.fromkeys(("lower", "upper"), Material(7.0, 0.3))
    assert stiffness_scale(space, contact(), materials) == pytest.approx(7 / (4 / 6) ** 0.5, rel=1e-13)


def test_the_stiffness_scale_takes_the_smallest_span_of_all_faces():
    """A wall of four faces, quarters of a square: the one with three spans along x has the smallest ones."""
    bodies = {"lower": [block_patch("lower")], "upper": wall("u", spans=((1, 3), (1, 2), (1,)))}
    space = number_control_points(glued_model(bodies))
    materials = {"lower": Material(7.0, 0.3), "upper": Material(8.0, 0.3)}
    assert stiffness_scale(space, contact(), materials) == pytest.approx(7 / (1 / 4 / 6) ** 0.5, rel=1e-13)
