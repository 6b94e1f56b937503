import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geom2iga.errors import GeometryError
from geom2iga.patch import Patch, evaluate
from geom2iga.sphere import closing_angle, find_turns, spherical_patch, turned_arc
from tests.oracles import assert_same_map
from tests.strategies import SEEDS

GRID = np.stack(np.meshgrid(*[np.linspace(0, 1, 17)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
OCTANT = np.array([[1.0, 0, 0], [1, 1, 0], [0, 1, 0]])
CUBE = np.array([[[x, y, 1.0] for y in (-1, 1)] for x in (-1, 1)]) / 3**0.5  # corners of a face of the cube in the ball


def arc(start, end, about):
    """The circular arc of less than 180 degrees about a point."""
    offset = (start + end) / 2 - about
    weight = np.linalg.norm(offset) / np.linalg.norm(start - about)
    return Patch("arc", (2,), ([0, 0, 0, 1, 1, 1],), [start, about + offset / weight**2, end], [1, weight, 1])


def quadrilateral(corners, centre, tilts=(0, 0, 0, 0)):
    """Four arcs on a sphere between corners (2, 2, 3), in planes that hold the centre or pass beside it by `tilts`."""
    pairs = [corners[:, 0], corners[:, 1], corners[0], corners[1]]
    return [
        arc(a, b, centre + tilt * np.cross(a - centre, b - centre)) for (a, b), tilt in zip(pairs, tilts, strict=True)
    ]


def random_quadrilateral(seed):
    """Four arcs of small circles between four points around some place of a sphere, its centre and its radius."""
    random = np.random.default_rng(seed)
    flat = np.array([[[-1.0, -1], [-1, 1]], [[1, -1], [1, 1]]]) * random.uniform(0.2, 0.6, 2)
    flat += 0.1 * random.uniform(-1, 1, flat.shape)
    corners = np.concatenate([flat, np.ones((2, 2, 1))], axis=-1)
    corners /= np.linalg.norm(corners, axis=-1, keepdims=True)
    radius, centre = random.uniform(0.1, 10), random.normal(size=3)
    corners = centre + radius * Rotation.random(random_state=seed).apply(corners.reshape(-1, 3)).reshape(2, 2, 3)
    pairs = [corners[:, 0], corners[:, 1], corners[0], corners[1]]
    edges = []
    for a, b in pairs:
        axis = np.cross(a - centre, b - centre)
        offset = random.uniform(-0.3, 0.3) * radius * axis / np.linalg.norm(axis)
        normal = np.cross(b - a, (a + b) / 2 - centre - offset)
        normal /= np.linalg.norm(normal)
        edges.append(arc(a, b, centre + normal * ((a - centre) @ normal)))
    return edges, centre, radius


def assert_on_sphere(patch, centre, radius):
    distance = np.linalg.norm(evaluate(patch, GRID)[0] - centre, axis=1)
    assert abs(distance - radius).max() <= 4e-15 * (radius + np.linalg.norm(centre))


def outward_area(patch, centre):
    """Smallest component along the radius of the cross product of the tangents, of either sign of orientation."""
    points, slopes = evaluate(patch, GRID, 1)
    outward = np.sum(np.cross(slopes[..., 0], slopes[..., 1]) * (points - centre), axis=1)
    return (outward * np.sign(outward.mean())).min()


@given(SEEDS)
def test_a_patch_lies_on_its_sphere_between_its_arcs_without_a_fold(seed):
    edges, centre, radius = random_quadrilateral(seed)
    patch = spherical_patch(edges, centre, radius)
    assert_on_sphere(patch, centre, radius)
    assert outward_area(patch, centre) > 0
    assert abs(patch.weights[[0, 0, -1, -1], [0, -1, 0, -1]] - 1).max() <= 1e-14
    t = np.linspace(0, 1, 9)[:, None]
    rows = [(t, 0 * t), (t, 0 * t + 1), (0 * t, t), (0 * t + 1, t)]
    for edge, row in zip(edges, rows, strict=True):
        expected = evaluate(edge, t)[0]
        np.testing.assert_allclose(evaluate(patch, np.hstack(row))[0], expected, rtol=0, atol=1e-13 * radius)


@given(SEEDS, st.lists(st.floats(0, 1), min_size=3, max_size=3))
def test_the_edges_carry_the_turns_that_were_asked_for(seed, shares):
    edges, centre, radius = random_quadrilateral(seed)
    angle = closing_angle(edges, centre, radius)
    turns = np.array([*shares, 0]) * angle / 4
    turns[3] = angle - turns.sum()
    patch = spherical_patch(edges, centre, radius, turns)
    rows = patch.homogeneous[:, 0], patch.homogeneous[:, -1], patch.homogeneous[0], patch.homogeneous[-1]
    for edge, turn, row in zip(edges, turns, rows, strict=True):
        expected = turned_arc(edge, turn).homogeneous
        np.testing.assert_allclose(row, expected, rtol=0, atol=1e-13 * abs(expected).max())


@given(SEEDS, st.floats(-3, 3))
def test_a_turned_arc_is_the_same_curve(seed, turn):
    edge = random_quadrilateral(seed)[0][0]
    if np.cos(turn) > -0.1:
        assert_same_map(turned_arc(edge, turn), elevated_to_four(edge))


def elevated_to_four(edge):
    return turned_arc(edge, 0.0)


def test_the_closing_angle_of_great_circles_is_half_the_solid_angle():
    edges = quadrilateral(CUBE, np.zeros(3))
    assert closing_angle(edges, (0, 0, 0), 1) == pytest.approx(4 * np.pi / 6 / 2, abs=1e-14)


@given(SEEDS)
def test_the_closing_angle_is_half_of_what_the_angles_sum_to_beyond_360_degrees(seed):
    edges, centre, radius = random_quadrilateral(seed)
    low, high, first, last = [[edge.control_points[1] - edge.control_points[k] for k in (0, 2)] for edge in edges]
    total = sum(
        np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b))
        for a, b in [(low[0], first[0]), (low[1], last[0]), (high[0], first[1]), (high[1], last[1])]
    )
    assert closing_angle(edges, centre, radius) == pytest.approx(abs(total - 2 * np.pi) / 2, abs=1e-12)


def test_meridians_and_parallels_close_without_turns():
    low, high = np.radians([-20, 50])
    at = [[[np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)] for b in (low, high)] for a in (0.1, 1.2)]
    corners, axis = np.array(at), np.array([0, 0, 1])
    parallels = [arc(corners[0, k], corners[1, k], corners[0, k, 2] * axis) for k in (0, 1)]
    meridians = [arc(*corners[k], np.zeros(3)) for k in (0, 1)]
    assert closing_angle([*parallels, *meridians], (0, 0, 0), 1) <= 1e-15


def test_turns_are_found_for_faces_that_share_edges():
    faces = [("a", "b", "c", "d"), ("d", "e", "f", "g"), ("g", "h", "i", "a")]
    angles = [0.3, 0.1, 0.7]
    turns = find_turns(faces, angles, fixed={"b"})
    np.testing.assert_allclose([sum(turns[e] for e in face) for face in faces], angles, rtol=0, atol=1e-14)
    assert turns["b"] == pytest.approx(0, abs=1e-15)


def test_faces_that_cannot_close_at_once_are_refused():
    with pytest.raises(GeometryError, match="do not close all at once"):
        find_turns([("a", "b", "c", "d"), ("a", "b", "c", "d")], [0.1, 0.2])


def test_turns_that_miss_the_closing_angle_are_refused():
    with pytest.raises(ValueError, match="the closing angle is 1"):
        spherical_patch(quadrilateral(CUBE, np.zeros(3)), (0, 0, 0), 1.0, [0.1] * 4)


def test_edges_off_the_sphere_are_refused():
    edges = quadrilateral(CUBE, np.zeros(3))
    with pytest.raises(GeometryError, match=r'edge "arc" is no circular arc on the sphere of radius 1\.01'):
        spherical_patch(edges, (0, 0, 0), 1.01)


def test_edges_that_do_not_meet_are_refused():
    edges = quadrilateral(CUBE, np.zeros(3))
    with pytest.raises(GeometryError, match="meets its neighbours"):
        spherical_patch([edges[1], edges[0], *edges[2:]], (0, 0, 0), 1.0)


def test_an_edge_of_another_degree_is_refused():
    edges = quadrilateral(CUBE, np.zeros(3))
    with pytest.raises(GeometryError, match="no rational quadratic arc"):
        spherical_patch([turned_arc(edges[0], 0.0), *edges[1:]], (0, 0, 0), 1.0)
