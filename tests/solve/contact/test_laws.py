import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solve.case import Contact
from solve.contact.laws import Penalty, find_penalty
from solve.material import Material
from solve.space import number_control_points
from tests.cases import block_patch, model_of
from tests.oracles import assert_tangent
from tests.strategies import SEEDS, rotations
from tests.verification.glued_bodies import glued_model, wall


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


def test_a_given_penalty_is_taken_as_it_is():
    space = number_control_points(model_of(block_patch("lower"), block_patch("upper")))
    contact = Contact(secondary="upper/bottom", primary="lower/top", penalty=123.0)
    assert find_penalty(space, contact, {}) == 123.0


@given(rotations(), st.floats(0.1, 10), st.integers(1, 3), st.floats(1, 1000), st.floats(1, 1000))
def test_the_automatic_penalty_is_ten_times_the_softer_modulus_over_the_span_size(turn, size, degree, soft, other):
    upper = block_patch("upper", size=(2 * size, 2 * size, size), degree=degree, spans=(4, 4, 1), turn=turn)
    space = number_control_points(model_of(block_patch("lower"), upper))
    contact = Contact(secondary="upper/bottom", primary="lower/top")
    materials = {"lower": Material(soft, 0.3), "upper": Material(other, 0.3)}
    assert find_penalty(space, contact, materials) == pytest.approx(10 * min(soft, other) / (size / 2), rel=1e-12)


def test_the_automatic_penalty_takes_the_mean_of_spans_that_are_no_squares():
    upper = block_patch("upper", size=(4, 1, 1), spans=(2, 3, 1))
    space = number_control_points(model_of(block_patch("lower"), upper))
    materials = dict.fromkeys(("lower", "upper"), Material(7.0, 0.3))
    contact = Contact(secondary="upper/bottom", primary="lower/top")
    assert find_penalty(space, contact, materials) == pytest.approx(70 / (4 / 6) ** 0.5, rel=1e-13)


def test_the_automatic_penalty_takes_the_mean_of_the_spans_of_all_faces():
    bodies = {"lower": [block_patch("lower")], "upper": wall("u", spans=((1, 3), (1, 1), (1,)))}
    space = number_control_points(glued_model(bodies))
    materials = {"lower": Material(7.0, 0.3), "upper": Material(8.0, 0.3)}
    contact = Contact(secondary="upper/bottom", primary="lower/top")
    assert find_penalty(space, contact, materials) == pytest.approx(70 / (1 / 8) ** 0.5, rel=1e-13)
