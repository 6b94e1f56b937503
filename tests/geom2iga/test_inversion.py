import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geom2iga.errors import CaseError
from geom2iga.inversion import find_in_model, locate
from geom2iga.patch import Patch, evaluate, refined
from geom2iga.shapes.primitives import hemisphere, pipe, sphere
from tests.cases import bent_patch, block_patch, hollow_cylinder, model_of, sample_points
from tests.strategies import SEEDS, bent_patches, rotations
from tests.verification.glued_bodies import glued_model, wall

SHAPES = {
    "block": block_patch(degree=(1, 2, 3), spans=(3, 1, 2), size=(4, 2, 0.1)),
    "quarter of a pipe": hollow_cylinder(),
    **{f"pipe {n}": patch for n, patch in enumerate(pipe("pipe", 1.0, 3.0, 2.0).patches)},
    **{f"ball {n}": patch for n, patch in enumerate(sphere("ball", 2.0).patches)},
    **{f"dome {n}": patch for n, patch in enumerate(hemisphere("dome", 1.0).patches)},
}


def assert_found(patch, xi, tolerance=1e-10):
    found, back = locate(patch, evaluate(patch, xi)[0])
    assert found.all()
    np.testing.assert_allclose(back, xi, rtol=0, atol=tolerance)


def random_xi(patch, seed, count=40):
    return np.stack([np.random.default_rng(seed).uniform(at[0], at[-1], count) for at in patch.breaks], axis=1)


@pytest.mark.parametrize("name", SHAPES)
def test_points_of_a_shape_come_back_to_where_they_were(name):
    patch = SHAPES[name]
    assert_found(patch, random_xi(patch, 0))


@given(bent_patches(), SEEDS)
def test_points_of_a_free_form_come_back_to_where_they_were(patch, seed):
    assert_found(patch, np.concatenate([random_xi(patch, seed), sample_points(patch, seed=seed)]))


@given(st.sampled_from(sorted(SHAPES)), SEEDS)
def test_every_point_of_the_border_lies_inside_even_a_little_off(name, seed):
    patch, random = SHAPES[name], np.random.default_rng(seed)
    xi = random_xi(patch, seed, 20)
    axis, side = random.integers(3), random.integers(2)
    xi[:, axis] = patch.breaks[axis][-side]
    size = np.ptp(patch.control_points.reshape(-1, 3), axis=0).max()
    direction = random.normal(size=(20, 3))
    points = evaluate(patch, xi)[0] + 0.9e-9 * size * direction / np.linalg.norm(direction, axis=1)[:, None]
    found, back = locate(patch, points)
    assert found.all()
    assert np.linalg.norm(evaluate(patch, back)[0] - points, axis=1).max() < 1e-9 * size


@given(st.sampled_from(sorted(SHAPES)), SEEDS)
def test_no_point_outside_is_found_however_near(name, seed):
    """A face's points moved along its outward normal, or the mirror images of all through it."""
    patch, random = SHAPES[name], np.random.default_rng(seed)
    xi = random_xi(patch, seed, 20)
    axis, side = random.integers(3), random.integers(2)
    xi[:, axis] = patch.breaks[axis][-side]
    points, jacobian = evaluate(patch, xi, 1)
    outward = np.linalg.inv(jacobian)[:, axis] * (2 * side - 1)
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    size = np.ptp(patch.control_points.reshape(-1, 3), axis=0).max()
    away = size * 10.0 ** random.uniform(-8.5, -3.5, (20, 1))
    assert not locate(patch, points + away * outward)[0].any()
    found, back = locate(patch, points - away * outward)
    assert found.all()
    assert np.all(back[:, axis] != xi[:, axis])


@given(rotations(), SEEDS)
def test_what_a_box_tells_of_its_own_points_is_told_of_a_turned_one(turn, seed):
    points = np.random.default_rng(seed).uniform(-0.2, 1.2, (200, 3))
    found, xi = locate(block_patch(degree=2, spans=(2, 1, 3), turn=turn), turn.apply(points))
    np.testing.assert_array_equal(found, ((points >= 0) & (points <= 1)).all(axis=1))
    np.testing.assert_allclose(xi[found], points[found], rtol=0, atol=1e-12)
    assert np.isnan(xi[~found]).all()


def test_points_at_a_collapsed_edge_are_found():
    """A wedge whose edge at the origin is a whole face."""
    wedge = block_patch(degree=(1, 2, 1))
    points = wedge.control_points.copy()
    points[..., 1] *= points[..., 0]
    collapsed = Patch("wedge", wedge.degrees, wedge.knots, points)
    xi = random_xi(collapsed, 0)
    xi[:10, 0] = 0.0
    at = evaluate(collapsed, xi)[0]
    found, back = locate(collapsed, at)
    assert found.all()
    np.testing.assert_allclose(evaluate(collapsed, back)[0], at, rtol=0, atol=1e-12)
    np.testing.assert_allclose(back[10:], xi[10:], rtol=0, atol=1e-9)


@given(SEEDS, st.integers(1, 2))
def test_points_of_a_body_with_sharp_kinks_are_found(seed, degree):
    """Layers that are sheared to and fro, in the middle and at the kinks."""
    straight = block_patch(degree=(degree, 2, 2))
    straight = refined(straight, knots=[np.repeat([0.2, 0.3, 0.6, 0.9], degree), [], []])
    points, random = straight.control_points.copy(), np.random.default_rng(seed)
    heights = random.uniform(-3, 3, (6, 2))
    shift = [np.interp(points[:, 0, 0, 0], [0, 0.2, 0.3, 0.6, 0.9, 1], heights[:, axis]) for axis in range(2)]
    points[..., 1:] += np.stack(shift, axis=-1)[:, None, None]
    bent = Patch("bent", straight.degrees, straight.knots, points)
    assert_found(bent, np.concatenate([random_xi(bent, seed), sample_points(bent)]))


def test_nothing_is_found_where_nothing_is_asked_or_all_lies_far_away():
    patch = bent_patch(0)
    for points in (np.empty((0, 3)), np.full((3, 3), 50.0)):
        found, xi = locate(patch, points)
        assert not found.any()
        assert xi.shape == points.shape


def test_of_the_patches_that_share_a_point_the_first_is_taken_and_of_one_body_its_own():
    model = model_of(block_patch("lower"), block_patch("upper", (0, 0, 1)))
    points = np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 1.0], [0.5, 0.5, 1.5], [0.5, 0.5, 2.5]])
    numbers, xi = find_in_model(model, points)
    assert numbers.tolist() == [0, 0, 1, -1]
    np.testing.assert_allclose(xi[:3, 2], [0.5, 1.0, 0.5])
    numbers, xi = find_in_model(model, points, "upper")
    assert numbers.tolist() == [-1, 1, 1, -1]
    np.testing.assert_allclose(xi[1:3, 2], [0.0, 0.5])


def test_all_points_of_a_body_of_many_patches_are_found():
    model = glued_model({"wall": wall("w", degree=2, shift=(0.1, -0.1))})
    points = np.random.default_rng(0).random((500, 3))
    numbers, xi = find_in_model(model, points, "wall")
    for number, patch in enumerate(model.patches.values()):
        own = numbers == number
        np.testing.assert_allclose(evaluate(patch, xi[own])[0], points[own], rtol=0, atol=1e-12)
        assert own.any()
    assert (numbers >= 0).all()


def test_an_unknown_body_is_named_with_the_nearest_known():
    with pytest.raises(CaseError, match='no body "lowr"; did you mean "lower"'):
        find_in_model(model_of(block_patch("lower")), np.zeros((1, 3)), "lowr")
