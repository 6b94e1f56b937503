import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

from solve.contact.polygons import clip, triangle_points, triangulate
from tests.strategies import SEEDS, convex_polygons

SQUARE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def split(corners):
    """Triangles of one polygon (n, 2)."""
    return triangulate(corners[None], np.array([len(corners)]))[0]


def padded(polygons):
    """Polygons of different numbers of corners as one array, filled up with nonsense, and those numbers."""
    counts = np.array([len(corners) for corners in polygons])
    filled = np.full((len(polygons), counts.max(), 2), 1e3)
    for row, corners in zip(filled, polygons, strict=True):
        row[: len(corners)] = corners
    return filled, counts


def moment(corners, i, j):
    """Exact integral of x^i y^j over a polygon: a line integral of its primitive in x around the boundary."""
    nodes, weights = np.polynomial.legendre.leggauss(i + j + 2)
    total = 0.0
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        x, y = start[:, None] + (end - start)[:, None] * (1 + nodes) / 2
        total += weights @ (x ** (i + 1) / (i + 1) * y**j) * (end - start)[1] / 2
    return total


@given(convex_polygons(), st.integers(1, 6), st.data())
def test_the_rule_on_a_convex_polygon_is_exact_for_its_degree(corners, count, data):
    i = data.draw(st.integers(0, 2 * count - 1))
    j = data.draw(st.integers(0, 2 * count - 1 - i))
    points, weights = triangle_points(split(corners), count)
    scale = shapely.Polygon(corners).area * max(1.0, np.abs(corners).max()) ** (i + j)
    assert weights @ (points[:, 0] ** i * points[:, 1] ** j) == pytest.approx(moment(corners, i, j), abs=1e-12 * scale)


def test_the_rule_is_not_exact_beyond_its_degree():
    triangle = np.array([[0.0, 0], [1, 0], [0, 1]])
    points, weights = triangle_points(triangle[None], 2)
    assert abs(weights @ points[:, 1] ** 4 - moment(triangle, 0, 4)) > 1e-5


@given(st.lists(convex_polygons(), min_size=1, max_size=4), st.integers(1, 4))
def test_weights_are_positive_points_inside_and_areas_add_up_polygon_by_polygon(polygons, count):
    triangles, owner = triangulate(*padded(polygons))
    points, weights = triangle_points(triangles, count)
    of_point = np.repeat(owner, count**2)
    shapes = np.array([shapely.Polygon(corners) for corners in polygons])
    assert np.all(weights > 0)
    assert np.all(shapely.distance(shapes[of_point], shapely.points(points)) < 1e-14)
    np.testing.assert_allclose(np.bincount(of_point, weights), shapely.area(shapes), rtol=1e-12)


@given(convex_polygons(), convex_polygons())
def test_what_has_less_than_three_corners_or_no_area_has_no_triangles(first, second):
    line = np.array([[0.0, 0], [1, 1], [2, 2]])
    triangles, owner = triangulate(*padded([np.empty((0, 2)), first, line[:1], line[:2], line, second]))
    assert len(triangles) == len(first) + len(second) - 4
    assert set(owner) == {1, 5}


@given(convex_polygons(), convex_polygons(), st.booleans(), st.booleans())
def test_a_clipped_polygon_is_the_intersection_whichever_way_round_either_runs(polygon, window, back, forth):
    polygon, window = polygon[:: -1 if back else 1], window[:: -1 if forth else 1]
    corners, counts = clip(polygon[None], window[None])
    expected = shapely.Polygon(polygon).intersection(shapely.Polygon(window))
    triangles, _ = triangulate(corners, counts)
    points, weights = triangle_points(triangles, 3)
    assert weights.sum() == pytest.approx(expected.area, rel=1e-9, abs=1e-12)
    assert np.all(shapely.distance(shapely.Polygon(polygon), shapely.points(points)) < 1e-12)
    assert np.all(shapely.distance(shapely.Polygon(window), shapely.points(points)) < 1e-12)


@given(SEEDS, st.floats(-1, 1), st.floats(-1, 1), st.sampled_from([1e-17, 1e-16, 1e-14, 1e-8]))
@example(0, 0.0, 0.0, 1e-17)
@example(0, 0.5, 0.0, 1e-16)
def test_edges_that_coincide_but_for_rounding_cost_no_area(seed, right, up, noise):
    """As those of bodies whose knot lines meet; general overlays have been seen to fail there, or to lose the cell."""
    random = np.random.default_rng(seed)
    moves = np.array([[right, up], [right, 0], [0, up], [0, 0]])
    windows = SQUARE + moves[:, None] + noise * random.uniform(-1, 1, (4, 4, 2))
    turns = random.permutation(4)
    polygons = np.stack([np.roll(SQUARE, turn, axis=0) for turn in turns]) + noise * random.uniform(-1, 1, (4, 4, 2))
    triangles, owner = triangulate(*clip(polygons, windows))
    found = np.bincount(owner, triangle_points(triangles, 1)[1], 4)
    np.testing.assert_allclose(found, np.prod(1 - np.abs(moves), axis=1), rtol=0, atol=1e-15 + 20 * noise)


def test_pairs_are_clipped_each_on_its_own():
    random = np.random.default_rng(0)
    polygons, windows = random.uniform(-0.8, 0.8, (2, 30, 1, 2)) + SQUARE
    polygons[0], windows[0] = SQUARE, SQUARE + 5
    together = clip(polygons, windows)
    for number in range(30):
        corners, counts = clip(polygons[number : number + 1], windows[number : number + 1])
        assert counts[0] == together[1][number]
        np.testing.assert_array_equal(corners[0, : counts[0]], together[0][number, : counts[0]])


@pytest.mark.parametrize("move", [(5, 5), (1, 0), (1, 1)], ids=["far", "at an edge", "at a corner"])
def test_what_does_not_overlap_leaves_no_triangles(move):
    triangles, owner = triangulate(*clip(SQUARE[None], SQUARE[None] + move))
    assert triangles.shape == (0, 3, 2)
    assert owner.shape == (0,)


def test_nothing_at_all_is_clipped_to_nothing():
    triangles, owner = triangulate(*clip(np.empty((0, 4, 2)), np.empty((0, 4, 2))))
    assert triangles.shape == (0, 3, 2)
    assert owner.shape == (0,)
    points, weights = triangle_points(triangles, 3)
    assert points.shape == (0, 2)
    assert weights.shape == (0,)
