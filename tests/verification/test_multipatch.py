"""Bodies of several glued patches behave as if they were of one."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from geom2iga.model import Glued, Model
from geom2iga.patch import Face, evaluate
from solve.elasticity import assemble_stiffness
from solve.loads import body_load
from solve.material import Material
from solve.rigid import find_pieces
from solve.space import check_right_handed, number_control_points
from tests.cases import bent_patch, block_patch, converged, displacement_at, largest_stress_error, model_of
from tests.oracles import assert_rigid_motion_costs_nothing, assert_symmetric
from tests.strategies import SEEDS
from tests.verification.glued_bodies import (
    RIGHT_HANDED,
    glued_model,
    halves,
    pressed,
    star,
    turned_round,
    wall,
    with_joint,
)

UNIFORM = (0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
TOLERANCE = 1e-10
STEEL = Material(1000.0, 0.3)


def stiffness_of(model):
    space = number_control_points(model)
    return space, assemble_stiffness(space, dict.fromkeys(model.bodies, STEEL))


def test_right_handed_patches_meet_in_all_eight_orientations():
    first, second = halves(block_patch(degree=2), 0, 0.5)
    models = [glued_model({"body": [first, turned_round(second, *way)]}) for way in RIGHT_HANDED]
    assert {model.glued[0].orientation for model in models} == set(range(8))
    for model in models:
        check_right_handed(model)


@pytest.mark.parametrize("way", RIGHT_HANDED, ids=str)
def test_two_glued_patches_have_the_stiffness_of_the_one_they_were_cut_from(way):
    """However the second patch is turned; the one patch is merely continuous at the joint, as the two are.

    It is polynomial, so that all have the same Gauss points.
    """
    whole = bent_patch(1, degrees=(2, 1, 2), spans=(2, 2, 1), rational=False)
    first, second = halves(whole, 0, 0.5)
    model = glued_model({"body": [first, turned_round(second, *way)]})
    space, found = stiffness_of(model)
    reference, expected = stiffness_of(model_of(with_joint(whole, 0, 0.5)))
    assert space.size == reference.size
    distance, nearest = cKDTree(reference.control_points).query(space.control_points)
    assert distance.max() < 1e-12
    assert len(set(nearest)) == space.size
    dofs = (3 * nearest[:, None] + np.arange(3)).ravel()
    assert abs(found - expected[dofs][:, dofs]).max() < 1e-13 * abs(expected).max()


@given(SEEDS, st.sampled_from(RIGHT_HANDED), st.integers(0, 2))
def test_every_displacement_is_continuous_across_the_joint(seed, way, axis):
    first, second = halves(bent_patch(seed, (1, 2, 3), (2, 2, 2)), axis, 0.5)
    model = glued_model({"body": [first, turned_round(second, *way)]})
    (pair,) = model.glued
    space = number_control_points(model)
    displacement = np.random.default_rng(seed).normal(size=(space.size, 3))
    (here, from_here), (there, from_there) = (
        sampled(model.surface(face), displacement[space.face_numbers(face)]) for face in (pair.first, pair.second)
    )
    order, other = (np.lexsort(np.round(points, 9).T) for points in (here, there))
    np.testing.assert_allclose(here[order], there[other], rtol=0, atol=1e-12)
    np.testing.assert_allclose(from_here[order], from_there[other], rtol=0, atol=1e-12)


def sampled(surface, field):
    """Position and field on a grid that looks the same from all sides."""
    line = np.linspace(0, 1, 5)
    grid = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    return evaluate(surface, grid)[0], evaluate(surface, grid, 0, field)[0]


BODIES = {
    "two halves": glued_model({"body": halves(bent_patch(3), 1, 0.4)}),
    "four blocks around an edge": glued_model({"body": wall("b", degree=2, shift=(0.2, -0.1))}),
    "three blocks around an edge": glued_model({"body": star("s", 3, degree=2)}),
    "eight blocks around a point": glued_model({"body": wall("b", spans=((1, 2), (2, 1), (1, 1)), degree=2)}),
}


@pytest.mark.parametrize("name", BODIES)
def test_rigid_motions_of_a_glued_body_cost_nothing_and_nothing_else_does(name):
    space, stiffness = stiffness_of(BODIES[name])
    assert_symmetric(stiffness)
    assert_rigid_motion_costs_nothing(stiffness, space.control_points)
    energies = np.linalg.eigvalsh(stiffness.toarray())
    assert np.count_nonzero(energies < 1e-10 * energies[-1]) == 6 * len(find_pieces(space).names) == 6


def closed_ring(degree=2, spans=8):
    """A bent bar whose two ends are one: periodic around z."""
    bar = block_patch("ring", degree=(degree, 2, 1), spans=(spans, 1, 1))
    along, radius, z = np.moveaxis(bar.control_points, -1, 0)
    angle = -2 * np.pi * along
    points = np.stack([(1 + radius) * np.cos(angle), (1 + radius) * np.sin(angle), z], axis=-1)
    points[-1] = points[0]
    patch = type(bar)("ring", bar.degrees, bar.knots, points)
    return Model({"ring": patch}, {"ring": ("ring",)}, {}, (Glued(Face("ring", 0, 0), Face("ring", 0, 1), 0),))


@pytest.mark.parametrize("spans", [1, 2, 8])
def test_a_patch_glued_to_itself_is_closed(spans):
    """Even where one span has both ends, and so the same number twice."""
    model = closed_ring(degree=4, spans=spans)
    space, stiffness = stiffness_of(model)
    assert space.size == (spans + 3) * 3 * 2
    assert_rigid_motion_costs_nothing(stiffness, space.control_points)
    volume = body_load(space, "ring", np.array([0.0, 0.0, 1.0]))[:, 2]
    assert volume.sum() == pytest.approx(body_load(*torn(model), np.array([0.0, 0.0, 1.0]))[:, 2].sum(), rel=1e-13)
    energies = np.linalg.eigvalsh(stiffness.toarray())
    assert np.count_nonzero(energies < 1e-10 * energies[-1]) == 6


def torn(model):
    """The same patch, not glued."""
    return number_control_points(model_of(*model.patches.values())), "ring"


COARSE, FINE = ((2, 1), (1, 2), (1,)), ((1, 2), (3, 1), (1,))
TALL, LAYERS = ((2, 1), (1, 2), (1, 1)), ((1, 2), (3, 1), (1, 2))
SIDES = ("lower/left", "lower/front", "upper/left", "upper/front")


def blocks_on_blocks(degree):
    return wall("l", (0, 0, 0), (2, 2, 1), degree, COARSE), wall("u", (0.3, 0.45, 1), (1, 1.2, 1), degree, FINE), SIDES


def overhanging_blocks_in_layers(degree):
    return wall("l", (0, 0, 0), (2, 2, 1), degree, TALL), wall("u", (-0.3, 0.45, 1), (1, 2, 1), degree, LAYERS), SIDES


def three_around_an_edge_on_four_blocks(degree):
    hexagon = star("u", 3, (1, 0.9, 1), 0.6, degree=degree, spans=(3, 3, 1))
    return wall("l", (0, 0, 0), (2, 2, 1), degree, COARSE), hexagon, (*SIDES[:2], "upper/joints")


def three_around_an_edge_on_five_around_another(degree):
    hexagon = star("u", 3, (0.1, -0.05, 1), 0.7, degree=degree, spans=(3, 3, 1))
    return star("l", 5, degree=degree), hexagon, ("lower/joints", "upper/joints")


PAIRS = [
    blocks_on_blocks,
    overhanging_blocks_in_layers,
    three_around_an_edge_on_four_blocks,
    three_around_an_edge_on_five_around_another,
]
SWAP = pytest.mark.parametrize("swap", [False, True], ids=["upper secondary", "lower secondary"])


def solved(lower, upper, held, **contact):
    model = glued_model({"lower": lower, "upper": upper})
    return converged(model, pressed(held, **contact))


def assert_passed(result, area, swap):
    """The stress is right at 1000 random points of each patch, the contact carries the pressure."""
    assert largest_stress_error(result, UNIFORM) < TOLERANCE
    np.testing.assert_allclose(result.contacts[0].force, [0, 0, -area if swap else area], rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(result.contacts[0].pressure, 1, rtol=0, atol=1e-8)
    assert result.statistics["equilibrium_error"] < TOLERANCE


AREAS = dict(zip(PAIRS, (1.2, 0.7 * 1.55, 1.5 * 3**0.5 * 0.6**2, 1.5 * 3**0.5 * 0.7**2), strict=True))


QUICK = {blocks_on_blocks: 2, overhanging_blocks_in_layers: 1, three_around_an_edge_on_four_blocks: 3}


SLOW = pytest.mark.slow
COMBINATIONS = [  # every pair with every degree; one degree each by default
    pytest.param(pair, degree, marks=() if QUICK.get(pair, 2) == degree else SLOW, id=f"{pair.__name__}-{degree}")
    for pair, degree in product(PAIRS, (1, 2, 3))
]


@SWAP
@pytest.mark.parametrize(("pair", "degree"), COMBINATIONS)
def test_the_patch_test_holds_between_bodies_of_several_patches(pair, degree, swap):
    assert_passed(solved(*pair(degree), swap=swap), AREAS[pair], swap)


def alike(degree, shifts=((0.2, -0.15), (-0.15, 0.25))):
    """Two bodies that cover each other, of blocks whose contact faces are no parallelograms."""
    lower = wall("l", (0, 0, 0), (2, 2, 1), degree, COARSE, shifts[0])
    return lower, wall("u", (0, 0, 1), (2, 2, 1), degree, FINE, shifts[1]), SIDES


@SWAP
@pytest.mark.parametrize("degree", [1, pytest.param(2, marks=SLOW), pytest.param(3, marks=SLOW)])
def test_the_patch_test_holds_where_contact_faces_are_no_parallelograms(degree, swap):
    """No load is cut out where the other body covers it, so no error of the cells can cancel."""
    lower, upper, held = alike(degree)
    tables = pressed(held, swap=swap)
    del tables["solve"]["load"][1:]
    result = converged(glued_model({"lower": lower, "upper": upper}), tables)
    assert_passed(result, 4.0, swap)


def test_on_strongly_skewed_faces_the_patch_test_is_approached_exponentially_with_the_points():
    lower, upper, held = alike(1, ((0.45, -0.4), (-0.15, 0.25)))
    model, tables = glued_model({"lower": lower, "upper": upper}), pressed(held, swap=True)
    del tables["solve"]["load"][1:]
    errors = []
    for points in (4, 8, 12):
        tables["solve"]["contact"][0]["points"] = points
        errors.append(largest_stress_error(converged(model, tables), UNIFORM))
    assert errors[0] > 30 * errors[1] > 30**2 * errors[2]


def test_faces_that_look_elsewhere_may_be_named_with_those_that_touch():
    lower, upper, held = blocks_on_blocks(2)
    model, tables = glued_model({"lower": lower, "upper": upper}), pressed(held)
    tables["solve"]["contact"][0] |= {"secondary": "upper/skin"}
    assert_passed(converged(model, tables), 1.2, False)


@SLOW
@SWAP
@pytest.mark.parametrize("penalty", [1e2, "auto", 1e8])
@pytest.mark.parametrize("count", [3, 4, 5, 6])
@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_the_patch_test_holds_for_any_number_of_patches_around_an_edge(degree, count, penalty, swap):
    lower = wall("l", (-1.5, -1.5, 0), (3, 3, 1), degree, COARSE)
    upper = star("u", count, (0.1, 0.05, 1), degree=degree, spans=(2, 2, 1))
    result = solved(lower, upper, (*SIDES[:2], "upper/joints"), swap=swap, penalty=penalty)
    assert largest_stress_error(result, UNIFORM) < 10 * TOLERANCE


def test_a_bent_body_of_several_patches_moves_as_the_one_they_were_cut_from():
    whole = bent_patch(5, (2, 2, 2), (3, 2, 2), name="body")
    whole = with_joint(whole, 0, 1 / 3)
    first, second = halves(whole, 0, 1 / 3)
    tables = {
        "solve": {
            "material": [{"young": 10.0, "poisson": 0.3}],
            "support": [{"on": "body/left", "ux": 0.0, "uy": 0.0, "uz": 0.0}],
            "load": [{"on": "body/right", "traction": [0.0, 0.1, -0.2]}],
        }
    }
    parts = {first.name: first, second.name: turned_round(second, (1, 2, 0), (0, 1))}
    joint = glued_model({"body": tuple(parts.values())})
    ends = {"body/left": (Face("first", 0, 0),), "body/right": (Face("second", 2, 1),)}
    found = converged(Model(parts, {"body": tuple(parts)}, ends, joint.glued), tables)
    expected = converged(model_of(whole), tables)
    xi = np.random.default_rng(0).random((50, 3))
    np.testing.assert_allclose(
        displacement_at(found, "first", xi), displacement_at(expected, "body", xi / [3, 1, 1]), rtol=0, atol=1e-12
    )
    assert found.statistics["strain_energy"] == pytest.approx(expected.statistics["strain_energy"], rel=1e-11)
