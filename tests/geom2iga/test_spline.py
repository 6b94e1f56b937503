from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.interpolate import BSpline, NdBSpline

from geom2iga import model
from geom2iga.bspline import greville
from geom2iga.errors import GeometryError
from geom2iga.patch import evaluate
from geom2iga.spline import Spline, adaptation, adapted, interpolated, points_of, product, restricted, united
from tests.strategies import SEEDS, open_knot_vectors, patches

XI = np.concatenate([np.linspace(0, 1, 23), [0.3, 0.7]])


@st.composite
def spaces(draw, highest=4):
    """Degree and open knot vector from 0 to 1; inner knots of whole tenths, so that two vectors share some."""
    degree = draw(st.integers(1, highest))
    at = sorted(draw(st.sets(st.integers(1, 9), max_size=3)))
    counts = draw(st.lists(st.integers(1, degree), min_size=len(at), max_size=len(at)))
    inner = np.repeat(np.array(at) / 10, counts)
    return degree, np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])


@st.composite
def splines(draw, directions=2, size=4, highest=3):
    """Splines of values of any size over [0, 1]^d."""
    each = [draw(spaces(highest)) for _ in range(directions)]
    degrees, knots = zip(*each, strict=True)
    shape = [len(k) - p - 1 for p, k in each]
    return Spline(degrees, knots, np.random.default_rng(draw(SEEDS)).normal(size=(*shape, size)))


def positive(spline):
    """The same spline with a last component between 1 and 2: homogeneous coordinates of a rational map."""
    coefficients = spline.coefficients.copy()
    coefficients[..., -1] = 1 + 1 / (1 + coefficients[..., -1] ** 2)
    return replace(spline, coefficients=coefficients)


def smoothness(degree, knots, at):
    """Continuous derivatives at a point; where there is no knot, as many as may be."""
    return degree - np.count_nonzero(np.abs(knots - at) < 1e-9)


def reference(spline, *axes):
    """Values of a spline, by SciPy."""
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return NdBSpline(spline.knots, spline.coefficients, spline.degrees)(grid)


@given(splines(directions=2))
def test_a_spline_is_the_tensor_product_of_b_splines(spline):
    axes = np.linspace(0, 1, 5), np.linspace(0, 1, 4)
    np.testing.assert_allclose(spline.at(*axes), reference(spline, *axes), rtol=0, atol=1e-12)


@given(st.lists(spaces(), min_size=1, max_size=4))
def test_the_union_of_spaces_holds_them_all_and_no_more(each):
    degree, knots = united(each)
    assert degree == max(p for p, _ in each)
    assert np.all(np.diff(knots) >= 0)
    assert (knots[: degree + 1] == 0).all()
    assert (knots[-degree - 1 :] == 1).all()
    for at in np.arange(1, 10) / 10:
        roughest = min(smoothness(p, k, at) if np.any(k == at) else degree for p, k in each)
        assert smoothness(degree, knots, at) == roughest


@given(st.lists(spaces(), min_size=1, max_size=3))
def test_the_union_of_spaces_does_not_depend_on_their_sequence_and_is_its_own_union(each):
    degree, knots = united(each)
    for other in (united(each[::-1]), united([(degree, knots), *each])):
        assert other[0] == degree
        np.testing.assert_array_equal(other[1], knots)


def test_knots_that_rounding_sets_apart_are_one():
    near = np.array([0.0, 0, 0.3 + 3e-12, 1, 1])
    degree, knots = united([(1, np.array([0.0, 0, 0.3, 1, 1])), (1, near)])
    assert (degree, knots.tolist()) == (1, [0, 0, 0.3, 1, 1])
    curve = Spline((1,), (near,), np.array([[0.0], [1.0], [5.0]]))
    np.testing.assert_allclose(adapted(curve, [(degree, knots)]).coefficients, curve.coefficients)


@given(spaces(), spaces(), SEEDS)
def test_a_spline_in_a_larger_space_is_the_same_function(own, other, seed):
    degree, knots = own
    wanted_degree, wanted = united([own, other])
    coefficients = np.random.default_rng(seed).normal(size=len(knots) - degree - 1)
    found = adaptation(degree, knots, wanted_degree, wanted) @ coefficients
    expected = BSpline(knots, coefficients, degree)(XI)
    np.testing.assert_allclose(BSpline(wanted, found, wanted_degree)(XI), expected, rtol=0, atol=1e-12)


@given(splines(directions=2), spaces(), spaces())
def test_every_direction_is_adapted_on_its_own(spline, first, second):
    wanted = [united([(p, k), more]) for p, k, more in zip(spline.degrees, spline.knots, (first, second), strict=True)]
    found = adapted(spline, wanted)
    assert found.degrees == tuple(p for p, _ in wanted)
    np.testing.assert_allclose(found.at(XI, XI), reference(spline, XI, XI), rtol=0, atol=1e-12)


@given(splines(directions=2))
def test_a_spline_in_its_own_space_keeps_its_coefficients(spline):
    found = adapted(spline, list(zip(spline.degrees, spline.knots, strict=True)))
    np.testing.assert_allclose(found.coefficients, spline.coefficients, rtol=0, atol=1e-14)


@given(splines(directions=2))
def test_the_values_at_the_greville_abscissae_are_enough_to_find_a_spline(spline):
    own = list(zip(spline.degrees, spline.knots, strict=True))
    values = reference(spline, *[np.clip(greville(k, p), 0, 1) for p, k in own])
    found = interpolated(values, own)
    assert found.degrees == spline.degrees
    np.testing.assert_allclose(found.coefficients, spline.coefficients, rtol=0, atol=1e-10)


@given(splines(directions=2, highest=2), splines(directions=2, size=1, highest=2))
def test_a_product_is_the_product_of_the_values_at_every_point(spline, factor):
    found = product(spline, factor)
    assert found.degrees == tuple(p + q for p, q in zip(spline.degrees, factor.degrees, strict=True))
    expected = reference(spline, XI, XI) * reference(factor, XI, XI)
    np.testing.assert_allclose(found.at(XI, XI), expected, rtol=0, atol=1e-10)


@given(splines(directions=2, highest=2), splines(directions=2, size=1, highest=2))
def test_a_factor_does_not_move_a_rational_map(spline, factor):
    spline, factor = positive(spline), positive(factor)
    found = points_of(product(spline, factor).at(XI, XI))
    np.testing.assert_allclose(found, points_of(spline.at(XI, XI)), rtol=0, atol=1e-10)


@st.composite
def pieces(draw):
    """A curve whose knots need not be open, and an interval of those where it is defined, its ends often knots."""
    degree = draw(st.integers(1, 4))
    counts = draw(st.lists(st.integers(1, degree), min_size=2 * degree + 2, max_size=2 * degree + 6))
    steps = draw(st.lists(st.sampled_from([0.25, 0.5, 1.0]), min_size=len(counts), max_size=len(counts)))
    knots = np.repeat(np.cumsum(steps) - 1, counts)
    inside = knots[degree : len(knots) - degree]
    between = st.integers(0, 1000).map(lambda share: inside[0] + share / 1000 * (inside[-1] - inside[0]))
    places = st.sampled_from(sorted(set(inside.tolist()))) | between
    low, high = sorted([draw(places), draw(places)])
    assume(high - low > 1e-3)
    return degree, knots, low, high


@given(pieces(), SEEDS)
def test_a_piece_of_a_curve_is_that_piece_whatever_its_knots(piece, seed):
    degree, knots, low, high = piece
    coefficients = np.random.default_rng(seed).normal(size=(len(knots) - degree - 1, 3))
    found, values = restricted(degree, knots, coefficients, low, high)
    assert (found[: degree + 1] == 0).all()
    assert (found[-degree - 1 :] == 1).all()
    within = XI * (1 - 1e-13)  # SciPy takes the end of a curve for the begin of what comes after it
    expected = BSpline(knots, coefficients, degree)(low + within * (high - low))
    np.testing.assert_allclose(BSpline(found, values, degree)(within), expected, rtol=0, atol=1e-10)
    assert len(found) - 2 * (degree + 1) == np.count_nonzero((knots > low + 1e-9) & (knots < high - 1e-9))


def test_an_end_that_rounding_sets_beside_a_knot_is_that_knot():
    knots = np.array([-0.4, -0.2, 0.0, 0.1, 0.4, 0.7, 1.0, 1.2, 1.5])
    coefficients = np.arange(6.0)[:, None] ** 2
    exact = restricted(2, knots, coefficients, 0.1, 0.7)
    near = restricted(2, knots, coefficients, 0.1 - 1e-13, 0.7 + 1e-13)
    np.testing.assert_array_equal(near[0], exact[0])
    np.testing.assert_array_equal(near[1], exact[1])


@given(open_knot_vectors(), SEEDS)
def test_the_whole_of_a_curve_keeps_its_coefficients(space, seed):
    knots, degree = space
    coefficients = np.random.default_rng(seed).normal(size=(len(knots) - degree - 1, 2))
    found, values = restricted(degree, knots, coefficients, knots[0], knots[-1])
    np.testing.assert_allclose(found, (knots - knots[0]) / (knots[-1] - knots[0]), rtol=0, atol=1e-14)
    np.testing.assert_allclose(values, coefficients, rtol=0, atol=1e-11)


@pytest.mark.parametrize("orientation", range(8))
@given(splines(directions=2))
def test_a_surface_is_oriented_as_the_faces_of_a_model_are(orientation, spline):
    found = spline.oriented(orientation)
    np.testing.assert_array_equal(found.coefficients, model.oriented(spline.coefficients, orientation))
    np.testing.assert_allclose(found.at(XI, 1 - XI), _turned(spline, orientation), rtol=0, atol=1e-11)


def _turned(spline, orientation):
    """Values of an oriented surface at XI, 1 - XI, from those of the surface itself, point by point."""
    first, second = XI, 1 - XI
    first = 1 - first if orientation & 2 else first
    second = 1 - second if orientation & 4 else second
    if orientation & 1:
        return reference(spline, second, first).swapaxes(0, 1)
    return reference(spline, first, second)


@given(splines(directions=3), st.integers(0, 2), st.integers(0, 1))
def test_an_end_of_a_volume_is_its_face(spline, axis, side):
    axes = [XI, XI, XI]
    axes[axis] = np.array([float(side)])
    expected = reference(spline, *axes).squeeze(axis)
    np.testing.assert_allclose(spline.end(axis, side).at(XI, XI), expected, rtol=0, atol=1e-12)


@given(splines(directions=3))
def test_the_corners_of_a_volume_are_its_values_there(spline):
    ends = np.array([0.0, 1.0])
    np.testing.assert_allclose(spline.corners, spline.at(ends, ends, ends), rtol=0, atol=1e-13)


@given(splines(directions=2), SEEDS)
def test_a_moved_rational_map_is_moved_point_by_point(spline, seed):
    spline, affine = positive(spline), np.random.default_rng(seed).normal(size=(3, 4))
    before, after = (points_of(s.at(XI, XI)) for s in (spline, spline.moved(affine)))
    np.testing.assert_allclose(after, before @ affine[:, :3].T + affine[:, 3], rtol=0, atol=1e-10)


@given(patches((3,), highest=3))
def test_a_patch_and_its_homogeneous_spline_are_one_map(patch):
    patch = replace(patch, knots=tuple((k - k[0]) / (k[-1] - k[0]) for k in patch.knots))
    spline = Spline(patch.degrees, patch.knots, patch.homogeneous)
    at = np.array([0.0, 0.2, 0.9, 1.0])
    grid = np.stack(np.meshgrid(at, at, at, indexing="ij"), axis=-1).reshape(-1, 3)
    expected = evaluate(spline.patch("copy"), grid)[0].reshape(4, 4, 4, 3)
    np.testing.assert_allclose(points_of(spline.at(at, at, at)), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("weight", [0.0, -0.25, np.nan])
def test_a_map_with_a_weight_that_is_not_positive_is_no_patch(weight):
    coefficients = np.ones((2, 4))
    coefficients[1, 3] = weight
    with pytest.raises(ValueError, match=rf'patch "lid": weights must be positive, found {weight:g}'):
        Spline((1,), (np.array([0.0, 0, 1, 1]),), coefficients).patch("lid")


@pytest.mark.parametrize("ends", [(0.5, 0.5), (0.7, 0.3)])
def test_no_piece_of_a_spline_can_be_cut_out_where_nothing_lies(ends):
    with pytest.raises(GeometryError, match="where nothing lies: draw it anew"):
        restricted(2, np.array([0.0, 0, 0, 0.5, 1, 1, 1]), np.zeros((4, 1)), *ends)
