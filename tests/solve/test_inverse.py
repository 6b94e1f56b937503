"""The preconditioner without contact."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.sparse import csr_array, eye_array, random_array
from scipy.spatial.transform import Rotation

from geom2iga.patch import Face, elevated, refined
from solve.case import Support
from solve.constraints import constrain, find_conditions
from solve.inverse import Inverse
from solve.material import Material
from solve.space import number_control_points
from tests.cases import bent_patch, block_patch, hollow_cylinder, model_of, turned
from tests.solve.joined import closed_ring
from tests.strategies import SEEDS, bent_patches
from tests.verification.glued_bodies import glued_model, halves, star, wall

STEEL = Material(200.0, 0.3)
MODELS = {
    "cuboid": (model_of(block_patch("body", degree=2, spans=(2, 1, 2))), ("body/bottom", "body/top")),
    "bent": (model_of(bent_patch(1, (1, 2, 3), (2, 2, 1), name="body")), ("body/top",)),
    "three faces around a corner": (
        model_of(bent_patch(2, (2, 1, 2), (1, 2, 1), name="body")),
        ("body/left", "body/back", "body/top"),
    ),
    "opposite curved faces": (
        model_of(refined(elevated(hollow_cylinder(name="body"), (2, 2, 1)), spans=2)),
        ("body/left", "body/right"),
    ),
    "two bodies": (
        model_of(bent_patch(3, (1, 1, 1), name="body"), block_patch("other", degree=2)),
        ("body/top", "other/bottom"),
    ),
    "two halves": (glued_model({"body": halves(bent_patch(3, (2, 1, 1), name="body"), 0, 0.4)}), ("body/skin",)),
    "four blocks around an edge": (glued_model({"body": wall("b", shift=(0.2, -0.1))}), ("body/top",)),
    "closed ring": (replace(closed_ring("body"), groups={"body/top": (Face("body", 2, 1),)}), ("body/top",)),
    "three blocks around an edge": (glued_model({"body": star("s", 3, spans=(1, 1, 1))}), ("body/top", "body/bottom")),
}


def inverse_of(model, groups, supports=()):
    """The preconditioner, and the projection on what the supports allow."""
    space = number_control_points(model)
    matrix = constrain(space, find_conditions(space, supports), supports).matrix
    freedom = csr_array(matrix @ matrix.T)
    touching = [face for group in groups for face in model.faces(group)]
    return space, Inverse(space, dict.fromkeys(model.bodies, STEEL), freedom, touching), matrix


def dense(space, inverse):
    """All of it, (dofs, dofs)."""
    columns = [inverse.displacements(inverse.modes(force)) for force in np.eye(space.dofs, dtype=np.float32)]
    return np.array(columns, dtype=float).T


def gap_operator(space, model, groups, seed=0, rows=7):
    """A random gap operator (m, dofs) on some faces."""
    numbers = np.unique(np.concatenate([space.group_numbers(group) for group in groups]))
    columns = (3 * numbers[:, None] + np.arange(3)).ravel()
    chosen = eye_array(space.dofs, format="csr")[columns]
    return csr_array(random_array((rows, len(columns)), density=0.4, rng=np.random.default_rng(seed)) @ chosen)


SUPPORTS = {
    "free": (),
    "clamped": (Support(on="body/bottom", ux=0, uy=0, uz=0),),
    "held along one axis": (Support(on="body/bottom", uz=0),),
}


HELD = [
    (name, held) for name in MODELS for held in SUPPORTS if held == "free" or "body/bottom" in MODELS[name][0].groups
]


@pytest.mark.parametrize(("name", "held"), HELD)
def test_it_is_symmetric_and_positive_definite_on_all_that_the_supports_allow(name, held):
    """Up to single precision."""
    model, groups = MODELS[name]
    space, inverse, matrix = inverse_of(model, groups, SUPPORTS[held])
    found = matrix.T @ dense(space, inverse) @ matrix
    np.testing.assert_allclose(found, found.T, rtol=0, atol=1e-5 * np.abs(found).max())
    values = np.linalg.eigvalsh((found + found.T) / 2)
    assert values[0] > 1e-5 * values[-1]


@pytest.mark.parametrize("name", MODELS)
def test_between_the_gaps_it_is_what_it_is_on_the_whole_body(name):
    model, groups = MODELS[name]
    space, inverse, _ = inverse_of(model, groups)
    operator = gap_operator(space, model, groups)
    expected = operator @ dense(space, inverse) @ operator.T
    found = inverse.between(operator)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
    np.testing.assert_allclose(found, found.T, rtol=0, atol=1e-12 * np.abs(found).max())


@pytest.mark.parametrize("name", MODELS)
def test_forces_on_touching_faces_alone_and_their_displacements_need_no_whole_body(name):
    model, groups = MODELS[name]
    space, inverse, _ = inverse_of(model, groups)
    operator = gap_operator(space, model, groups, rows=1).astype(np.float32)
    force = operator.T @ np.ones(1, dtype=np.float32)
    whole, faces = inverse.modes(force), inverse.pushed(force)
    moved = inverse.displacements(whole)
    for one, other in zip(whole, faces, strict=True):
        np.testing.assert_allclose(np.broadcast_to(other, one.shape), one, rtol=0, atol=1e-5 * np.abs(one).max())
    numbers = np.unique(np.concatenate([space.group_numbers(group) for group in groups]))
    traced = inverse.traced(whole).reshape(-1, 3)
    tolerance = 1e-5 * np.abs(moved).max()
    np.testing.assert_allclose(traced[numbers], moved.reshape(-1, 3)[numbers], rtol=0, atol=tolerance)


@settings(max_examples=6)
@given(bent_patches(2), SEEDS)
def test_its_answers_are_those_of_a_turned_body_turned_back(patch, seed):
    """Its frames turn with the body."""
    turn = Rotation.random(random_state=seed)
    space, inverse, _ = inverse_of(model_of(patch), ())
    _, other, _ = inverse_of(model_of(turned(patch, turn)), ())
    force = np.random.default_rng(seed).normal(size=(space.size, 3))
    one = inverse.displacements(inverse.modes(force.ravel().astype(np.float32))).reshape(-1, 3)
    forces = turn.apply(force).ravel().astype(np.float32)
    back = turn.apply(other.displacements(other.modes(forces)).reshape(-1, 3), inverse=True)
    np.testing.assert_allclose(back, one, rtol=0, atol=1e-4 * np.abs(one).max())
