from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from geom2iga.bspline import greville, open_knots
from geom2iga.patch import Face, Patch, evaluate, surface
from geom2iga.projection import closest_on, closest_points
from tests.benchmarks.closest_points import (
    SURFACES,
    brute_force,
    cylinder,
    graph,
    points_around,
    single_start,
    sphere_cap,
)
from tests.cases import bent_patch, block_patch, hollow_cylinder
from tests.strategies import SEEDS, rotations


def wavy_surface(seed, degree=2, spans=3, height=0.05):
    """A graph over the unit square with random heights of its control points and uneven weights."""
    random = np.random.default_rng(seed)
    knots = open_knots(np.linspace(0, 1, spans + 1), degree)
    at = greville(knots, degree)
    x, y = np.meshgrid(at, at, indexing="ij")
    points = np.stack([x, y, height * random.uniform(-1, 1, x.shape)], axis=-1)
    return Patch("wavy", (degree, degree), (knots, knots), points, random.uniform(0.8, 1.25, x.shape))


def distances_by_search(patch, points, count=200):
    """Distances to the nearest of a fine grid of surface points: never below the true ones."""
    axis = np.linspace(0, 1, count)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    on_surface = evaluate(patch, grid)[0]
    return np.array([np.linalg.norm(on_surface - point, axis=1).min() for point in points])


def bottom(patch):
    return surface(patch, Face(patch.name, 2, 0))


@given(rotations(), SEEDS)
def test_the_foot_on_a_plane_lies_straight_below(turn, seed):
    random = np.random.default_rng(seed)
    patch = bottom(block_patch(size=(3, 2, 1), degree=2, spans=(3, 2, 1), turn=turn))
    flat, height = random.random((20, 2)) * [3, 2], random.normal(size=20)
    points = turn.apply(np.column_stack([flat, height]))
    foot = closest_points(patch, points)
    np.testing.assert_allclose(foot.xi, flat / [3, 2], rtol=0, atol=1e-12)
    np.testing.assert_allclose(foot.points, turn.apply(np.column_stack([flat, np.zeros(20)])), rtol=0, atol=1e-12)
    assert foot.inside.all()


@given(SEEDS, st.floats(0.3, 3), st.sampled_from([0, 1]))
def test_the_foot_on_a_rational_cylinder_lies_on_the_ray_from_the_axis(seed, stretch, side):
    random = np.random.default_rng(seed)
    patch = surface(hollow_cylinder(inner=1.0, outer=2.0, height=3.0), Face("ring", 0, side))
    angle, height = random.uniform(0, np.pi / 2, 20), random.uniform(0, 3, 20)
    ray = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(20)])
    on_surface = (1 + side) * ray + height[:, None] * [0, 0, 1]
    foot = closest_points(patch, on_surface + (1 + side) * (stretch - 1) * ray)
    np.testing.assert_allclose(foot.points, on_surface, rtol=0, atol=1e-10)
    assert foot.inside.all()


def test_the_foot_on_an_octant_of_a_sphere_lies_on_the_ray_from_the_centre():
    """The octant is a surface of revolution of a quarter circle, with one edge shrunk to the pole."""
    half = 0.5**0.5
    arc = np.array([[1.0, 0, 0], [1, 0, 1], [0, 0, 1]])
    around = np.array([[1.0, 0, 0], [1, 1, 0], [0, 1, 0]])
    points = np.array([[p[0] * q + [0, 0, p[2]] for q in around] for p in arc])
    weights = np.outer([1, half, 1], [1, half, 1])
    knots = open_knots([0, 1], 2)
    sphere = Patch("sphere", (2, 2), (knots, knots), points, weights)
    directions = np.random.default_rng(0).uniform(0.1, 1, (50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for radius in (0.5, 0.99, 1.0, 1.2, 4.0):
        foot = closest_points(sphere, radius * directions)
        np.testing.assert_allclose(foot.points, directions, rtol=0, atol=1e-9)
        assert foot.inside.all()


@given(seed=SEEDS, degree=st.integers(2, 4))
@example(seed=139, degree=4)  # one point lies beyond a border whose bend would send Newton's method back and forth
def test_no_point_of_a_smooth_surface_nearby_is_closer_than_the_foot(seed, degree):
    random = np.random.default_rng(seed)
    patch = wavy_surface(seed, degree)
    points = evaluate(patch, random.random((15, 2)))[0] + random.uniform(-0.07, 0.07, (15, 3))
    foot = closest_points(patch, points)
    found = np.linalg.norm(foot.points - points, axis=1)
    assert np.all(found <= distances_by_search(patch, points) + 1e-12)


def test_a_point_beyond_the_centre_of_curvature_finds_its_foot_on_the_nearer_flank():
    """A valley z = 10 x², whose floor is farther from the points than its flanks."""
    knots = open_knots([0, 1], 2)
    points = np.array([[[x, y, z] for y in (0.0, 0.5, 1.0)] for x, z in ((-1, 10.0), (0, -10.0), (1, 10.0))])
    valley = Patch("valley", (2, 2), (knots, knots), points)
    above = np.array([[0.02, 0.3, 1.0], [-0.05, 0.6, 0.8], [0.1, 0.5, 2.0]])
    foot = closest_points(valley, above)
    assert foot.inside.all()
    assert np.all(foot.points[:, 0] * above[:, 0] > 0)
    assert np.all(np.linalg.norm(foot.points - above, axis=1) <= distances_by_search(valley, above))


@given(SEEDS, st.integers(1, 3))
def test_points_of_the_surface_are_their_own_feet(seed, degree):
    patch = wavy_surface(seed, degree)
    xi = np.random.default_rng(seed).random((20, 2))
    points = evaluate(patch, xi)[0]
    foot = closest_points(patch, points)
    np.testing.assert_allclose(foot.xi, xi, rtol=0, atol=1e-10)
    np.testing.assert_allclose(foot.points, points, rtol=0, atol=1e-12)
    assert foot.inside.all()


@given(SEEDS)
def test_inside_means_that_the_connecting_line_is_normal_to_the_surface(seed):
    random = np.random.default_rng(seed)
    patch = wavy_surface(seed)
    points = random.uniform([-0.5, -0.5, -0.3], [1.5, 1.5, 0.3], (30, 3))
    foot = closest_points(patch, points)
    feet, tangents = evaluate(patch, foot.xi, 1)
    np.testing.assert_allclose(foot.points, feet, rtol=0, atol=0)
    slope = np.abs(np.einsum("qk,qkd->qd", feet - points, tangents)).max(axis=1)
    assert np.all(slope[foot.inside] < 1e-8)
    assert np.all(slope[~foot.inside] > 1e-9)
    on_border = np.any((foot.xi == 0) | (foot.xi == 1), axis=1)
    assert np.all(on_border[~foot.inside])


def test_points_beyond_the_border_have_the_nearest_border_point_as_foot_and_are_not_inside():
    patch = bottom(block_patch(size=(2, 1, 1), degree=2, spans=(2, 2, 1)))
    points = np.array([[3.0, 0.5, 0.2], [-1, 0.25, 0], [1, 1.5, -0.3], [2.5, -0.5, 0.1]])
    foot = closest_points(patch, points)
    np.testing.assert_allclose(foot.points, [[2, 0.5, 0], [0, 0.25, 0], [1, 1, 0], [2, 0, 0]], rtol=0, atol=1e-12)
    assert not foot.inside.any()


def test_points_straight_above_the_border_are_inside():
    patch = bottom(block_patch())
    above = np.array([[0.0, 0.3, 0.5], [1, 1, 0.2], [0.7, 0, 1]])
    assert closest_points(patch, above).inside.all()


def test_a_start_on_the_right_span_gives_the_same_foot():
    patch = surface(bent_patch(5, spans=(2, 2, 1)), Face("bent", 2, 1))
    xi = np.random.default_rng(0).random((20, 2))
    points = evaluate(patch, xi)[0]
    start = np.where(xi < 0.5, 0.25, 0.75)
    np.testing.assert_allclose(closest_points(patch, points, start).xi, xi, rtol=0, atol=1e-10)


def test_no_points_have_no_feet():
    assert closest_points(wavy_surface(0), np.empty((0, 3))).xi.shape == (0, 2)
    assert closest_on([wavy_surface(0), sphere_cap()], np.empty((0, 3)))[0].shape == (0,)


def distances(patch, points):
    return np.linalg.norm(closest_points(patch, points).points - points, axis=1)


@pytest.mark.parametrize("make", SURFACES)
def test_no_point_of_a_curved_face_is_closer_than_the_foot(make):
    patch = make()
    points = points_around(patch, 1500)
    assert np.all(distances(patch, points) <= brute_force(patch, points, samples=150, zooms=12) + 1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("make", SURFACES)
def test_no_point_of_a_curved_face_is_closer_than_any_of_very_many_feet(make):
    patch = make()
    points = points_around(patch, 100_000)
    assert np.all(distances(patch, points) <= brute_force(patch, points) + 1e-10)


def test_the_closest_of_several_minima_is_found_where_the_nearest_sample_leads_to_another():
    patch = cylinder(3)
    points = points_around(patch, 3000)
    found = distances(patch, points)
    assert np.any(single_start(patch, points) > found + 1e-3)
    assert np.all(found <= brute_force(patch, points, samples=150, zooms=12) + 1e-10)


def test_a_closed_cylinder_has_its_feet_on_rays_from_the_axis_on_both_sides_of_the_seam():
    patch = cylinder()
    angle = np.concatenate([np.linspace(-1e-3, 1e-3, 21), np.linspace(0, 2 * np.pi, 50)])
    ray = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
    height = np.array([0, 0, 0.3])
    for radius in (0.01, 0.9, 1.0, 7.0):
        foot = closest_points(patch, radius * ray + height)
        np.testing.assert_allclose(foot.points, ray + height, rtol=0, atol=1e-12)
        assert foot.inside.all()


def full_sphere():
    """The unit sphere, of a half circle turned about z; both its poles are edges shrunk to a point."""
    half = 0.5**0.5
    meridian = [(0.0, -1.0), (1, -1), (1, 0), (1, 1), (0, 1)]
    around = cylinder()
    points = [[[r * x, r * y, z] for x, y, _ in around.control_points[:, 0]] for r, z in meridian]
    knots = np.array([0.0, 0, 0, 1, 1, 2, 2, 2])
    weights = np.outer([1, half, 1, half, 1], around.weights[:, 0])
    return Patch("sphere", (2, 2), (knots, around.knots[0]), points, weights)


def test_points_around_a_sphere_are_as_far_from_it_as_their_radius_tells_poles_included():
    random = np.random.default_rng(0)
    radius = random.uniform(0.05, 3, 300)
    points = random.normal(size=(300, 3))
    points *= (radius / np.linalg.norm(points, axis=1))[:, None]
    points[:4] = [[0, 0, 2], [0, 0, -2], [0, 0, 0.5], [1e-9, 0, -0.5]]
    foot = closest_points(full_sphere(), points)
    expected = np.abs(np.linalg.norm(points, axis=1) - 1)
    np.testing.assert_allclose(np.linalg.norm(foot.points - points, axis=1), expected, rtol=0, atol=1e-14)
    assert foot.inside.all()


def test_all_points_of_a_sphere_cap_are_equally_near_its_centre():
    foot = closest_points(sphere_cap(), np.zeros((1, 3)))
    np.testing.assert_allclose(np.linalg.norm(foot.points, axis=1), 1, rtol=0, atol=1e-15)
    assert foot.inside.all()


@pytest.mark.parametrize(("degree", "spans"), [(1, 5), (2, 3), (3, 2)])
def test_no_point_of_a_kinked_face_is_closer_than_the_foot(degree, spans):
    """Every knot stands as often as the degree, so that the surface has an edge there."""
    random = np.random.default_rng(degree)
    knots = np.concatenate([[0], np.repeat(np.linspace(0, 1, spans + 1), degree), [1]])
    at = greville(knots, degree)
    x, y = np.meshgrid(at, at, indexing="ij")
    points = np.stack([x, y, random.uniform(-0.3, 0.3, x.shape)], axis=-1)
    patch = Patch("kinked", (degree, degree), (knots, knots), points, random.uniform(0.5, 2, x.shape))
    around = random.uniform([-0.5, -0.5, -0.8], [1.5, 1.5, 0.8], (300, 3))
    assert np.all(distances(patch, around) <= brute_force(patch, around, samples=150, zooms=13) + 1e-10)


@pytest.mark.parametrize("make", SURFACES)
def test_far_points_points_of_the_surface_and_points_at_any_scale_are_projected_as_exactly(make):
    patch = make()
    random = np.random.default_rng(0)
    far = random.normal(size=(50, 3))
    far *= 2e3 / np.linalg.norm(far, axis=1)[:, None]
    assert np.all(distances(patch, far) <= brute_force(patch, far, samples=150, zooms=14) + 1e-10)
    xi = np.stack([random.uniform(at[0], at[-1], 100) for at in patch.breaks], axis=1)
    assert distances(patch, evaluate(patch, xi)[0]).max() < 1e-14
    points = points_around(patch, 100)
    for scale in (1e-3, 1e4):
        scaled = replace(patch, control_points=scale * patch.control_points)
        np.testing.assert_allclose(distances(scaled, scale * points), scale * distances(patch, points), rtol=1e-12)


def test_degrees_may_differ_between_the_directions_of_a_rational_face():
    patch = surface(bent_patch(3, degrees=(4, 1, 3), spans=(2, 2, 2)), Face("bent", 2, 1))
    points = points_around(patch, 500)
    assert np.all(distances(patch, points) <= brute_force(patch, points, samples=150, zooms=13) + 1e-10)


def test_the_closest_of_several_faces_is_the_closest_of_the_feet_on_each():
    patches = [make() for make in SURFACES]
    patches = [replace(p, control_points=p.control_points + np.array([2.0 * k, 0, 0])) for k, p in enumerate(patches)]
    points = np.random.default_rng(0).uniform([-2, -2, -2], [8, 2, 2], (500, 3))
    which, foot = closest_on(patches, points)
    each = np.array([distances(patch, points) for patch in patches])
    found = np.linalg.norm(foot.points - points, axis=1)
    np.testing.assert_allclose(found, each.min(axis=0), rtol=0, atol=1e-14)
    np.testing.assert_allclose(found, each[which, np.arange(len(points))], rtol=0, atol=1e-14)


def test_points_over_the_middle_of_a_valley_find_the_lower_of_two_flanks_however_close():
    """Near the centre of curvature of the floor, two minima lie in one small piece of the surface."""
    patch = graph("valley", lambda x, y: 0.5 * x * x, 2, 8)
    random = np.random.default_rng(0)
    points = random.uniform([-1e-3, -0.5, 0.9], [1e-3, 0.5, 1.1], (1000, 3))
    assert np.all(distances(patch, points) <= brute_force(patch, points, samples=250, zooms=12) + 1e-10)
