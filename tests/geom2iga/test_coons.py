import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geom2iga.bspline import open_knots
from geom2iga.coons import coons
from geom2iga.patch import evaluate
from geom2iga.spline import Spline, adapted, points_of, united
from tests.cases import hollow_cylinder
from tests.geom2iga.test_spline import splines
from tests.strategies import SEEDS

XI = np.linspace(0, 1, 7)
LINE = (1, open_knots([0, 1], 1))


def sides(spline):
    """The ends of all directions."""
    return [(spline.end(axis, 0), spline.end(axis, 1)) for axis in range(len(spline.degrees))]


def linear_along(spline, axis):
    """A spline that joins the ends of a direction by straight lines."""
    degrees, knots = list(spline.degrees), list(spline.knots)
    degrees[axis], knots[axis] = LINE
    ends = np.take(spline.coefficients, [0, -1], axis=axis)
    return Spline(tuple(degrees), tuple(knots), ends)


def roughened(spline, seed):
    """Each side written in a larger space of its own."""
    random = np.random.default_rng(seed)

    def rough(side):
        more = [(int(random.integers(1, 4)), random.uniform(0.1, 0.9)) for _ in side.degrees]
        extra = [(p, np.concatenate([np.zeros(p + 1), [at], np.ones(p + 1)])) for p, at in more]
        own = zip(side.degrees, side.knots, strict=True)
        return adapted(side, [united([space, other]) for space, other in zip(own, extra, strict=True)])

    return [tuple(rough(side) for side in pair) for pair in sides(spline)]


def gordon_hall(spline, *axes):
    """The Boolean sum of Gordon & Hall (1973), written out for points: faces less edges plus corners."""
    grid = np.meshgrid(*axes, indexing="ij")
    count, total = len(axes), 0.0
    for chosen in np.ndindex(*(3,) * count):  # 0 or 1: at that end of the direction; 2: at the point
        fixed = [axis for axis in range(count) if chosen[axis] < 2]
        if fixed:
            at = [np.full_like(axes[a], float(chosen[a])) if a in fixed else axes[a] for a in range(count)]
            share = np.prod([grid[a] if chosen[a] else 1 - grid[a] for a in fixed], axis=0)
            total = total + (-1) ** (len(fixed) + 1) * share[..., None] * spline.at(*at)
    return total


@pytest.mark.parametrize("directions", [2, 3])
@given(st.data())
def test_every_side_is_kept(directions, data):
    spline = data.draw(splines(directions=directions))
    found = coons(sides(spline))
    for axis in range(directions):
        for side in range(2):
            at = (XI,) * (directions - 1)
            expected = spline.end(axis, side).at(*at)
            np.testing.assert_allclose(found.end(axis, side).at(*at), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("directions", "axis"), [(2, 0), (2, 1), (3, 0), (3, 1), (3, 2)])
@given(st.data())
def test_a_map_that_is_linear_in_one_direction_is_found_from_its_sides(directions, axis, data):
    spline = linear_along(data.draw(splines(directions=directions)), axis)
    at = (XI,) * directions
    np.testing.assert_allclose(coons(sides(spline)).at(*at), spline.at(*at), rtol=0, atol=1e-12)


@pytest.mark.parametrize("directions", [2, 3])
@given(st.data())
def test_what_lies_between_the_sides_is_the_boolean_sum_of_linear_interpolations(directions, data):
    spline = data.draw(splines(directions=directions))
    at = (XI,) * directions
    np.testing.assert_allclose(coons(sides(spline)).at(*at), gordon_hall(spline, *at), rtol=0, atol=1e-11)


@pytest.mark.parametrize("directions", [2, 3])
@given(st.data(), SEEDS)
def test_sides_of_different_degrees_and_knots_give_the_same_map(directions, data, seed):
    spline = data.draw(splines(directions=directions, highest=2))
    at = (XI,) * directions
    found, expected = coons(roughened(spline, seed)), coons(sides(spline))
    np.testing.assert_allclose(found.at(*at), expected.at(*at), rtol=0, atol=1e-11)


def test_the_space_is_the_smallest_that_holds_the_sides():
    spline = coons(sides(Spline((1, 2, 1), (LINE[1], open_knots([0, 0.4, 1], 2), LINE[1]), np.ones((2, 4, 2, 4)))))
    assert spline.degrees == (1, 2, 1)
    assert [k.tolist() for k in spline.knots] == [[0, 0, 1, 1], [0, 0, 0, 0.4, 1, 1, 1], [0, 0, 1, 1]]


def test_a_quarter_of_a_hollow_cylinder_is_found_from_its_six_faces():
    ring = hollow_cylinder(1.0, 2.0, 3.0)
    found = coons(sides(Spline(ring.degrees, ring.knots, ring.homogeneous)))
    assert found.degrees == (1, 2, 1)
    points = points_of(found.at(XI, XI, XI)).reshape(-1, 3)
    grid = np.stack(np.meshgrid(XI, XI, XI, indexing="ij"), axis=-1).reshape(-1, 3)
    np.testing.assert_allclose(points, evaluate(ring, grid)[0], rtol=0, atol=1e-15)
    radii = np.linalg.norm(points[:, :2], axis=1).reshape(7, 7, 7)
    np.testing.assert_allclose(radii, np.broadcast_to((1 + XI)[:, None, None], (7, 7, 7)), rtol=1e-15)
