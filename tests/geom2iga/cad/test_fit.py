import numpy as np
import pytest

from geom2iga.bspline import open_knots
from geom2iga.cad.fit import SPANS, fit, within
from geom2iga.spline import Spline, points_of

LINE = open_knots([0, 1], 1)
CORNERS = np.array([[[0.0, 0, 0, 1], [0, 1, 0, 1]], [[1, 0, 0, 1], [1, 1, 0, 1]]])
FLAT = Spline((1, 1), (LINE, LINE), CORNERS)


def onto(height):
    """Move points up or down to the surface z = height(x, y)."""
    return lambda points: np.column_stack([points[:, :2], height(points[:, 0], points[:, 1])])


def bubble(x, y):
    """Zero along the edges of the unit square."""
    return np.sin(np.pi * x) * np.sin(np.pi * y) / 5


def distance(spline, nearest):
    points = points_of(spline.at(*[np.linspace(0, 1, 101)] * 2)).reshape(-1, 3)
    return np.linalg.norm(nearest(points) - points, axis=1).max()


def test_a_surface_within_the_space_of_the_fit_is_reached_to_rounding():
    nearest = onto(lambda x, y: x * (1 - x) * y * (1 - y) * (1 + x))
    fitted = fit(FLAT, nearest, 1e-6)
    assert fitted.degrees == (3, 3)
    assert distance(fitted, nearest) < 1e-15 * 10


@pytest.mark.parametrize("accuracy", [1e-3, 1e-5])
def test_as_many_spans_are_taken_as_the_accuracy_needs(accuracy):
    fitted = fit(FLAT, onto(bubble), accuracy)
    assert distance(fitted, onto(bubble)) < 1.1 * accuracy
    fewer = {1e-3: SPANS[0], 1e-5: SPANS[2]}[accuracy]
    assert fitted.coefficients.shape == (fewer + 3, fewer + 3, 4)


def test_edges_and_weights_stay_as_they_are():
    weights = np.array([[1.0, 2], [0.5, 1]])[..., None]
    start = Spline((1, 1), (LINE, LINE), np.concatenate([CORNERS[..., :3] * weights, weights], axis=-1))
    fitted = fit(start, onto(bubble), 1e-6)
    at = np.linspace(0, 1, 21)
    np.testing.assert_allclose(fitted.at(at, at)[..., 3], start.at(at, at)[..., 3], rtol=1e-14)
    for axis in range(2):
        for side in range(2):
            expected = start.end(axis, side).at(at)
            np.testing.assert_allclose(fitted.end(axis, side).at(at), expected, rtol=0, atol=1e-15 * 4)
    assert distance(fitted, onto(bubble)) < 1e-5


def test_no_spans_are_spent_where_the_edges_lie_off():
    """The edges stay at z = 0, the surface does not come there."""
    fitted = fit(FLAT, onto(lambda x, y: 0.1 + bubble(x, y)), 1e-6)
    assert fitted.coefficients.shape[0] == SPANS[0] + 3


def test_samples_lie_in_all_spans_and_on_their_ends():
    knots = open_knots([0, 0.25, 1], 2)
    at = within(knots)
    assert {0, 0.25, 1} <= set(at.tolist())
    for low, high in ((0, 0.25), (0.25, 1)):
        assert np.count_nonzero((at > low) & (at < high)) == 4
