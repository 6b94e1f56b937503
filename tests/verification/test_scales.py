"""Answers do not depend on scale: size, modulus, place, weights, shape and overlap may be extreme."""

import numpy as np
import pytest

import solve
from geom2iga.inversion import locate
from geom2iga.patch import Patch, evaluate, surface
from geom2iga.projection import closest_points
from post.exact import NestedShells, Shell
from tests.cases import bent_patch, block_patch, displacement_at, model_of, moved
from tests.robustness.scales import combinations, line
from tests.verification.scaled import (
    STRAIN,
    Scale,
    bar,
    lame,
    placed,
    pressed_blocks,
    squeezed_blocks,
    stress_error,
    stresses,
    tubes,
)

KEPT = [  # of the extremes; the others run with the slow tests
    ("pressed", "size 1e-9, modulus 1e15", "Lagrange, iterative"),
    ("pressed", "size 1e9, modulus 1e-6", "penalty, direct"),
    ("pressed", "moduli 1e8 : 1", "augmented Lagrange, direct"),
    ("pressed", "spans 1e4 : 1 : 1", "penalty, direct"),
    ("pressed", "spans 1 : 1 : 1e-4", "penalty, iterative"),
    ("pressed", "weights x 1e3", "penalty, direct"),
    ("pressed", "Poisson 0", "penalty, matching, element"),
    ("pressed", "Poisson 0.4999", "Lagrange, direct"),
    ("pressed", "1e6 sizes away", "kts"),
    ("pressed", "1e8 sizes away", "penalty, direct"),
    ("squeezed", "moduli 1 : 1e8", "penalty, direct"),
    ("squeezed", "overlap 1e-06", "penalty, matching, element"),
    ("squeezed", "overlap 1e-10", "Lagrange, direct"),
    ("bar", "size 1e-9, 1e6 sizes away", "penalty, direct"),
    ("tubes", "moduli 1 : 1e8", "Lagrange, direct"),
    ("tubes", "gap 0.001", "penalty, direct"),
]
AT_EVERY_SCALE = [each for each in combinations("", None) if each not in KEPT]


@pytest.mark.parametrize(("problem", "extreme", "way"), KEPT)
def test_stresses_are_right_to_the_condition_of_the_problem(problem, extreme, way):
    text, verdict = line(problem, extreme, way)
    assert verdict == "ok", text


def test_tubes_that_fit_have_the_closed_form_of_nested_shells():
    inner, outer = lame(Scale(ratio=2.0), 5.0)
    nested = NestedShells(Shell(1, 2, 1, 0.3, STRAIN, 0, 2), Shell(2, 3, 2, 0.3, 0, 0, 2), 5.0)
    assert inner.outside == pytest.approx(nested.pressure, rel=1e-14)
    assert outer.inside == inner.outside


@pytest.mark.slow
@pytest.mark.parametrize(("problem", "extreme", "way"), AT_EVERY_SCALE)
def test_what_is_not_right_to_the_condition_of_the_problem_is_said(problem, extreme, way):
    text, verdict = line(problem, extreme, way)
    assert verdict != "WRONG", text


def test_far_from_the_origin_what_the_control_points_hold_is_not_lost():
    """They are rounded to 1e-10 of the size; nothing else costs digits."""
    assert stress_error(pressed_blocks(Scale(far=1e6)))[0] < 1e-12


@pytest.mark.parametrize("far", [1e6, pytest.param(1e8, marks=pytest.mark.slow)])
def test_curved_faces_far_from_the_origin_carry_the_pressure_of_those_at_it(far):
    found, expected = (stresses(stress_error(tubes(Scale(far=each), matching=True))[1]) for each in (far, 0.0))
    assert np.abs(found - expected).max() <= 10 * np.finfo(float).eps * far * np.abs(expected).max()


def test_gaps_that_rounding_spoils_are_said_with_what_they_cost():
    _, result = stress_error(squeezed_blocks(Scale(far=1e8), 1e-3))
    (warning,) = result.contacts[0].warnings
    assert "gaps are known to 2e-07 only, and pressures to 7e-04 of the largest" in warning
    assert "sizes from the origin" in warning


def test_an_overlap_that_is_taken_as_none_is_said():
    error, result = stress_error(squeezed_blocks(Scale(), 1e-14))
    assert error == 1.0
    assert "taken as none" in result.contacts[0].warnings[0]


def test_an_overlap_that_augmented_lagrange_leaves_is_said():
    contact = {"enforcement": "augmented-lagrange"}
    error, result = stress_error(squeezed_blocks(Scale(), 1e-10, **contact))
    assert error > 1e-3
    assert "lower solve.augmentation.tolerance" in result.contacts[0].warnings[-1]
    problem = squeezed_blocks(Scale(), 1e-10, **contact)
    problem.case["solve"]["augmentation"] = {"tolerance": 1e-15}
    error, result = stress_error(problem)
    assert error < 1e-4
    assert not any("augmentation" in warning for warning in result.contacts[0].warnings)


@pytest.mark.parametrize(
    ("length", "stress"),
    [(1e-9, 1e15), *(pytest.param(*each, marks=pytest.mark.slow) for each in ((1e9, 1e-6), (1e-9, 1e-6), (1e9, 1e15)))],
)
@pytest.mark.parametrize("enforcement", ["penalty", "augmented-lagrange", "lagrange"])
def test_conjugate_gradients_stay_in_the_range_of_single_precision(enforcement, length, stress):
    scale = Scale(length=length, stress=stress)
    error, _ = stress_error(squeezed_blocks(scale, 1e-3, "iterative", enforcement=enforcement))
    assert error <= scale.tolerance()


def test_conjugate_gradients_follow_weights_that_differ_a_hundredfold():
    problem = bar(Scale(uneven=1e2), "iterative")
    error, result = stress_error(problem)
    assert error < 1e-9
    assert len(result.history) <= 5


@pytest.mark.parametrize("factor", [1e-3, 1e3, 2.0**40])
def test_only_ratios_of_weights_matter(factor):
    plain, scaled = (stresses(stress_error(bar(Scale(weights=each)))[1]) for each in (1.0, factor))
    np.testing.assert_allclose(scaled, plain, rtol=0, atol=1e-12 * np.abs(plain).max())


def test_weights_that_no_quadrature_follows_are_said_with_what_they_cost(caplog):
    error, _ = stress_error(pressed_blocks(Scale(uneven=1e2)))
    assert 'patch "upper": the forces of a uniform stress are integrated to 2e-08' in caplog.text
    assert 1e-9 < error < 1e-6


def settlement(degree: int, poisson: float, spans: int = 4) -> float:
    """Mean settlement of the top of a cube on a rigid base, pressed between symmetry planes."""
    block = block_patch("cube", degree=degree, spans=(spans,) * 3)
    case = {
        "material": [{"young": 1.0, "poisson": poisson}],
        "support": [{"on": "cube/bottom", "ux": 0.0, "uy": 0.0, "uz": 0.0}]
        + [{"on": f"cube/{side}", "normal": 0.0} for side in ("left", "front")],
        "load": [{"on": "cube/top", "pressure": 1e-3}],
    }
    at = np.random.default_rng(0).random((500, 3)) * [1, 1, 0] + [0, 0, 1]
    return -displacement_at(solve.solve(model_of(block), {"solve": case}), "cube", at)[:, 2].mean()


def test_nearly_incompressible_bodies_of_low_degree_lock_as_the_warning_says(caplog):
    shown = {degree: settlement(degree, 0.4999) / settlement(3, 0.4999, 6) for degree in (1, 2)}
    assert shown[1] == pytest.approx(0.05, abs=0.01)
    assert shown[2] == pytest.approx(0.89, abs=0.01)
    assert "a twentieth at 0.4999" in caplog.text
    assert "89 % at 0.4999" in caplog.text
    assert "of degree 3" not in caplog.text


def test_an_ordinary_ratio_of_poisson_needs_no_word(caplog):
    settlement(1, 0.3)
    assert not caplog.records


@pytest.mark.parametrize("far", [1e3, 1e6])
def test_feet_on_a_face_far_from_the_origin_are_those_at_it(far):
    at_origin = surface(bent_patch(3), model_of(bent_patch(3)).faces("bent/top")[0])
    points = np.random.default_rng(1).random((200, 3)) * [2, 1.5, 0.5] + [0, 0, 1]
    by = far * np.array([1.0, -0.7, 0.4])
    near, away = closest_points(at_origin, points), closest_points(moved(at_origin, by), points + by)
    np.testing.assert_array_equal(away.inside, near.inside)
    np.testing.assert_allclose(away.xi[near.inside], near.xi[near.inside], rtol=0, atol=1e-14 * far + 1e-7)


def test_points_very_far_from_a_face_find_their_feet():
    patch = Patch("plane", (1, 1), ([0, 0, 1, 1],) * 2, [[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0.0]]])
    points = np.random.default_rng(2).random((100, 3)) * [1, 1, 0] + [0, 0, 1e8]
    assert closest_points(patch, points).inside.all()


@pytest.mark.parametrize("scale", [Scale(far=1e8), Scale(length=1e-9, far=1e6), Scale(length=1e9)])
def test_points_of_a_body_at_any_scale_are_found_in_it(scale):
    patch = placed(bent_patch(5), scale)
    xi = np.random.default_rng(3).random((100, 3))
    found, places = locate(patch, evaluate(patch, xi)[0])
    assert found.all()
    np.testing.assert_allclose(places, xi, rtol=0, atol=1e-12 + 1e-15 * scale.far)
