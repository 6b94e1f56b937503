import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geom2iga.errors import CaseError
from geom2iga.model import Model
from solve.case import Contact, Load, Support
from solve.constraints import constrain, find_conditions
from solve.contact.cells import find_cells
from solve.contact.mortar import assemble_mortar, stacked
from solve.elasticity import assemble_stiffness
from solve.loads import assemble_loads
from solve.material import Material
from solve.rigid import check_held, check_pressed, find_pieces, kernel, unsupported
from solve.space import number_control_points
from tests.cases import bent_patch, block_groups, block_patch, model_of, turned
from tests.strategies import SEEDS, bent_patches, rotations
from tests.verification.glued_bodies import glued_model, star, wall


def held(model, supports, contacts=()):
    """Conditions and stacked mortar of a model, for the checks."""
    space = number_control_points(model)
    entries = [Support(**support) for support in supports]
    pairs = [Contact(secondary=s, primary=p) for s, p in contacts]
    return (
        space,
        find_conditions(space, entries),
        stacked([assemble_mortar(space, pair, find_cells(model, pair)) for pair in pairs], space.dofs),
    )


def complaint(model, supports, contacts=()):
    with pytest.raises(CaseError) as error:
        check_held(*held(model, supports, contacts))
    return str(error.value)


@given(bent_patches(highest=2))
def test_rigid_modes_are_six_independent_motions_per_body_of_size_one_that_cost_nothing(patch):
    space = number_control_points(model_of(block_patch(), patch))
    modes = unsupported(space, find_conditions(space, []))
    assert modes.shape == (space.dofs, 12)
    assert np.linalg.matrix_rank(modes) == 12
    stiffness = assemble_stiffness(space, dict.fromkeys(space.model.bodies, Material(1.0, 0.3)))
    assert np.abs(stiffness @ modes).max() < 1e-11 * abs(stiffness).max()
    sizes = np.linalg.norm(modes.reshape(space.size, 3, 12), axis=1).max(axis=0)
    assert np.all((sizes <= 1 + 1e-12) & (sizes > 0.3))


@given(SEEDS, st.integers(1, 6), st.integers(0, 8), st.integers(0, 6))
def test_a_kernel_is_orthonormal_complete_and_taken_to_zero(seed, columns, rows, rank):
    random = np.random.default_rng(seed)
    rank = min(rank, rows, columns)
    matrix = random.normal(size=(rows, rank)) @ random.normal(size=(rank, columns))
    found = kernel(matrix)
    assert found.shape == (columns, columns - rank)
    np.testing.assert_allclose(found.T @ found, np.eye(columns - rank), rtol=0, atol=1e-12)
    np.testing.assert_allclose(matrix @ found, 0, rtol=0, atol=1e-9 * max(1, np.abs(matrix).max(initial=0)))


@given(st.sets(st.sampled_from(["left", "front", "bottom"])), rotations())
def test_unsupported_motions_are_rigid_and_meet_all_supports(sides, turn):
    model = model_of(block_patch(turn=turn), bent_patch(0))
    supports = [{"on": f"block/{side}", "normal": 0.0} for side in sides]
    space, conditions, _ = held(model, supports)
    modes = unsupported(space, conditions)
    assert modes.shape[1] == 12 - [0, 3, 5, 6][len(sides)]
    entries = [Support(**support) for support in supports]
    matrix = constrain(space, conditions, entries).matrix
    np.testing.assert_allclose(matrix @ (matrix.T @ modes), modes, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("supports", "slides", "turns"),
    [
        ([], "x, y and z", "x, y and z"),
        ([{"on": "block/bottom", "uz": 0}], "x and y", "z"),
        ([{"on": "block/bottom", "uz": 0}, {"on": "block/left", "ux": 0}], "y", ""),
        ([{"on": "block/bottom", "ux": 0, "uy": 0}], "z", "x and y"),
        ([{"on": f"block/{side}", "ux": 0, "uy": 0} for side in ("bottom", "top")], "z", ""),
        ([{"on": "block/front", "uz": 0}, {"on": "block/top", "ux": 0, "uy": 0}], "", "x"),
        ([{"on": "block/front", "uz": 0}, {"on": "block/top", "uy": 0}], "x", "x"),
    ],
    ids=["free", "on a plane", "on a rail", "on a pin", "in a shaft", "on a hinge", "on a hinge that slides"],
)
def test_free_motions_of_a_body_are_named(supports, slides, turns):
    message = complaint(model_of(block_patch()), supports)
    parts = [f"{verb} {axes}" for verb, axes in (("slide along", slides), ("turn about", turns)) if axes]
    assert f'body "block" can {" and ".join(parts)}: ' in message


def test_a_free_motion_along_no_axis_is_named_by_its_direction():
    turn = Rotation.from_rotvec([0, 0, 30], degrees=True)
    model = model_of(block_patch(turn=turn))
    message = complaint(model, [{"on": "block/bottom", "normal": 0.0}, {"on": "block/left", "normal": 0.0}])
    direction = message.split("slide along (")[1].split(")")[0]
    along = np.array([float(part) for part in direction.split(", ")])
    np.testing.assert_allclose(np.abs(along @ turn.apply([0, 1, 0])), 1, rtol=0, atol=1e-2)
    assert "turn" not in message


def test_every_free_body_is_named_and_no_other():
    model = model_of(*(block_patch(name, (3 * k, 0, 0)) for k, name in enumerate(("one", "two", "three"))))
    everything = {"ux": 0.0, "uy": 0.0, "uz": 0.0}
    message = complaint(model, [{"on": "two/left", **everything}])
    assert '"one"' in message
    assert '"three"' in message
    assert '"two"' not in message


@given(rotations())
def test_a_block_held_on_three_faces_is_held_however_it_lies(turn):
    model = model_of(block_patch(turn=turn))
    check_held(*held(model, [{"on": f"block/{side}", "normal": 0.0} for side in ("right", "back", "top")]))


STACK = model_of(block_patch("lower", size=(2, 2, 1)), block_patch("upper", (0.5, 0.5, 1), spans=(2, 2, 1)))
LOWER = [{"on": "lower/bottom", "ux": 0.0, "uy": 0.0, "uz": 0.0}]
PAIR = [("upper/bottom", "lower/top")]


def test_contact_holds_along_its_normal_and_against_tilting_alone():
    message = complaint(STACK, LOWER, PAIR)
    assert '"upper" can slide along x and y and turn about z' in message
    assert '"lower"' not in message


def test_a_body_that_contact_holds_in_the_directions_that_supports_leave_is_accepted():
    sides = [{"on": "upper/left", "ux": 0.0}, {"on": "upper/front", "uy": 0.0}]
    check_held(*held(STACK, LOWER + sides, PAIR))
    assert '"upper" can slide along z' in complaint(STACK, LOWER + sides)


@given(st.floats(10, 80), rotations())
def test_a_wedge_between_two_inclined_planes_is_held_by_contact_alone_across_them(angle, turn):
    """A prism rests on two blocks whose faces are inclined to each other; along its edge nothing holds it."""
    tilt = [Rotation.from_rotvec([0, sign * angle / 2, 0], degrees=True) for sign in (1, -1)]
    prism = block_patch("prism", (-0.5, -0.5, 0))
    below = [
        turned(block_patch(name, (-0.4, -0.4, -1), (0.8, 0.8, 1)), by)
        for name, by in zip(("one", "two"), tilt, strict=True)
    ]
    model = model_of(*(turned(patch, turn) for patch in (prism, *below)))
    supports = [{"on": f"{name}/bottom", "ux": 0.0, "uy": 0.0, "uz": 0.0} for name in ("one", "two")]
    contacts = [("one/top", "prism/bottom"), ("two/top", "prism/bottom")]
    message = complaint(model, supports, contacts)
    assert '"prism" can slide' in message
    assert '"one"' not in message


def pressed(load, model=STACK, supports=(), contacts=PAIR):
    """Check a traction on top of the upper block, which contact alone holds along z."""
    sides = [{"on": "upper/left", "ux": 0.0}, {"on": "upper/front", "uy": 0.0}]
    space, conditions, mortar = held(model, [*LOWER, *sides, *supports], contacts)
    forces = assemble_loads(space, [Load(on="upper/top", traction=load)], [], []).ravel()
    check_pressed(space, unsupported(space, conditions), mortar, forces)


def test_loads_that_press_are_accepted_and_loads_that_pull_name_the_body():
    pressed((0.3, 0.2, -1.0))
    pressed((0.0, 0.0, 0.0))
    with pytest.raises(CaseError, match='pull body "upper" off'):
        pressed((0.0, 0.0, 1e-3))


def test_a_load_that_pulls_is_accepted_where_a_support_takes_it():
    pressed((0.0, 0.0, 1.0), supports=[{"on": "upper/top", "uz": 0.0}])


@pytest.mark.parametrize(("offset", "falls"), [(0.4, False), (0.6, True)])
def test_a_block_that_hangs_over_by_more_than_half_tips(offset, falls):
    """Its centre of mass decides, whatever the contact pressure."""
    lower = block_patch("lower", (-1, 0, 0), (1, 1, 1), spans=(4, 1, 1))
    upper = block_patch("upper", (offset - 1, 0, 1), spans=(20, 1, 1))
    space, conditions, mortar = held(
        model_of(lower, upper),
        [{"on": "lower/bottom", "ux": 0.0, "uy": 0.0, "uz": 0.0}, {"on": "upper/front", "uy": 0.0}],
        [("lower/top", "upper/bottom")],
    )
    forces = assemble_loads(space, [Load(on="upper/top", pressure=1.0)], [], []).ravel()
    rigid = unsupported(space, conditions)
    if falls:
        with pytest.raises(CaseError, match='"upper"'):
            check_pressed(space, rigid, mortar, forces)
    else:
        check_pressed(space, rigid, mortar, forces)


def test_nothing_to_check_is_in_order():
    space, conditions, mortar = held(model_of(block_patch()), [{"on": "block/left", "ux": 0, "uy": 0, "uz": 0}])
    check_held(space, conditions, mortar)
    check_pressed(space, np.empty((space.dofs, 0)), mortar, np.ones(space.dofs))


def test_a_glued_body_moves_as_one():
    model = glued_model({"wall": wall("w"), "star": star("s", 3, (5, 0, 0))})
    assert len(find_pieces(number_control_points(model)).names) == 2
    message = complaint(model, [{"on": "wall/left", "ux": 0.0, "uy": 0.0, "uz": 0.0}])
    assert 'body "star" can slide along x, y and z' in message
    assert '"wall"' not in message


def loose_pair():
    """Two blocks of one body, nowhere glued."""
    patches = {name: block_patch(name, (k, 0, 0)) for k, name in enumerate(("one", "two"))}
    groups = block_groups("one") | block_groups("two")
    return Model(patches, {"pair": tuple(patches)}, groups)


def test_patches_of_a_body_that_are_not_glued_are_named_where_nothing_holds_them():
    everything = {"ux": 0.0, "uy": 0.0, "uz": 0.0}
    message = complaint(loose_pair(), [{"on": "one/left", **everything}])
    assert 'the piece of body "pair" with patch "two", not glued to the rest of the body, can slide' in message
    assert '"one"' not in message
    check_held(*held(loose_pair(), [{"on": f"{name}/left", **everything} for name in ("one", "two")]))
