from math import pi

import gmsh
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from geom2iga.bspline import open_knots
from geom2iga.cad import session
from geom2iga.cad.brep import Elementary, Free
from geom2iga.cad.exact import conic, curve_spline, distances, plane_curve, straight, surface_spline
from geom2iga.cad.topology import read_topology
from geom2iga.errors import GeometryError
from geom2iga.spline import points_of
from tests.strategies import SEEDS

ANGLES = st.tuples(st.floats(-7, 7), st.floats(0.01, 2 * pi))  # start and sweep
CONICS = {"circle": 1, "ellipse": 2, "parabola": 1, "hyperbola": 2}


def frame(seed):
    """An origin and three directions (4, 3)."""
    return np.vstack([np.random.default_rng(seed).uniform(-1, 1, 3), Rotation.random(random_state=seed).as_matrix().T])


def local(frame, points):
    """Coordinates (q, 3) along x, y and the normal or axis of a frame."""
    origin, axis, x, y = frame
    return (points - origin) @ np.array([x, y, axis]).T


def random_parameters(seed, count=20):
    return np.sort(np.random.default_rng(seed).random(count))


# Curves


def test_a_circle_has_its_radius_to_the_last_digit():
    for sweep in (0.1, 1.0, pi / 2, 2.0, pi, 5.0, 2 * pi):
        curve = conic(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), 0.3, 0.3 + sweep)
        points = points_of(curve.at(np.linspace(0, 1, 200)))
        assert np.abs(np.linalg.norm(points, axis=1) - 1).max() <= 1e-15
        assert np.abs(points[:, 2]).max() == 0


@given(SEEDS, ANGLES, st.floats(0.1, 10), st.floats(0.1, 10))
def test_an_ellipse_follows_its_equation_from_one_angle_to_the_other(seed, angles, long, short):
    placed, (start, sweep) = frame(seed), angles
    curve = curve_spline(Elementary("ellipse", placed, (long, short)), start, start + sweep)
    at = local(placed, points_of(curve.at(random_parameters(seed))))
    x, y, height = at.T
    np.testing.assert_allclose((x / long) ** 2 + (y / short) ** 2, 1, rtol=1e-13)
    assert np.abs(height).max() <= 1e-14 * (1 + long + short)
    passed = np.unwrap(np.arctan2(y / short, x / long))
    assert np.all(np.diff(passed) > 0)
    ends = local(placed, points_of(curve.at(np.array([0.0, 1.0]))))
    expected = [[long * np.cos(t), short * np.sin(t), 0] for t in (start, start + sweep)]
    np.testing.assert_allclose(ends, expected, rtol=0, atol=1e-13 * (1 + long + short))


@given(SEEDS, ANGLES)
def test_weights_of_a_conic_stay_between_a_half_and_one(seed, angles):
    weights = curve_spline(Elementary("circle", frame(seed), (2.0,)), angles[0], sum(angles)).coefficients[:, 3]
    assert weights.min() > 0.5 - 1e-8
    assert weights.max() == 1


@given(SEEDS, st.floats(-2, 2), st.floats(0.01, 2), st.floats(0.1, 3), st.floats(0.1, 3))
def test_a_hyperbola_follows_its_equation(seed, start, sweep, first, second):
    placed = frame(seed)
    curve = curve_spline(Elementary("hyperbola", placed, (first, second)), start, start + sweep)
    x, y, height = local(placed, points_of(curve.at(random_parameters(seed)))).T
    scale = (x / first) ** 2
    np.testing.assert_allclose(scale - (y / second) ** 2, 1, rtol=0, atol=1e-12 * scale.max())
    assert np.abs(height).max() <= 1e-13 * (1 + np.abs(x).max())
    assert x.min() > 0
    ends = local(placed, points_of(curve.at(np.array([0.0, 1.0]))))
    expected = [[first * np.cosh(t), second * np.sinh(t), 0] for t in (start, start + sweep)]
    np.testing.assert_allclose(ends, expected, rtol=1e-12, atol=1e-13 * (1 + np.abs(x).max()))


@given(SEEDS, st.floats(-3, 3), st.floats(0.01, 3), st.floats(0.1, 3))
def test_a_parabola_keeps_its_parameter(seed, start, sweep, focal):
    placed, xi = frame(seed), random_parameters(seed)
    curve = curve_spline(Elementary("parabola", placed, (focal,)), start, start + sweep)
    t = start + sweep * xi
    expected = np.stack([t**2 / (4 * focal), t, 0 * t], axis=1)
    np.testing.assert_allclose(local(placed, points_of(curve.at(xi))), expected, rtol=0, atol=1e-12 * (1 + 40 / focal))


@given(SEEDS, st.floats(-3, 3), st.floats(0.01, 3))
def test_a_line_keeps_its_parameter(seed, start, sweep):
    origin, direction = frame(seed)[:2]
    xi = random_parameters(seed)
    points = points_of(curve_spline(Elementary("line", np.array([origin, direction])), start, start + sweep).at(xi))
    expected = origin + (start + sweep * xi)[:, None] * direction
    np.testing.assert_allclose(points, expected, rtol=0, atol=1e-14 * 8)


@st.composite
def free_curves(draw, periodic=False):
    """Rational B-spline curves over any range, with knots of any multiplicity; periodic ones over one period."""
    random = np.random.default_rng(draw(SEEDS))
    degree, spans = draw(st.integers(1, 4)), draw(st.integers(2 if periodic else 1, 4))
    counts = random.integers(1, degree + 1, spans + 1)
    counts[[0, -1]] = random.integers(1, degree + 1) if periodic else degree + 1
    at = np.cumsum(random.uniform(0.2, 1, spans + 1)) - 2
    size = counts[:-1].sum() if periodic else counts.sum() - degree - 1
    weights = random.uniform(0.5, 2, (size, 1))
    coefficients = np.hstack([random.normal(size=(size, 3)) * weights, weights])
    return Free("B-spline", (degree,), (np.repeat(at, counts),), coefficients, (periodic,))


@given(free_curves(), st.integers(0, 15), st.integers(1, 10))
def test_any_piece_of_a_b_spline_is_that_of_scipy(curve, low, share):
    (knots,), (degree,) = curve.knots, curve.degrees
    low, high = knots[0] + np.ptp(knots) * np.array([low / 20, low / 20 + share / 10 * (1 - low / 20)])
    spline = curve_spline(curve, low, high)
    xi = np.linspace(0, 1, 11)
    expected = BSpline(knots, curve.coefficients, degree)(low + (high - low) * xi)
    np.testing.assert_allclose(spline.at(xi), expected, rtol=0, atol=1e-12)
    assert (spline.knots[0][0], spline.knots[0][-1]) == (0, 1)


@given(free_curves(periodic=True), st.integers(-15, 15), st.integers(1, 10))
def test_a_periodic_b_spline_runs_over_its_seam(curve, start, share):
    """The same spline with many periods written out."""
    (knots,), (degree,) = curve.knots, curve.degrees
    period, turns = np.ptp(knots), 6
    multiplicity = np.count_nonzero(knots == knots[0])
    once = knots[:-multiplicity]
    every = np.concatenate([once + period * turn for turn in range(-turns, turns)])
    first = turns * len(once) + multiplicity - degree - 1  # its function is the first whose support reaches the start
    numbers = (np.arange(len(every) - degree - 1) - first) % len(once)
    low, length = knots[0] + start / 10 * period, share / 10 * period
    xi = np.linspace(0, 1, 11)
    expected = BSpline(every, curve.coefficients[numbers], degree)(low + length * xi)
    np.testing.assert_allclose(curve_spline(curve, low, low + length).at(xi), expected, rtol=0, atol=1e-11)


def add_curves(occ):
    """One curve of each kind that gmsh makes of points."""
    places = [(0, 0, 0), (1, 1, 0), (2, 0, 1), (3, 2, 1), (2, 3, 0)]
    tags = [occ.addPoint(*at) for at in places]
    occ.addBezier(tags)
    occ.addBSpline(tags, degree=3)
    occ.addBSpline(tags, degree=2, weights=[1, 0.5, 2, 1, 1])
    occ.addSpline(tags)
    occ.addBSpline([*tags, tags[0]], degree=3)
    occ.addSpline([*tags, tags[0]])
    occ.addLine(tags[0], tags[3])


def add_short_periods(occ):
    """Closed splines with as many knots as degrees."""
    tags = [occ.addPoint(*at) for at in [(0, 0, 0), (1, 1, 0), (2, 0, 1)]]
    occ.addBSpline([*tags, tags[0]], degree=3)
    occ.addBSpline([*tags[:2], tags[0]], degree=2)


@pytest.mark.parametrize("add", [add_curves, pytest.param(add_short_periods)])
def test_gmsh_finds_the_same_points_on_splines_closed_or_not(empty_gmsh, add):
    add(gmsh.model.occ)
    gmsh.model.occ.synchronize()
    xi = np.linspace(0, 1, 21)
    for tag, edge in read_topology(session.boundary()).edges.items():
        low, high = (ends[0] for ends in gmsh.model.getParametrizationBounds(1, tag))
        expected = np.reshape(gmsh.model.getValue(1, tag, low + (high - low) * xi), (-1, 3))
        np.testing.assert_allclose(points_of(edge.curve.at(xi)), expected, rtol=0, atol=1e-12)


def test_a_curve_in_the_plane_is_the_one_in_space_without_its_height():
    flat = frame(3)[[0, 2, 3]][:, :2]
    for kind, count in CONICS.items():
        numbers = (2.0, 0.7)[:count]
        spline = plane_curve(Elementary(kind, flat, numbers), 0.2, 1.1)
        solid = np.insert(np.insert(flat, 2, 0.0, axis=1), 1, [0.0, 0, 1], axis=0)
        expected = curve_spline(Elementary(kind, solid, numbers), 0.2, 1.1).coefficients[:, [0, 1, 3]]
        np.testing.assert_allclose(spline.coefficients, expected, rtol=0, atol=1e-14)
        trimmed = Elementary("trimmed", np.empty((0, 2)), (0, 2), Elementary(kind, flat, numbers))
        np.testing.assert_allclose(plane_curve(trimmed, 0.2, 1.1).coefficients, expected, rtol=0, atol=1e-14)


def test_offset_curves_and_surfaces_are_refused():
    line = Elementary("line", np.eye(3)[:2])
    with pytest.raises(GeometryError, match=r"an offset curve is no NURBS.*B-spline") as error:
        curve_spline(Elementary("offset", np.eye(3)[:1], (0.5,), line), 0, 1)
    assert error.value.exit_code == 3
    plane = Elementary("plane", np.vstack([np.zeros(3), np.eye(3)[[2, 0, 1]]]))
    with pytest.raises(GeometryError, match=r"an offset surface is no NURBS.*B-spline"):
        surface_spline(Elementary("offset", np.empty((0, 3)), (0.5,), plane), np.array([[0, 1], [0, 1]]))


# Surfaces


def point_and_normal(kind, placed, numbers, u, v):
    """The formula of an elementary surface and its unit normal, at arrays of parameters."""
    origin, axis, x, y = placed
    out = np.cos(u)[:, None] * x + np.sin(u)[:, None] * y
    up = np.broadcast_to(axis, out.shape)
    tilted = np.cos(v)[:, None] * out + np.sin(v)[:, None] * up
    radius = numbers[0] if numbers else 0.0
    match kind:
        case "plane":
            return origin + u[:, None] * x + v[:, None] * y, up
        case "cylinder":
            return origin + radius * out + v[:, None] * up, out
        case "cone":
            along = np.sin(numbers[1]) * out + np.cos(numbers[1]) * up
            return origin + radius * out + v[:, None] * along, np.cos(numbers[1]) * out - np.sin(numbers[1]) * up
        case "sphere":
            return origin + radius * tilted, tilted
    return origin + radius * out + numbers[1] * tilted, tilted


ELEMENTARY = {"plane": (), "cylinder": (2.0,), "cone": (2.0, 0.4), "sphere": (2.0,), "torus": (2.0, 0.6)}
KINDS = st.sampled_from(sorted(ELEMENTARY))


@given(KINDS, SEEDS, st.floats(0.1, 2), st.floats(0.1, 1))
def test_a_rectangle_of_a_surface_has_its_corners_and_its_middle(kind, seed, wide, high):
    """Symmetry puts the middle of one piece there."""
    placed, numbers = frame(seed), ELEMENTARY[kind]
    start = np.random.default_rng(seed).uniform(-0.5, 0.5, 2)
    ranges = np.stack([start, start + np.array([wide, high])], axis=1)
    spline = surface_spline(Elementary(kind, placed, numbers), ranges)
    u, v = (each.ravel() for each in np.meshgrid(*np.linspace(*ranges.T, 3).T, indexing="ij"))
    expected = point_and_normal(kind, placed, numbers, u, v)[0]
    points = points_of(spline.at(*[np.array([0, 0.5, 1])] * 2)).reshape(-1, 3)
    np.testing.assert_allclose(points, expected, rtol=0, atol=1e-13)


@given(KINDS, SEEDS, ANGLES, st.floats(0.1, 1))
def test_every_point_of_such_a_rectangle_lies_on_the_surface(kind, seed, angles, high):
    surface = Elementary(kind, frame(seed), ELEMENTARY[kind])
    ranges = np.array([[angles[0], sum(angles)], [-0.3, high]])
    points = points_of(surface_spline(surface, ranges).at(*[random_parameters(seed)] * 2)).reshape(-1, 3)
    assert distances(surface, points, ranges).max() <= 1e-13


@given(KINDS, SEEDS, st.floats(-0.3, 0.3))
def test_the_distance_of_a_point_is_that_along_the_normal(kind, seed, off):
    random = np.random.default_rng(seed)
    placed, numbers = frame(seed), ELEMENTARY[kind]
    u, v = random.uniform(-3, 3, 10), random.uniform(-0.5, 1, 10)
    points, normals = point_and_normal(kind, placed, numbers, u, v)
    found = distances(Elementary(kind, placed, numbers), points + off * normals, np.array([[-3, 3], [-0.5, 1]]))
    np.testing.assert_allclose(found, abs(off), rtol=0, atol=1e-14 * 8)


def wavy(seed=0):
    """A B-spline surface over a square."""
    random = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.linspace(0, 3, 5), np.linspace(0, 3, 5), indexing="ij"), axis=-1)
    points = np.concatenate([grid, random.uniform(0, 0.3, (5, 5, 1)), np.ones((5, 5, 1))], axis=-1)
    return Free("B-spline", (3, 3), (open_knots([0, 0.5, 1], 3),) * 2, points, (False, False))


@given(st.floats(-0.1, 0.1), SEEDS)
def test_the_distance_from_a_b_spline_surface_is_that_along_the_normal(off, seed):
    surface, whole = wavy(), np.array([[0.0, 1], [0, 1]])
    patch = surface_spline(surface, whole)
    u, v = np.random.default_rng(seed).uniform(0.2, 0.8, (2, 3))
    step = 1e-6
    here, right, up = (points_of(patch.at(u + du, v + dv)) for du, dv in ((0, 0), (step, 0), (0, step)))
    normals = np.cross(right - here, up - here)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    found = distances(surface, (here + off * normals).reshape(-1, 3), whole)
    np.testing.assert_allclose(found, abs(off), rtol=0, atol=1e-6)


@given(SEEDS, st.floats(0.1, 3))
def test_a_revolved_and_an_extruded_curve_carry_their_profile(seed, wide):
    origin, axis, x, _ = placed = frame(seed)
    foot = origin + 2 * x
    profile = Elementary("line", np.array([foot, (x + axis) / 2**0.5]))
    turned = surface_spline(Elementary("revolution", placed[:2], (), profile), np.array([[0.2, 0.2 + wide], [0, 1]]))
    points = points_of(turned.at(*[random_parameters(seed)] * 2)).reshape(-1, 3)
    radius, height = np.linalg.norm(local(placed, points)[:, :2], axis=1), local(placed, points)[:, 2]
    np.testing.assert_allclose(radius - height, 2, rtol=0, atol=1e-13)
    moved = surface_spline(Elementary("extrusion", placed[1:2], (), profile), np.array([[0, 1], [0.5, 0.5 + wide]]))
    ends = points_of(moved.corners)
    np.testing.assert_allclose(ends[:, 1] - ends[:, 0], [wide * axis] * 2, rtol=0, atol=1e-13)
    np.testing.assert_allclose(ends[0, 0], foot + 0.5 * axis, rtol=0, atol=1e-13)


def test_a_straight_line_has_weights_of_one():
    line = straight(np.zeros(3), np.ones(3))
    assert line.degrees == (1,)
    np.testing.assert_array_equal(line.coefficients, [[0, 0, 0, 1], [1, 1, 1, 1]])
