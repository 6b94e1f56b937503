import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import geom2iga
from solve.case import Load, Support
from solve.constraints import constrain, find_conditions
from solve.loads import assemble_loads
from solve.reactions import find_reactions
from solve.space import number_control_points
from tests.cases import bent_patch, block_patch, converged, model_of, patch_test_case, turned
from tests.strategies import SEEDS, rotations

FIXED = {"ux": 0.0, "uy": 0.0, "uz": 0.0}
STEEL = {"young": 1000.0, "poisson": 0.3}
METHODS = ("direct", "iterative")


def case_of(support, load=(), method="direct", **more):
    tables = {"material": [STEEL], "support": list(support), "load": list(load), "linear": {"method": method}}
    return {"solve": {**tables, **more}}


def total(state):
    """Force and moment of all supports together."""
    return sum(r.force for r in state.reactions), sum(r.moment for r in state.reactions)


def reactions_of(model, supports, carried):
    """Of forces (n, 3) that supports must exert on the control points of a model."""
    space = number_control_points(model)
    entries = [Support(**support) for support in supports]
    conditions = find_conditions(space, entries)
    return space, conditions, constrain(space, conditions, entries), entries, carried(space)


@pytest.mark.parametrize("method", METHODS)
def test_reactions_of_the_patch_test_balance_its_pressures(method):
    source = patch_test_case(degree=2, lower_spans=(2, 3, 1), upper_spans=(3, 2, 1))
    source["solve"]["linear"] = {"method": method}
    state = converged(geom2iga.build(source), source).state
    bottom, *sides = state.reactions
    assert [r.number for r in state.reactions] == [0, 1, 2, 3, 4]
    assert bottom.on == "lower/bottom"
    np.testing.assert_allclose(bottom.force, [0, 0, 4], rtol=0, atol=1e-7)
    np.testing.assert_allclose(bottom.moment, [4, -4, 0], rtol=0, atol=1e-7)
    np.testing.assert_allclose([side.force for side in sides], 0, rtol=0, atol=1e-7)


@pytest.mark.parametrize("method", METHODS)
def test_a_bar_that_is_compressed_pushes_back_with_its_stress_times_its_area(method):
    model = model_of(block_patch("bar", size=(1, 2, 4), degree=2, spans=(2, 1, 3)))
    supports = [{"on": "bar/bottom", **FIXED}, {"on": "bar/top", "uz": -0.04}]
    case = case_of(supports, method=method, material=[{"young": 1000.0, "poisson": 0.0}])
    bottom, top = converged(model, case).state.reactions
    np.testing.assert_allclose(bottom.force, [0, 0, 20], rtol=0, atol=1e-6)
    np.testing.assert_allclose(top.force, [0, 0, -20], rtol=0, atol=1e-6)
    np.testing.assert_allclose(bottom.moment, [20, -10, 0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(top.moment, [-20, 10, 0], rtol=0, atol=1e-6)


@given(SEEDS)
def test_on_bent_bodies_forces_and_moments_of_all_supports_balance_the_loads(seed):
    model = model_of(bent_patch(seed, spans=(1, 1, 1)))
    supports = [{"on": "bent/left", **FIXED, "ux": 1e-3}, {"on": "bent/front", "ux": 1e-3}]
    load = {"on": "bent/right", "traction": [1.0, -2.0, 0.5]}
    result = converged(model, case_of(supports, [load]))
    loads, arm = load_of(model, load)
    force, moment = total(result.state)
    scale = max(np.abs(r.force).max() for r in result.state.reactions)
    np.testing.assert_allclose(force, -loads.sum(axis=0), rtol=0, atol=1e-8 * scale)
    np.testing.assert_allclose(moment, -np.cross(arm, loads).sum(axis=0), rtol=0, atol=1e-7 * scale)


def load_of(model, load):
    """Forces of a load, and where they act, (n, 3) each."""
    space = number_control_points(model)
    return assemble_loads(space, [Load(**load)], [], []), space.control_points


def test_reactions_grow_with_the_load_steps():
    source = patch_test_case(lower_spans=(2, 2, 1), upper_spans=(3, 2, 1))
    source["solve"]["steps"] = {"count": 4}
    result = converged(geom2iga.build(source), source)
    found = [state.reactions[0].force[2] for state in result.states]
    np.testing.assert_allclose(found, [1, 2, 3, 4], rtol=0, atol=1e-7)


@pytest.mark.parametrize("passes", [1, 2])
def test_a_body_that_contact_alone_holds_hands_its_load_down_to_the_supports_of_the_other(passes):
    model = model_of(block_patch("lower", size=(2, 2, 1), spans=(2, 2, 1)), block_patch("upper", (0.25, 0.5, 1)))
    supports = [{"on": "lower/bottom", **FIXED}, {"on": "upper/left", "ux": 0.0}, {"on": "upper/front", "uy": 0.0}]
    contact = {"secondary": "upper/bottom", "primary": "lower/top", "two_pass": passes == 2}
    case = case_of(supports, [{"on": "upper/top", "pressure": 3.0}], contact=[contact])
    state = converged(model, case).state
    bottom = state.reactions[0]
    np.testing.assert_allclose(bottom.force, [0, 0, 3], rtol=0, atol=1e-6)
    np.testing.assert_allclose(total(state)[1], [3, -2.25, 0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(bottom.force, state.contacts[0].force, rtol=0, atol=1e-6)
    np.testing.assert_allclose(bottom.moment, state.contacts[0].moment, rtol=0, atol=1e-6)


@given(rotations())
def test_supports_along_oblique_normals_push_along_them(turn):
    """A bar under its own weight in a corner: each of three planes carries the component along its normal."""
    model = model_of(turned(block_patch("bar", spans=(2, 1, 2)), turn))
    supports = [{"on": f"bar/{side}", "normal": 0.0} for side in ("left", "front", "bottom")]
    weight = np.array([0.3, -0.5, -2.0])
    result = converged(model, case_of(supports, body_force=[{"force": weight.tolist()}]))
    for axis, reaction in zip(turn.as_matrix().T, result.state.reactions, strict=True):
        np.testing.assert_allclose(reaction.force, -(weight @ axis) * axis, rtol=0, atol=1e-8)
    np.testing.assert_allclose(total(result.state)[0], -weight, rtol=0, atol=1e-8)


@given(SEEDS, st.floats(0.1, 1.5))
def test_supports_at_any_angle_carry_together_what_is_along_held_directions_each_along_its_own(seed, tilt):
    model = model_of(block_patch(degree=2, turn=Rotation.from_rotvec([0, tilt, 0])))
    supports = [{"on": "block/bottom", "uz": 0.0}, {"on": "block/left", "normal": 0.0}]
    random = np.random.default_rng(seed)
    space, conditions, allowed, entries, carried = reactions_of(
        model, supports, lambda space: random.normal(size=space.dofs)
    )
    bottom, left = find_reactions(space, entries, conditions, carried)
    held = (carried - allowed.matrix @ (allowed.matrix.T @ carried)).reshape(-1, 3)
    np.testing.assert_allclose(bottom.force + left.force, held.sum(axis=0), rtol=0, atol=1e-11)
    moment = np.cross(space.control_points, held).sum(axis=0)
    np.testing.assert_allclose(bottom.moment + left.moment, moment, rtol=0, atol=1e-11)
    np.testing.assert_allclose(bottom.force[:2], 0, rtol=0, atol=1e-11)
    normal = [-np.cos(tilt), 0, np.sin(tilt)]
    np.testing.assert_allclose(np.cross(left.force, normal), 0, rtol=0, atol=1e-11)


def test_what_two_supports_prescribe_alike_belongs_to_the_first():
    model = model_of(block_patch(spans=(2, 2, 2)))
    first, second = {"on": "block/left", "ux": 0.0}, {"on": "block/bottom", "ux": 0.0, "uz": 0.0}
    space, conditions, _, entries, carried = reactions_of(
        model, [first, second], lambda space: np.tile([1.0, 10.0, 100.0], space.size)
    )
    left, bottom = find_reactions(space, entries, conditions, carried)
    np.testing.assert_allclose(left.force, [9, 0, 0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(bottom.force, [6, 0, 900], rtol=0, atol=1e-13)


@given(st.permutations(range(4)), rotations())
def test_an_edge_that_several_supports_hold_is_counted_once(sequence, turn):
    """A direction that depends on earlier ones carries nothing, wherever it stands."""
    model = model_of(block_patch(turn=turn))
    supports = [
        {"on": "block/left", "normal": 0.0},
        {"on": "block/left", **FIXED},
        {"on": "block/bottom", "ux": 0.0, "normal": 0.0},
        {"on": "block/front", **FIXED},
    ]
    supports = [supports[place] for place in sequence]
    space, conditions, allowed, entries, carried = reactions_of(
        model, supports, lambda space: np.random.default_rng(0).normal(size=space.dofs)
    )
    reactions = find_reactions(space, entries, conditions, carried)
    held = (carried - allowed.matrix @ (allowed.matrix.T @ carried)).reshape(-1, 3)
    np.testing.assert_allclose(sum(r.force for r in reactions), held.sum(axis=0), rtol=0, atol=1e-13)
    assert np.abs(sum(r.force for r in reactions)).min() > 1e-3


def test_a_body_that_nothing_prescribes_has_no_reactions():
    space, conditions, _, entries, carried = reactions_of(
        model_of(block_patch()), [], lambda space: np.ones(space.dofs)
    )
    assert find_reactions(space, entries, conditions, carried) == ()
