import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from solve.contact.polygons import triangle_points, triangulate
from tests.strategies import SEEDS, convex_polygons


def moment(corners, i, j):
    """Exact integral of x^i y^j over a polygon: a line integral of its primitive in x around the boundary."""
    nodes, weights = np.polynomial.legendre.leggauss(i + j + 2)
    total = 0.0
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        x, y = (start[:, None] + (end - start)[:, None] * (1 + nodes) / 2)[:2]
        total += weights @ (x ** (i + 1) / (i + 1) * y**j) * (end - start)[1] / 2
    return total


@given(convex_polygons(), st.integers(1, 6), st.data())
def test_the_rule_on_a_convex_polygon_is_exact_for_its_degree(corners, count, data):
    i = data.draw(st.integers(0, 2 * count - 1))
    j = data.draw(st.integers(0, 2 * count - 1 - i))
    triangles, _ = triangulate(np.array([shapely.Polygon(corners)]))
    points, weights = triangle_points(triangles, count)
    scale = shapely.Polygon(corners).area * max(1.0, np.abs(corners).max()) ** (i + j)
    assert weights @ (points[:, 0] ** i * points[:, 1] ** j) == pytest.approx(moment(corners, i, j), abs=1e-12 * scale)


def test_the_rule_is_not_exact_beyond_its_degree():
    triangle = np.array([[0.0, 0], [1, 0], [0, 1]])
    points, weights = triangle_points(triangle[None], 2)
    assert abs(weights @ points[:, 1] ** 4 - moment(triangle, 0, 4)) > 1e-5


@given(st.lists(convex_polygons(), min_size=1, max_size=4), st.integers(1, 4))
def test_weights_are_positive_points_inside_and_areas_add_up_polygon_by_polygon(corners, count):
    polygons = shapely.polygons([shapely.linearrings(ring) for ring in corners])
    triangles, owner = triangulate(polygons)
    points, weights = triangle_points(triangles, count)
    of_point = np.repeat(owner, count**2)
    assert np.all(weights > 0)
    assert np.all(shapely.distance(polygons[of_point], shapely.points(points)) < 1e-14)
    np.testing.assert_allclose(np.bincount(of_point, weights), shapely.area(polygons), rtol=1e-12)


@given(convex_polygons(), convex_polygons(), SEEDS)
def test_what_is_no_polygon_has_no_triangles(first, second, seed):
    nothing = [shapely.Polygon(), shapely.Point(1, 2), shapely.LineString([[0, 0], [1, 1]])]
    shapes = np.array([*nothing, shapely.Polygon(first), shapely.Polygon(second)])
    order = np.random.default_rng(seed).permutation(len(shapes))
    triangles, owner = triangulate(shapes[order])
    assert len(triangles) == len(first) + len(second) - 4
    assert set(order[owner]) == {3, 4}


def test_nothing_at_all_has_no_triangles():
    triangles, owner = triangulate(np.array([shapely.Point(0, 0)]))
    assert triangles.shape == (0, 3, 2)
    assert owner.shape == (0,)
    points, weights = triangle_points(triangles, 3)
    assert points.shape == (0, 2)
    assert weights.shape == (0,)
