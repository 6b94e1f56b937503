import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

from solve.contact.polygons import (
    CHORD,
    CORNER,
    NONE,
    clip,
    cone_points,
    gauss_line,
    outline_corners,
    packed,
    quad_points,
)
from tests.strategies import SEEDS

SQUARE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def straight(corners):
    """Four-sided outlines (k, 4, 2) of straight lines."""
    return outline_corners(np.asarray(corners, dtype=float), np.zeros((len(corners), 4), dtype=bool))


def clipped(corners, low, high):
    """One outline (4 n, 2) of curves, clipped."""
    outline = outline_corners(np.asarray(corners)[None], np.ones((1, 4), dtype=bool))
    return clip(outline, np.array([low], dtype=float), np.array([high], dtype=float))


@st.composite
def convex_quads(draw):
    """Corners (4, 2) on an ellipse, either way round."""
    random = np.random.default_rng(draw(SEEDS))
    angles = np.sort(random.uniform(0, 0.4 * np.pi, 4) + np.arange(4) * np.pi / 2)
    corners = np.stack([np.cos(angles), np.sin(angles)], axis=1) * random.uniform(0.3, 3, 2) + random.normal(size=2)
    return corners[:: draw(st.sampled_from([1, -1]))]


@given(convex_quads(), SEEDS)
@example(SQUARE, 0)
def test_what_is_left_of_a_polygon_is_its_overlap_with_the_rectangle(corners, seed):
    random = np.random.default_rng(seed)
    low = random.normal(size=2)
    high = low + random.uniform(0.1, 3, 2)
    left = clip(straight(corners[None]), low[None], high[None])
    polygon = shapely.Polygon(corners)
    expected = polygon.intersection(shapely.box(*low, *high)).area
    sign = 1 if polygon.exterior.is_ccw else -1
    assert sign * left.area[0] == pytest.approx(expected, abs=1e-13)
    at = left.at[0, : left.counts[0]]
    assert np.all((at >= low) & (at <= high))


@pytest.mark.parametrize("move", [(5, 5), (1, 0), (1, 1)], ids=["far", "at an edge", "at a corner"])
def test_what_does_not_overlap_leaves_no_area(move):
    left = clip(straight([SQUARE + move]), np.zeros((1, 2)), np.ones((1, 2)))
    assert left.area.tolist() == [0]


def test_nothing_at_all_is_clipped_to_nothing():
    left = clip(straight(np.empty((0, 4, 2))), np.empty((0, 2)), np.empty((0, 2)))
    assert left.area.shape == (0,)


def test_pairs_are_clipped_each_on_its_own():
    random = np.random.default_rng(0)
    polygons = SQUARE + random.uniform(-0.8, 0.8, (30, 1, 2))
    low = random.uniform(-0.8, 0.8, (30, 2))
    together = clip(straight(polygons), low, low + 1)
    for number in range(30):
        alone = clip(straight(polygons[number : number + 1]), low[number : number + 1], low[number : number + 1] + 1)
        count = alone.counts[0]
        assert count == together.counts[number]
        np.testing.assert_array_equal(alone.at[0, :count], together.at[number, :count])


def test_corners_know_which_curve_arrives_and_leaves_and_which_line_they_lie_on():
    """A square of two chords a side, cut through the middles of its lower and upper chords' first halves."""
    corners = np.stack([SQUARE, (SQUARE + np.roll(SQUARE, -1, axis=0)) / 2], axis=1).reshape(8, 2)
    left = clipped(corners, (0.25, -1), (2, 2))
    found = {tuple(at): number for number, at in enumerate(left.at[0].tolist())}
    entry, leave = found[0.25, 0.0], found[0.25, 1.0]
    assert (left.arrives[0, entry], left.leaves[0, entry], left.mark[0, entry]) == (NONE, 0.25, 0)
    assert (left.arrives[0, leave], left.leaves[0, leave], left.mark[0, leave]) == (2.75, NONE, 0)
    corner, middle = found[1.0, 0.0], found[0.5, 0.0]
    assert (left.arrives[0, corner], left.leaves[0, corner], left.mark[0, corner]) == (1, 1, CORNER)
    assert (left.leaves[0, middle], left.mark[0, middle]) == (0.5, CHORD)


def test_a_polygon_that_comes_back_in_two_parts_has_their_area():
    """A C with its arms across the window's side."""
    corners = [[0, 0], [3, 0], [3, 1], [1, 1], [1, 2], [3, 2], [3, 3], [0, 3]]
    left = clipped(np.array(corners, dtype=float), (2, -1), (4, 4))
    assert left.area[0] == pytest.approx(2)


def test_corners_are_taken_in_turn():
    square = straight([SQUARE])
    kept = np.zeros((1, 4, 2), dtype=bool)
    kept[0, [0, 1, 3], [0, 1, 0]] = True
    both = packed(square, straight([SQUARE + 5]), kept)
    assert both.counts.tolist() == [3]
    np.testing.assert_array_equal(both.at[0, :3], [[0, 0], [6, 5], [0, 1]])


def monomials(points, weights, highest):
    """Integrals of x^a y^b, a + b <= highest."""
    x, y = points[..., 0].ravel(), points[..., 1].ravel()
    return np.array([weights.ravel() @ (x**a * y**b) for a in range(highest + 1) for b in range(highest + 1 - a)])


@pytest.mark.parametrize("count", [2, 3, 5])
@given(convex_quads())
def test_quads_and_their_cones_agree_on_polynomials(count, corners):
    t, weights = gauss_line(count)
    chords = np.roll(corners, -1, axis=0) - corners
    curves = corners[:, None] + t[:, None] * chords[:, None]
    slopes = np.broadcast_to(chords[:, None], curves.shape)
    quad = quad_points(corners[None], curves[None], slopes[None], weights)
    cones = cone_points(np.broadcast_to(corners.mean(axis=0), (4, 2)), curves, slopes, weights)
    fan = np.broadcast_to(corners[0], (4, 2))  # over the two far edges, with more points
    t, finer = gauss_line(count + 2)
    curves = corners[:, None] + t[:, None] * chords[:, None]
    exact = monomials(*cone_points(fan, curves, np.broadcast_to(chords[:, None], curves.shape), finer), 2 * count - 2)
    scale = np.abs(exact).max()
    np.testing.assert_allclose(monomials(*quad, 2 * count - 2), exact, rtol=0, atol=1e-12 * scale)
    np.testing.assert_allclose(monomials(*cones, 2 * count - 2), exact, rtol=0, atol=1e-12 * scale)


def circle(count):
    """Four quarters of the unit circle: begins (4, 2), points and derivatives (4, count, 2), weights."""
    t, weights = gauss_line(count)
    angles = (np.arange(4)[:, None] + t) * np.pi / 2
    around = np.stack([np.cos(angles), np.sin(angles)], axis=2)
    ahead = np.stack([-np.sin(angles), np.cos(angles)], axis=2) * np.pi / 2
    return np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]]), around, ahead, weights


def test_curved_edges_are_followed_exactly():
    begins, around, ahead, weights = circle(16)
    for points, areas in (
        quad_points(begins[None], around[None], ahead[None], weights),
        cone_points(np.full((4, 2), 0.3), around, ahead, weights),
    ):
        assert areas.sum() == pytest.approx(np.pi, rel=1e-14)
        assert np.sum(areas * points[..., 0] ** 2) == pytest.approx(np.pi / 4, rel=1e-13)


def test_a_cone_behind_its_curve_counts_negative():
    _, around, ahead, weights = circle(12)
    areas = cone_points(np.full((4, 2), 3.0), around, ahead, weights)[1]
    assert areas.min() < 0
    assert areas.sum() == pytest.approx(np.pi, rel=1e-12)
