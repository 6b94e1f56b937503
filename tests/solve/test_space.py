from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geom2iga.errors import GeometryError
from geom2iga.patch import Face, evaluate, refined, reversed_along
from solve import space
from solve.face import area_vectors, surface_of
from solve.space import gauss_points, number_control_points, volume_quadrature
from tests.cases import bent_patch, block_patch, hollow_cylinder, model_of
from tests.oracles import assert_order
from tests.strategies import SEEDS, bent_patches, graded_surfaces, rotations


@given(graded_surfaces(), st.data())
def test_gauss_points_integrate_polynomials_exactly(surface, data):
    powers = [data.draw(st.integers(0, 2 * degree + 1)) for degree in surface.degrees]
    points = gauss_points(surface)
    found = points.weights @ np.prod(points.xi**powers, axis=1)
    assert found == pytest.approx(1 / ((powers[0] + 1) * (powers[1] + 1)), rel=1e-13)


@given(graded_surfaces(), st.integers(1, 5))
def test_gauss_points_of_given_number_lie_inside_their_spans(surface, count):
    points = gauss_points(surface, (count, count))
    assert points.per_span == count**2
    for d, knots in enumerate(surface.knots):
        assert np.all((knots[points.spans[:, d]] < points.xi[:, d]) & (points.xi[:, d] < knots[points.spans[:, d] + 1]))
    spans = np.prod([len(at) - 1 for at in surface.breaks])
    assert len(np.unique(points.spans[:: points.per_span], axis=0)) == spans == len(points.xi) / points.per_span


@given(bent_patches(highest=2, rational=False))
def test_volume_equals_the_flux_of_position_through_the_six_faces(patch):
    model = model_of(patch)
    volume = sum(part.volume.sum() for part in volume_quadrature(patch))
    flux = 0.0
    for axis in range(3):
        for side in range(2):
            surface = surface_of(model, Face(patch.name, axis, side))
            points = gauss_points(surface.patch, [2 * p for p in surface.patch.degrees])
            at, normal, stretch = area_vectors(surface, points.xi)
            flux += np.sum(np.sum(at * normal, axis=1) * stretch * points.weights) / 3
    assert volume == pytest.approx(flux, rel=1e-12)


def test_volume_of_a_rational_patch_converges_with_the_order_of_gauss_points():
    ring = hollow_cylinder(inner=1.0, outer=2.0, height=3.0)
    spans = (4, 8)
    exact = np.pi / 4 * (2**2 - 1) * 3
    errors = [abs(sum(p.volume.sum() for p in volume_quadrature(refined(ring, spans=n))) - exact) for n in spans]
    assert_order(errors, [1 / n for n in spans], order=2 * (2 + 1))


@given(bent_patches())
def test_gradients_reproduce_position_and_those_of_all_functions_cancel(patch):
    points = patch.control_points.reshape(-1, 3)
    for part in volume_quadrature(patch):
        gradient = np.einsum("eak,eqai->eqki", points[part.indices], part.gradients)
        np.testing.assert_allclose(gradient, np.broadcast_to(np.eye(3), gradient.shape), rtol=0, atol=1e-12)
        assert np.abs(part.gradients.sum(axis=2)).max() < 1e-12
        assert np.abs(part.values.sum(axis=2) - 1).max() < 1e-14


def test_spans_taken_in_runs_give_the_same_as_all_at_once(monkeypatch):
    patch = bent_patch(3, degrees=(1, 2, 1), spans=(2, 2, 3))
    (whole,) = volume_quadrature(patch)
    monkeypatch.setattr(space, "CHUNK", 1)
    parts = list(volume_quadrature(patch))
    assert len(parts) == 12
    for field in whole._fields:
        np.testing.assert_array_equal(np.concatenate([getattr(part, field) for part in parts]), getattr(whole, field))


def test_a_folded_patch_is_refused_with_the_place_of_the_fold():
    points = block_patch(spans=(2, 2, 2)).control_points.copy()
    points[2, 2, 2] = [0.4, 0.4, 0.4]
    patch = block_patch("bad", spans=(2, 2, 2))
    with pytest.raises(GeometryError, match=r'"bad".*Jacobian -.*xi = \(0\.[5-9]\d*, 0\.[5-9]\d*, 0\.[5-9]\d*\)'):
        list(volume_quadrature(replace(patch, control_points=points)))


@given(st.integers(0, 2))
def test_a_left_handed_patch_is_refused(axis):
    with pytest.raises(GeometryError, match='"block"'):
        list(volume_quadrature(reversed_along(block_patch(), axis)))


@given(SEEDS, rotations())
def test_numbers_are_those_of_all_control_points_each_once(seed, turn):
    first, second = bent_patch(seed, name="first"), block_patch("second", degree=2, spans=(3, 1, 2), turn=turn)
    numbered = number_control_points(model_of(first, second))
    assert sorted(np.concatenate(list(numbered.numbers.values()))) == list(range(numbered.size))
    assert numbered.dofs == 3 * numbered.size
    for patch in (first, second):
        of_patch = numbered.control_points[numbered.numbers[patch.name]]
        np.testing.assert_array_equal(of_patch, patch.control_points.reshape(-1, 3))
        np.testing.assert_array_equal(numbered.body_numbers(patch.name), np.sort(numbered.numbers[patch.name]))


@given(bent_patches(), st.integers(0, 2), st.integers(0, 1))
def test_face_numbers_are_those_of_the_control_points_on_the_face(patch, axis, side):
    model = model_of(block_patch(), patch)
    numbered = number_control_points(model)
    face = Face(patch.name, axis, side)
    np.testing.assert_array_equal(
        numbered.control_points[numbered.face_numbers(face)], model.surface(face).control_points.reshape(-1, 3)
    )
    xi = np.full((1, 3), 0.3)
    xi[0, axis] = side
    np.testing.assert_allclose(
        evaluate(model.surface(face), np.full((1, 2), 0.3))[0], evaluate(patch, xi)[0], atol=1e-14
    )
