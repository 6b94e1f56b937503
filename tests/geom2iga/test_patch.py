from dataclasses import FrozenInstanceError, replace
from math import cos, pi

import numpy as np
import pytest
import splinepy
from hypothesis import given
from hypothesis import strategies as st

from geom2iga import patch as patches_module
from geom2iga.bspline import open_knots
from geom2iga.patch import (
    Face,
    Patch,
    basis,
    chunks,
    elevated,
    evaluate,
    face_indices,
    refined,
    reversed_along,
    surface,
)
from tests.cases import block_patch, hollow_cylinder, sample_points
from tests.oracles import assert_round_trip, assert_same_map, assert_same_patch, assert_tangent
from tests.strategies import SEEDS, bent_patches, patches, rotations

FACES = [(axis, side) for axis in range(3) for side in range(2)]


def in_splinepy(patch):
    """The same patch in splinepy, whose first direction runs fastest."""
    turned = np.moveaxis(patch.homogeneous, range(patch.directions), range(patch.directions)[::-1]).reshape(-1, 4)
    return splinepy.NURBS(patch.degrees, patch.knots, turned[:, :3] / turned[:, 3:], turned[:, 3:])


def span_middles(patch):
    """Middle points (q, d) of the spans on the diagonal: there differences do not step over a knot."""
    middles = [(at[:-1] + at[1:]) / 2 for at in patch.breaks]
    return np.stack([np.resize(m, max(map(len, middles))) for m in middles], axis=1)


def left_spans(patch, xi):
    """The span on the left of each point, as knot index."""
    columns = zip(patch.knots, patch.degrees, xi.T, strict=True)
    return np.stack([np.clip(np.searchsorted(k, x) - 1, p, len(k) - p - 2) for k, p, x in columns], axis=1)


def arc(angle):
    """A circular arc of radius 1 from (1, 0, 0) by less than a half turn about z."""
    middle = np.array([cos(angle / 2), np.sin(angle / 2), 0]) / cos(angle / 2)
    points = [[1, 0, 0], middle, [cos(angle), np.sin(angle), 0]]
    return Patch("arc", (2,), (open_knots([0, 1], 2),), points, [1, cos(angle / 2), 1])


@given(patches())
def test_points_and_derivatives_equal_splinepys(patch):
    xi = sample_points(patch)
    expected = in_splinepy(patch)
    values, gradients, hessians = evaluate(patch, xi, 2)
    np.testing.assert_allclose(values, expected.evaluate(xi), rtol=0, atol=1e-12)
    directions = np.eye(patch.directions, dtype=int)
    for i in range(patch.directions):
        slopes = expected.derivative(xi, directions[i])
        np.testing.assert_allclose(gradients[..., i], slopes, rtol=0, atol=1e-12 * max(1, abs(gradients).max()))
        for j in range(patch.directions):
            bends = expected.derivative(xi, directions[i] + directions[j])
            np.testing.assert_allclose(hessians[..., i, j], bends, rtol=0, atol=1e-12 * max(1, abs(hessians).max()))


@given(patches())
def test_derivatives_equal_differences(patch):
    for xi in span_middles(patch):
        _, gradients, hessians = evaluate(patch, [xi], 2)
        assert_tangent(lambda x: evaluate(patch, [x])[0][0], gradients[0], xi)
        assert_tangent(lambda x: evaluate(patch, [x], 1)[1][0], hessians[0], xi)


@given(patches())
def test_rational_functions_are_nonnegative_and_sum_to_one(patch):
    functions = basis(patch, sample_points(patch), 2)
    assert functions.values.min() >= 0
    np.testing.assert_allclose(functions.values.sum(axis=1), 1, rtol=0, atol=1e-14)
    for derivative in (functions.gradients, functions.hessians):
        np.testing.assert_allclose(derivative.sum(axis=1), 0, rtol=0, atol=1e-12 * max(1, abs(derivative).max()))


@given(patches())
def test_the_corner_control_points_are_the_corners(patch):
    corners = np.stack(np.meshgrid(*[at[[0, -1]] for at in patch.breaks], indexing="ij"), axis=-1)
    expected = patch.control_points[np.ix_(*[[0, -1]] * patch.directions)]
    np.testing.assert_array_equal(evaluate(patch, corners.reshape(-1, patch.directions))[0], expected.reshape(-1, 3))


@given(patches())
def test_a_field_whose_coefficients_are_the_control_points_is_the_map(patch):
    xi = sample_points(patch)
    field = np.concatenate([patch.control_points.reshape(-1, 3), np.ones((patch.weights.size, 1))], axis=1)
    for order, (mapped, found) in enumerate(zip(evaluate(patch, xi, 2), evaluate(patch, xi, 2, field), strict=True)):
        np.testing.assert_allclose(found[:, :3], mapped, rtol=0, atol=1e-13 * max(1, abs(mapped).max()))
        constant = 1 if order == 0 else 0
        np.testing.assert_allclose(found[:, 3], constant, rtol=0, atol=1e-12 * max(1, abs(mapped).max()))


@given(patches(), st.integers(1, 2000))
def test_evaluation_in_small_parts_gives_the_same(patch, size):
    xi = sample_points(patch, count=20)
    spans = left_spans(patch, xi)
    with pytest.MonkeyPatch.context() as monkeypatch:
        whole = evaluate(patch, xi, 2, spans=spans)
        monkeypatch.setattr(patches_module, "CHUNK", size)
        parts = evaluate(patch, xi, 2, spans=spans)
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-13 * max(1, abs(one).max()))


@given(st.integers(0, 50), st.integers(1, 60))
def test_chunks_cover_a_range_in_sequence(count, size):
    parts = [range(count)[part] for part in chunks(count, size)]
    assert [i for part in parts for i in part] == list(range(count))
    assert all(0 < len(part) <= size for part in parts)


@given(patches())
def test_no_points_give_empty_arrays_of_the_right_shape(patch):
    d = patch.directions
    found = evaluate(patch, np.empty((0, d)), 2)
    assert [values.shape for values in found] == [(0, 3), (0, 3, d), (0, 3, d, d)]


@given(patches(highest=4), st.data())
def test_elevation_and_refinement_do_not_move_the_map(patch, data):
    degrees = [p + data.draw(st.integers(0, 2)) for p in patch.degrees]
    raised = elevated(patch, degrees)
    assert raised.degrees == tuple(degrees)
    assert_same_map(raised, patch)
    for fine in (refined(patch, spans=data.draw(st.integers(1, 3))), refined(raised, spans=2)):
        assert_same_map(fine, patch)
        assert fine.weights.min() > 0


@given(patches(highest=3), st.integers(1, 4))
def test_refinement_cuts_every_span_into_equal_ones(patch, parts):
    for before, after in zip(patch.breaks, refined(patch, spans=parts).breaks, strict=True):
        np.testing.assert_array_equal(after[::parts], before)
        np.testing.assert_allclose(np.diff(after), np.repeat(np.diff(before) / parts, parts), rtol=1e-12)


def assert_equals_splinepys(found, expected):
    """The control points and weights of a patch equal those of a spline of splinepy."""
    shape = found.shape[::-1]
    points = np.asarray(expected.control_points).reshape(*shape, 3).transpose(*range(len(shape))[::-1], -1)
    np.testing.assert_allclose(found.weights, np.asarray(expected.weights).reshape(shape).T, rtol=1e-11)
    np.testing.assert_allclose(found.control_points, points, rtol=0, atol=1e-11)


@given(patches(highest=4))
def test_degree_elevation_equals_splinepys(patch):
    expected = in_splinepy(patch)
    expected.elevate_degrees(list(range(patch.directions)))
    assert_equals_splinepys(elevated(patch, [p + 1 for p in patch.degrees]), expected)


@given(patches(), st.data())
def test_knot_insertion_equals_splinepys(patch, data):
    expected = in_splinepy(patch)
    shares = st.lists(st.sampled_from(np.arange(1, 8) / 8), max_size=3, unique=True)
    inserted = [np.setdiff1d(k[0] + (k[-1] - k[0]) * np.array(data.draw(shares)), k) for k in patch.knots]
    for direction, knots in enumerate(inserted):
        expected.insert_knots(direction, knots)
    assert_equals_splinepys(refined(patch, knots=inserted), expected)


@given(patches(), st.data())
def test_a_patch_reversed_runs_backwards_and_reversed_twice_is_itself(patch, data):
    axis = data.draw(st.integers(0, patch.directions - 1))
    xi = sample_points(patch)
    mirrored = xi.copy()
    mirrored[:, axis] = patch.knots[axis][0] + patch.knots[axis][-1] - xi[:, axis]
    backwards = reversed_along(patch, axis)
    np.testing.assert_allclose(evaluate(backwards, xi)[0], evaluate(patch, mirrored)[0], rtol=0, atol=1e-12)
    assert_round_trip(lambda p: reversed_along(p, axis), lambda p: reversed_along(p, axis), patch, assert_same_map)


def test_reversal_turns_a_right_handed_patch_left_handed():
    for axis in range(3):
        jacobian = evaluate(reversed_along(block_patch(), axis), [[0.3, 0.4, 0.5]], 1)[1]
        assert np.linalg.det(jacobian[0]) == pytest.approx(-1)


@given(bent_patches(highest=3), st.sampled_from(FACES))
def test_a_face_is_the_border_of_the_volume(volume, which):
    face = Face(volume.name, *which)
    border = surface(volume, face)
    eta = sample_points(border)
    xi = np.insert(eta, face.axis, volume.knots[face.axis][-face.side], axis=1)
    values, gradients, hessians = evaluate(volume, xi, 2)
    found = evaluate(border, eta, 2)
    np.testing.assert_allclose(found[0], values, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found[1], gradients[..., face.axes], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found[2], hessians[..., face.axes, :][..., face.axes], rtol=0, atol=1e-11)


@given(bent_patches(highest=3), st.sampled_from(FACES))
def test_the_numbers_of_a_face_are_those_of_its_control_points_in_the_volume(volume, which):
    face = Face(volume.name, *which)
    numbers = face_indices(volume, face)
    assert numbers.shape == surface(volume, face).shape
    np.testing.assert_array_equal(volume.control_points.reshape(-1, 3)[numbers], surface(volume, face).control_points)


@given(rotations(), st.tuples(*[st.floats(0.1, 3)] * 3))
def test_outward_normals_of_a_block_point_away_from_its_centre(turn, size):
    block = block_patch(size=size, turn=turn)
    centre = evaluate(block, [[0.5, 0.5, 0.5]])[0][0]
    for axis, side in FACES:
        face = Face("block", axis, side)
        point, tangents = (array[0] for array in evaluate(surface(block, face), [[0.5, 0.5]], 1))
        area_vector = face.outward * np.cross(tangents[:, 0], tangents[:, 1])
        expected = (point - centre) / np.linalg.norm(point - centre) * np.prod(size) / size[axis]
        np.testing.assert_allclose(area_vector, expected, rtol=0, atol=1e-13)


def test_a_quarter_circle_is_exact_to_rounding():
    quarter = arc(pi / 2)
    xi = np.linspace(0, 1, 101)[:, None]
    for patch in (quarter, elevated(quarter, (5,)), refined(quarter, spans=7), reversed_along(quarter, 0)):
        points, tangents = evaluate(patch, xi, 1)
        np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, rtol=0, atol=1e-15)
        np.testing.assert_allclose(np.einsum("qi,qi->q", points, tangents[..., 0]), 0, rtol=0, atol=1e-14)


@given(st.floats(0.01, 2.0))
def test_an_arc_of_any_angle_is_exact_to_rounding(angle):
    points = evaluate(arc(angle), np.linspace(0, 1, 21)[:, None])[0]
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, rtol=0, atol=1e-15)


@given(patches())
def test_homogeneous_control_points_divide_back_to_the_points(patch):
    homogeneous = patch.homogeneous
    assert homogeneous.shape == (*patch.shape, 4)
    np.testing.assert_array_equal(homogeneous[..., 3], patch.weights)
    np.testing.assert_allclose(homogeneous[..., :3] / homogeneous[..., 3:], patch.control_points, rtol=1e-15)


def test_weights_left_out_are_all_one():
    np.testing.assert_array_equal(block_patch(spans=(2, 1, 3)).weights, np.ones((3, 2, 4)))


@given(SEEDS)
def test_a_common_factor_of_all_weights_changes_nothing(seed):
    patch = replace(block_patch(degree=2), weights=np.random.default_rng(seed).uniform(0.5, 2, (3, 3, 3)))
    assert_same_map(replace(patch, weights=7.3 * patch.weights), patch)


def test_patches_and_faces_never_change():
    patch, face = block_patch(), Face("block", 0, 1)
    with pytest.raises(FrozenInstanceError):
        patch.name = "other"
    with pytest.raises(FrozenInstanceError):
        face.side = 0
    for array in (*patch.knots, patch.control_points, patch.weights):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 5


def test_a_patch_keeps_copies_of_the_arrays_it_was_made_of():
    knots, points, weights = np.array([0.0, 0, 1, 1]), np.eye(2, 3), np.ones(2)
    patch = Patch("line", (1,), (knots,), points, weights)
    before = Patch("line", (1,), (knots.copy(),), points.copy(), weights.copy())
    knots[:], points[:], weights[:] = 7, 7, 7
    assert_same_patch(patch, before)


def test_verbs_return_new_patches_and_leave_the_old_one():
    patch, untouched = block_patch(), block_patch()
    for new in (elevated(patch, (2, 2, 2)), refined(patch, spans=2), reversed_along(patch, 1)):
        assert new is not patch
    assert_same_patch(patch, untouched)


@pytest.mark.parametrize(
    ("fault", "changes"),
    [
        ("degree must be at least 1, found 0", {"degrees": (0, 1)}),
        ("whole numbers", {"degrees": (1.5, 1)}),
        ("2 degrees but 1 knot", {"knots": ([0, 0, 1, 1],)}),
        ("0 directions", {"degrees": (), "knots": ()}),
        ("4 directions", {"degrees": (1,) * 4, "knots": ([0, 0, 1, 1],) * 4}),
        ("direction 1: .*not open", {"knots": ([0, 0, 1, 1], [0, 0.1, 0.9, 1])}),
        ("direction 0: .*decrease", {"knots": ([0, 0, 0.8, 0.2, 1, 1], [0, 0, 1, 1])}),
        (r"\(2, 2\) control points.*\(3, 2, 3\)", {"control_points": np.zeros((3, 2, 3))}),
        (r"\(2, 2\) control points.*\(2, 2, 2\)", {"control_points": np.zeros((2, 2, 2))}),
        (r"\(2, 2\) control points.*\(4,\)", {"weights": np.ones(4)}),
        ("control points must be finite", {"control_points": np.full((2, 2, 3), np.nan)}),
        ("control points must be finite", {"control_points": np.full((2, 2, 3), np.inf)}),
        ("positive, found 0", {"weights": [[1, 1], [1, 0]]}),
        ("positive, found -2", {"weights": [[1, -2], [1, 1]]}),
        ("positive, found nan", {"weights": [[1, np.nan], [1, 1]]}),
        ("positive", {"weights": [[1, np.inf], [1, 1]]}),
    ],
)
def test_a_patch_that_makes_no_sense_is_refused_by_name(fault, changes):
    whole = {"degrees": (1, 1), "knots": ([0, 0, 1, 1],) * 2, "control_points": np.zeros((2, 2, 3))}
    Patch("punch", **whole)
    with pytest.raises(ValueError, match=f'(?s)patch "punch".*{fault}'):
        Patch("punch", **(whole | changes))


def test_a_degree_cannot_be_lowered():
    with pytest.raises(ValueError, match=r'"block".*\(2, 2, 2\).*\(3, 1, 2\)'):
        elevated(block_patch(degree=2), (3, 1, 2))


def test_a_knot_inserted_too_often_or_outside_is_refused():
    line = Patch("line", (1,), ([0, 0, 1, 1],), np.eye(2, 3))
    for knots in ([0.5, 0.5], [1.0], [1.5], [-1.0]):
        with pytest.raises(ValueError, match="line"):
            refined(line, knots=[knots])


def test_a_patch_says_what_it_is():
    patch = block_patch("punch", degree=(1, 2, 3), spans=(2, 1, 4))
    assert repr(patch) == (
        "Patch('punch', degrees (1, 2, 3), 2 x 1 x 4 spans, polynomial, 63 control points in a box of 1 x 1 x 1)"
    )
    assert "rational" in repr(hollow_cylinder())
    assert "punch" in patch._repr_html_()
