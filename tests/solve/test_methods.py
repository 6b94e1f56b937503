"""Methods of contact, alone and together, and load steps."""

from dataclasses import replace

import numpy as np
import pytest

import geom2iga
import solve
from post.fields import sample_contact
from solve.case import Solve
from solve.problem import prepare
from tests.cases import block_patch, converged, largest_stress_error, model_of, patch_test_case

UNIFORM = (0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
METHODS = {
    "penalty": {"penalty": 1e5},
    "stiff penalty": {"penalty": 1e9},
    "very stiff penalty": {"penalty": 1e13},
    "augmented Lagrange": {"enforcement": "augmented-lagrange"},
    "Lagrange": {"enforcement": "lagrange"},
    "p-2": {"multiplier": "p-2"},
    "p-2, augmented Lagrange": {"multiplier": "p-2", "enforcement": "augmented-lagrange"},
    "p-2, Lagrange": {"multiplier": "p-2", "enforcement": "lagrange"},
    "KTS": {"method": "kts"},
    "two passes": {"two_pass": True},
    "two passes of p-2": {"two_pass": True, "multiplier": "p-2"},
    "two passes of KTS": {"two_pass": True, "method": "kts"},
}


def patch_test(degree=2, **contact):
    case = patch_test_case(degree, lower_spans=(5, 4, 2), upper_spans=(3, 3, 2))
    case["solve"]["contact"] = [{"secondary": "upper/bottom", "primary": "lower/top", **contact}]
    return case


def built(case):
    return converged(geom2iga.build(case), case)


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("name", METHODS)
def test_every_method_passes_the_patch_test(name, degree):
    if degree == 1 and "p-2" in name:
        return
    result = built(patch_test(degree, **METHODS[name]))
    assert largest_stress_error(result, UNIFORM, 200) < 1e-10
    for contact, sign in zip(result.contacts, (1, -1), strict=False):
        np.testing.assert_allclose(contact.force, [0, 0, sign], rtol=0, atol=1e-10)
    if "Lagrange" in name:
        assert max(contact.penetration for contact in result.contacts) < 1e-9


@pytest.mark.parametrize("values", [{}, {"multiplier": "p-2"}, {"method": "kts"}])
def test_two_passes_each_show_the_whole_force_and_the_whole_pressure(values):
    case = patch_test(two_pass=True, **values)
    case["geometry"]["block"][1]["origin"] = [0.45, 0.45, 1.0]  # no edge on a knot line, where pressures may jump
    result = built(case)
    one, other = result.contacts
    assert (one.definition.secondary, other.definition.secondary) == ("upper/bottom", "lower/top")
    np.testing.assert_allclose(one.force, [0, 0, 1], rtol=0, atol=1e-10)
    np.testing.assert_allclose(other.force, -one.force, rtol=0, atol=1e-10)
    np.testing.assert_allclose(other.moment, -one.moment, rtol=0, atol=1e-10)
    assert not np.allclose(one.pressure, 1, atol=0.1)  # each carries its part
    for contact in result.contacts:
        for part in sample_contact(result, contact, 3):
            opposite = ~np.isnan(part.gap)
            np.testing.assert_allclose(part.pressure[opposite], 1, rtol=0, atol=1e-8)
            assert opposite.any()


def rounded_punch(**contact):
    """A rounded punch, pressed off its centre into a block: not all gaps close, and not all at once."""
    punch = block_patch("upper", (0.4, 0.5, 1), degree=2, spans=(3, 3, 1))
    points = punch.control_points.copy()
    points[..., 2] += 0.03 * ((points[..., 0] - 0.8) ** 2 + (points[..., 1] - 1) ** 2) * (2 - points[..., 2])
    punch = geom2iga.Patch("upper", punch.degrees, punch.knots, points)
    model = model_of(block_patch("lower", size=(2, 2, 1), degree=2, spans=(4, 3, 1)), punch)
    return model, {
        "solve": {
            "material": [{"young": 1000.0, "poisson": 0.3}],
            "support": [
                {"on": "lower/bottom", "ux": 0.0, "uy": 0.0, "uz": 0.0},
                {"on": "upper/top", "ux": 0.0, "uy": 0.0, "uz": -0.01},
            ],
            "load": [{"on": "lower/right", "pressure": 2.0}],
            "contact": [{"secondary": "upper/bottom", "primary": "lower/top", **contact}],
        }
    }


def with_steps(case, *factors):
    return {"solve": {**case["solve"], "steps": {"factors": list(factors)}}}


WAYS = {
    "penalty": {},
    "stiff penalty": {"penalty": 1e9},
    "augmented Lagrange": {"enforcement": "augmented-lagrange"},
    "Lagrange": {"enforcement": "lagrange"},
    "two passes": {"two_pass": True},
}


def assert_same_state(found, expected, tolerance=1e-10):
    assert found.load_factor == expected.load_factor
    size = np.abs(expected.displacement).max()
    np.testing.assert_allclose(found.displacement, expected.displacement, rtol=0, atol=tolerance * size)


@pytest.mark.parametrize("name", WAYS)
def test_force_and_moment_are_those_of_the_pressures_on_the_secondary_body(name):
    model, case = rounded_punch(**WAYS[name])
    result = converged(model, case)
    problem = prepare(model, Solve.model_validate(case["solve"]))
    forces = (problem.mortar.gap_operator.T @ result.state.pressure).reshape(-1, 3)
    for contact, body in zip(result.contacts, ("upper", "lower"), strict=False):
        numbers = problem.space.body_numbers(body)
        scale = np.abs(forces[numbers]).sum()
        assert scale > 0.1
        np.testing.assert_allclose(contact.force, forces[numbers].sum(axis=0), rtol=0, atol=1e-12 * scale)
        moment = np.cross(problem.space.control_points, forces)[numbers].sum(axis=0)
        np.testing.assert_allclose(contact.moment, moment, rtol=0, atol=1e-11 * scale)
        assert np.abs(contact.moment).max() > 0.1
        assert 0 < contact.active.sum() < len(contact.active)
        np.testing.assert_array_equal(contact.active, contact.pressure > 0)


@pytest.mark.parametrize("name", WAYS)
def test_the_last_of_several_load_steps_ends_where_one_step_does(name):
    model, case = rounded_punch(**WAYS[name])
    alone, stepped = converged(model, case), converged(model, with_steps(case, 0.3, 0.8, 1.0))
    assert [state.load_factor for state in stepped.states] == [0.3, 0.8, 1.0]
    assert_same_state(stepped.state, alone.state, 1e-7 if "augmented" in name else 1e-10)
    assert [step.number for step in stepped.history] == list(range(1, len(stepped.history) + 1))
    assert {step.load_step for step in stepped.history} == {1, 2, 3}


@pytest.mark.parametrize("name", WAYS)
def test_a_load_step_like_the_one_before_takes_no_more_than_one_newton_step(name):
    model, case = rounded_punch(**WAYS[name])
    result = converged(model, with_steps(case, 0.8, 0.8))
    counts = [sum(step.load_step == number for step in result.history) for number in (1, 2)]
    assert counts[1] <= 1 < counts[0]
    assert_same_state(result.states[1], result.states[0], 1e-9)


def test_bodies_that_touch_follow_the_share_of_loads_and_prescribed_displacements():
    case = patch_test()
    case["solve"]["support"].append({"on": "lower/bottom", "ux": 0.0})
    case["solve"]["load"][0] = {"on": "upper/top", "traction": [0.0, 0.0, -1.0]}
    case["solve"]["steps"] = {"factors": [0.25, 1.0]}
    quarter, whole = built(case).states
    np.testing.assert_allclose(4 * quarter.displacement, whole.displacement, rtol=0, atol=1e-12)
    np.testing.assert_allclose(4 * quarter.pressure, whole.pressure, rtol=0, atol=1e-9)


def test_factors_may_be_negative_and_zero():
    model, case = rounded_punch()
    pulled, rest, pushed = converged(model, with_steps(case, -1.0, 0.0, 1.0)).states
    top = model.patches["upper"].control_points.reshape(-1, 3)[:, 2].argmax()
    space = prepare(model, Solve.model_validate(case["solve"])).space
    number = space.numbers["upper"][top]
    np.testing.assert_allclose(
        [s.displacement[number, 2] for s in (pulled, rest, pushed)], [0.01, 0, -0.01], atol=1e-15
    )
    np.testing.assert_allclose(rest.displacement, 0, rtol=0, atol=1e-14)
    assert not pulled.active.any()
    assert pushed.active.any()
    assert_same_state(pushed, converged(model, case).state)


def test_the_result_so_far_is_kept_after_each_load_step_but_the_last():
    model, case = rounded_punch()
    kept = []
    result = solve.solve(model, with_steps(case, 0.2, 0.6, 1.0), keep=kept.append)
    assert [[state.load_factor for state in r.states] for r in kept] == [[0.2], [0.2, 0.6]]
    for so_far in kept:
        for one, other in zip(so_far.states, result.states, strict=False):
            np.testing.assert_array_equal(one.displacement, other.displacement)


@pytest.mark.parametrize("done", [1, 2, 3])
def test_an_analysis_goes_on_from_the_load_steps_that_were_done_before(done):
    model, case = rounded_punch(enforcement="lagrange")
    case = with_steps(case, 0.2, 0.6, 1.0)
    whole = converged(model, case)
    again = solve.solve(model, case, before=replace(whole, states=whole.states[:done]))
    assert again.status is solve.Status.CONVERGED
    assert {step.load_step for step in again.history} == {1, 2, 3}
    assert len(again.states) == 3
    assert_same_state(again.state, whole.state)


def test_a_load_step_that_fails_leaves_the_states_before_it():
    model, case = rounded_punch()
    case = with_steps(case, 0.0, 1.0)
    case["solve"]["newton"] = {"max_steps": 1}
    kept = []
    result = solve.solve(model, case, keep=kept.append)
    assert result.status is solve.Status.MAX_STEPS
    assert [state.load_factor for state in result.states] == [0.0]
    assert result.history[-1].load_step == 2
    assert len(kept) == 1
    assert result.contacts == result.states[0].contacts


def test_the_pressure_of_a_lagrange_multiplier_is_the_limit_of_stiff_penalties():
    model, case = rounded_punch(enforcement="lagrange")
    limit = converged(model, case).contacts[0].pressure
    differences = []
    for penalty in (1e6, 1e8, 1e10, 1e12):
        stiff = {
            "solve": {**case["solve"], "contact": [{**rounded_punch()[1]["solve"]["contact"][0], "penalty": penalty}]}
        }
        differences.append(np.abs(converged(model, stiff).contacts[0].pressure - limit).max() / limit.max())
    assert np.all(np.diff(differences) < 0)
    assert differences[-1] < 1e-6
