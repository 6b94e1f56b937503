import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geom2iga.errors import CaseError
from geom2iga.model import SIDES, Model
from geom2iga.patch import evaluate
from solve.case import Support
from solve.constraints import constrain, find_conditions
from solve.face import find_plane, surface_of
from solve.space import number_control_points
from tests.cases import bent_patch, block_patch, hollow_cylinder, model_of
from tests.strategies import SEEDS, rotations
from tests.verification.glued_bodies import glued_model, wall

VALUES = st.floats(-2, 2)


def allowed_by(space, *supports):
    entries = [Support(**support) for support in supports]
    return constrain(space, find_conditions(space, entries), entries)


def any_displacement(allowed, seed=0):
    """A random displacement (n, 3) that the supports allow."""
    free = np.random.default_rng(seed).normal(size=allowed.size)
    return (allowed.matrix @ free + allowed.offset).reshape(-1, 3)


def assert_orthonormal(matrix):
    np.testing.assert_allclose((matrix.T @ matrix).toarray(), np.eye(matrix.shape[1]), rtol=0, atol=1e-14)


@given(SEEDS, st.sampled_from(SIDES), st.sampled_from(["ux", "uy", "uz"]), VALUES)
def test_a_component_is_prescribed_on_its_face_and_free_elsewhere(seed, side, key, value):
    space = number_control_points(model_of(bent_patch(seed)))
    allowed = allowed_by(space, {"on": f"bent/{side}", key: value})
    held = space.face_numbers(space.model.faces(f"bent/{side}")[0])
    component = ("ux", "uy", "uz").index(key)
    displacement = any_displacement(allowed, seed)
    np.testing.assert_array_equal(displacement[held, component], value)
    assert allowed.size == space.dofs - len(held)
    free = np.ones((space.size, 3), dtype=bool)
    free[held, component] = False
    assert np.all(displacement[free] != 0)
    assert_orthonormal(allowed.matrix)


@given(rotations(), st.sampled_from(SIDES), VALUES, SEEDS)
def test_a_normal_support_prescribes_the_motion_along_an_oblique_normal_alone(turn, side, value, seed):
    space = number_control_points(model_of(block_patch(degree=2, spans=(2, 2, 2), turn=turn)))
    allowed = allowed_by(space, {"on": f"block/{side}", "normal": value})
    (face,) = space.model.faces(f"block/{side}")
    normal = find_plane(surface_of(space.model, face)).normal
    displacement = any_displacement(allowed, seed)
    xi = np.insert(np.random.default_rng(seed).random((20, 2)), face.axis, face.side, axis=1)
    (on_face,) = evaluate(space.model.patches["block"], xi, 0, displacement)
    np.testing.assert_allclose(on_face @ normal, value, rtol=0, atol=2e-15 * (1 + np.abs(on_face).max()))
    assert allowed.size == space.dofs - len(space.face_numbers(face))
    assert_orthonormal(allowed.matrix)
    in_plane = displacement[space.face_numbers(face)] - value * normal
    assert np.linalg.matrix_rank(in_plane) == 2


@given(rotations(), st.tuples(VALUES, VALUES, VALUES), SEEDS)
def test_faces_that_share_edges_and_a_corner_hold_all_their_values_there(turn, values, seed):
    space = number_control_points(model_of(block_patch(degree=2, turn=turn)))
    sides = ("left", "front", "bottom")
    supports = [{"on": f"block/{side}", "normal": value} for side, value in zip(sides, values, strict=True)]
    allowed = allowed_by(space, *supports)
    displacement = any_displacement(allowed, seed)
    faces = [space.model.faces(f"block/{side}")[0] for side in sides]
    normals = [find_plane(surface_of(space.model, face)).normal for face in faces]
    for face, normal, value in zip(faces, normals, values, strict=True):
        along = displacement[space.face_numbers(face)] @ normal
        np.testing.assert_allclose(along, value, rtol=0, atol=1e-15 * (10 + np.abs(displacement).max()))
    (corner,) = set.intersection(*(set(space.face_numbers(face)) for face in faces))
    np.testing.assert_allclose(displacement[corner], np.array(values) @ normals, rtol=0, atol=1e-14)
    assert allowed.size == space.dofs - 3 * 9
    assert_orthonormal(allowed.matrix)


def test_a_normal_and_a_component_that_ask_for_the_same_count_once():
    space = number_control_points(model_of(block_patch()))
    once = allowed_by(space, {"on": "block/left", "ux": 0.25})
    twice = allowed_by(space, {"on": "block/left", "ux": 0.25}, {"on": "block/left", "normal": -0.25})
    assert once.size == twice.size
    np.testing.assert_allclose(once.offset, twice.offset, rtol=0, atol=1e-16)


@given(SEEDS, st.floats(0.1, 1.5))
def test_a_support_at_an_angle_to_another_leaves_the_direction_that_neither_holds(seed, tilt):
    """The bottom is held along the vertical, the left side along its own normal, more or less the same direction."""
    space = number_control_points(model_of(block_patch(turn=Rotation.from_rotvec([0, tilt, 0]))))
    allowed = allowed_by(space, {"on": "block/bottom", "uz": 0.3}, {"on": "block/left", "normal": 0.2})
    bottom, left = (space.model.faces(f"block/{side}")[0] for side in ("bottom", "left"))
    normal = find_plane(surface_of(space.model, left)).normal
    displacement = any_displacement(allowed, seed)
    np.testing.assert_allclose(displacement[space.face_numbers(bottom), 2], 0.3, rtol=0, atol=1e-12)
    np.testing.assert_allclose(displacement[space.face_numbers(left)] @ normal, 0.2, rtol=0, atol=1e-12)
    edge = np.intersect1d(space.face_numbers(bottom), space.face_numbers(left))
    assert np.all(displacement[edge, 1] != 0)


@pytest.mark.parametrize(
    ("turn", "supports"),
    [
        (None, [{"on": "block/left", "ux": 0.1}, {"on": "block/left", "ux": 0.2}]),
        (None, [{"on": "block/left", "uz": 0.1}, {"on": "block/bottom", "uz": 0.2}]),
        (None, [{"on": "block/left", "ux": 0.1}, {"on": "block/left", "normal": 0.1}]),
        (30, [{"on": "block/left", "ux": 0.0, "uy": 0.0}, {"on": "block/front", "normal": 1e-3}]),
    ],
)
def test_supports_that_contradict_each_other_are_both_named_with_the_place(turn, supports):
    by = None if turn is None else Rotation.from_rotvec([0, 0, turn], degrees=True)
    space = number_control_points(model_of(block_patch(turn=by)))
    with pytest.raises(CaseError) as error:
        allowed_by(space, *supports)
    message = str(error.value)
    for number, support in enumerate(supports):
        assert f'solve.support[{number}] on "{support["on"]}"' in message
    assert "(0, 0, " in message


def test_a_support_that_does_not_take_part_in_a_conflict_is_not_named():
    space = number_control_points(model_of(block_patch()))
    with pytest.raises(CaseError) as error:
        allowed_by(
            space,
            {"on": "block/left", "uy": 0.7},
            {"on": "block/left", "ux": 0.1},
            {"on": "block/left", "ux": 0.2},
        )
    assert "support[0]" not in str(error.value)


def test_no_supports_leave_everything_free():
    space = number_control_points(model_of(block_patch()))
    allowed = allowed_by(space)
    np.testing.assert_array_equal(allowed.matrix.toarray(), np.eye(space.dofs))
    assert not allowed.offset.any()


@pytest.mark.parametrize(
    ("support", "names"),
    [
        ({"on": "ring/left", "normal": 0.0}, ["solve.support[1]", '"ring/left" is curved', "ux, uy or uz"]),
        ({"on": "ring/lft", "ux": 0.0}, ["solve.support[1]", '"ring/lft"', 'did you mean "ring/left"']),
    ],
)
def test_a_support_that_does_not_fit_the_model_is_named(support, names):
    space = number_control_points(model_of(hollow_cylinder()))
    with pytest.raises(CaseError) as error:
        allowed_by(space, {"on": "ring/right", "uz": 0.0}, support)
    assert all(name in str(error.value) for name in names)


def test_a_support_on_several_faces_holds_what_they_share_once():
    space = number_control_points(glued_model({"wall": wall("w", degree=2)}))
    allowed = allowed_by(space, {"on": "wall/bottom", "normal": 0.25})
    numbers = space.group_numbers("wall/bottom")
    assert allowed.size == space.dofs - len(numbers)
    np.testing.assert_array_equal(any_displacement(allowed, 0)[numbers, 2], -0.25)


def test_a_normal_support_on_faces_in_several_planes_holds_each_along_its_own_normal():
    glued = glued_model({"wall": wall("w", degree=2)})
    faces = (*glued.faces("wall/left"), *glued.faces("wall/bottom"))
    space = number_control_points(Model(glued.patches, glued.bodies, {**glued.groups, "both": faces}, glued.glued))
    together = allowed_by(space, {"on": "both", "normal": 0.25})
    apart = allowed_by(space, *({"on": f"wall/{side}", "normal": 0.25} for side in ("left", "bottom")))
    np.testing.assert_allclose(together.offset, apart.offset, rtol=0, atol=1e-15)
    assert together.size == apart.size
    np.testing.assert_allclose(together.matrix @ together.matrix.T.toarray(), apart.matrix @ apart.matrix.T.toarray())
