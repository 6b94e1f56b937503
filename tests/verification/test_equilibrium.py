"""Forces balance: contact, loads and reactions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geom2iga.patch import refined
from solve.case import Solve
from solve.elasticity import assemble_stiffness
from solve.problem import prepare
from tests.cases import block_patch, converged, hollow_cylinder, model_of, moved, turned
from tests.oracles import assert_balanced
from tests.verification.glued_bodies import glued_model, wall

FIXED = {"ux": 0.0, "uy": 0.0, "uz": 0.0}
TRACTION = [0.05, -0.03, -1.0]


def punch_on_block(height=0.0, tilt=0.0, angle=0.0, **contact):
    """A loaded punch on a fixed block: model and case."""
    lower = block_patch("lower", size=(2, 2, 1), degree=2, spans=(3, 4, 2))
    turn = Rotation.from_euler("xz", [tilt, angle], degrees=True)
    upper = moved(
        turned(block_patch("upper", (-0.5, -0.5, 0), degree=2, spans=(4, 3, 2)), turn), (0.9, 1.1, 1 + height)
    )
    case = {
        "material": [{"young": 1000.0, "poisson": 0.3}],
        "support": [{"on": "lower/bottom", **FIXED}, {"on": "upper/top", "ux": 0.0, "uy": 0.0}],
        "load": [{"on": "upper/top", "traction": TRACTION}, {"on": "lower/right", "pressure": 0.5}],
        "body_force": [{"bodies": ["upper"], "force": [0.0, 0.0, -0.5]}],
        "contact": [{"secondary": "upper/bottom", "primary": "lower/top", "penalty": 1e4, **contact}],
    }
    return model_of(lower, upper), {"solve": case}


def glued_punch_on_blocks():
    """The same with bodies of four patches each."""
    _, tables = punch_on_block()
    lower = wall("l", (0, 0, 0), (2, 2, 1), 2, ((2, 1), (1, 2), (2,)))
    upper = wall("u", (0.4, 0.6, 1), (1, 1, 1), 2, ((1, 1), (2, 1), (1,)), shift=(0.2, 0.1))
    return glued_model({"lower": lower, "upper": upper}), tables


def ring_on_ring():
    """A tube in a tube, a small clearance between them, under pressure inside: contact of curved faces."""
    inner = refined(hollow_cylinder(1.0, 2.0, 1.0, "inner"), spans=2)
    outer = refined(hollow_cylinder(2.001, 3.0, 1.0, "outer"), spans=3)
    flat = [
        {"on": f"{ring}/{side}", "normal": 0.0}
        for ring in ("inner", "outer")
        for side in ("front", "back", "bottom", "top")
    ]
    case = {
        "material": [{"young": 1000.0, "poisson": 0.3}],
        "support": flat,
        "load": [{"on": "inner/left", "pressure": 20.0}],
        "contact": [{"secondary": "inner/right", "primary": "outer/left", "integration": "element"}],
    }
    return model_of(inner, outer), {"solve": case}


CASES = {
    "uneven traction": punch_on_block(),
    "apart": punch_on_block(height=0.05),
    "overlapping": punch_on_block(height=-0.02),
    "tilted and turned": punch_on_block(height=0.01, tilt=2.0, angle=30.0),
    "element cells": punch_on_block(angle=30.0, integration="element"),
    "several patches": glued_punch_on_blocks(),
    "curved faces": ring_on_ring(),
}


def forces_of(model, tables):
    """Solve, and return all forces (n, 3): loads, contact, reactions; with the problem and the result."""
    problem = prepare(model, Solve.model_validate(tables["solve"]))
    result = converged(model, tables)
    stiffness = assemble_stiffness(problem.space, result.materials)
    operator = problem.mortar.gap_operator
    loads, contact = problem.load, operator.T @ result.state.pressure
    reactions = stiffness @ result.state.displacement.ravel() - loads - contact
    return problem, result, [forces.reshape(-1, 3) for forces in (loads, contact, reactions)]


@pytest.mark.parametrize("name", CASES)
def test_loads_contact_forces_and_reactions_balance_on_every_body(name):
    problem, result, (loads, contact, reactions) = forces_of(*CASES[name])
    points = problem.space.control_points
    total = np.abs(loads).sum()
    assert np.abs(problem.allowed.matrix.T @ reactions.ravel()).max() < 1e-9 * total, "a reaction without a support"
    for body in problem.space.model.bodies:
        of_body = problem.space.body_numbers(body)
        assert_balanced((loads + contact + reactions)[of_body], points[of_body], tolerance=1e-9)
    assert result.statistics["equilibrium_error"] < 1e-9


@pytest.mark.parametrize("name", CASES)
def test_contact_forces_on_both_bodies_are_opposite_and_turn_about_the_same_line(name):
    problem, result, (_, contact, _) = forces_of(*CASES[name])
    assert np.abs(contact).sum() > 0.1
    assert_balanced(contact, problem.space.control_points, tolerance=1e-9)
    secondary = problem.space.body_numbers(list(problem.space.model.bodies)[0 if name == "curved faces" else 1])
    np.testing.assert_allclose(contact[secondary].sum(axis=0), result.contacts[0].force, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", [name for name in CASES if name != "curved faces"])
def test_the_contact_carries_the_load_and_the_weight_straight_down(name):
    """The interface has no friction, so what pushes sideways goes into the supports of the punch."""
    problem, result, (_, contact, reactions) = forces_of(*CASES[name])
    np.testing.assert_allclose(result.contacts[0].force, [0, 0, 1.0 + 0.5], rtol=0, atol=1e-9)
    assert np.abs(contact[:, :2]).max() < 1e-12
    upper, lower = (problem.space.body_numbers(body) for body in ("upper", "lower"))
    np.testing.assert_allclose(reactions[upper].sum(axis=0), [-0.05, 0.03, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(reactions[lower].sum(axis=0), [0.5 * 2, 0, 1.5], rtol=0, atol=1e-9)
