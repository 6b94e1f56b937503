from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geom2iga.errors import GeometryError
from geom2iga.model import Model
from geom2iga.patch import Face, basis, evaluate, refined, reversed_along
from solve import space
from solve.face import area_vectors, surface_of
from solve.space import gauss_points, number_control_points, point_counts
from tests.cases import bent_patch, block_patch, hollow_cylinder, model_of
from tests.oracles import assert_order, volume_quadrature
from tests.strategies import SEEDS, bent_patches, graded_surfaces, rotations
from tests.verification.glued_bodies import RIGHT_HANDED, glued_model, halves, star, turned_round, wall


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


def test_volume_of_a_rational_patch_converges_with_the_order_of_a_fixed_rule_and_is_exact_by_its_own():
    ring = hollow_cylinder(inner=1.0, outer=2.0, height=3.0)
    spans = (4, 8)
    exact = np.pi / 4 * (2**2 - 1) * 3
    errors = [abs(sum(p.volume.sum() for p in volume_quadrature(refined(ring, n), (2, 3, 2))) - exact) for n in spans]
    assert_order(errors, [1 / n for n in spans], order=2 * (2 + 1))
    for patch in (ring, refined(ring, spans=3)):
        assert sum(part.volume.sum() for part in volume_quadrature(patch)) == pytest.approx(exact, rel=1e-12)


@given(st.tuples(*[st.integers(1, 4)] * 3), st.tuples(*[st.integers(1, 3)] * 3), rotations(), SEEDS)
def test_an_affine_patch_keeps_degree_plus_one_points(degrees, spans, turn, seed):
    random = np.random.default_rng(seed)
    patch = block_patch("block", (3, -2, 1e3), (1, 2, 0.5), degrees, spans, turn)
    patch = refined(patch, knots=[random.random(2) for _ in range(3)])
    sheared = patch.control_points @ (np.eye(3) + random.uniform(-0.3, 0.3, (3, 3)))
    patch = replace(patch, control_points=sheared, weights=np.full(patch.shape, 2.0))
    assert patch.is_affine
    assert point_counts(patch) == tuple(degree + 1 for degree in degrees)


@given(bent_patches(highest=4, rational=False))
def test_a_polynomial_patch_takes_no_more_points_than_its_integrands_ask_for(patch):
    assert not patch.is_affine
    for count, degree in zip(point_counts(patch), patch.degrees, strict=True):
        assert degree + 1 <= count <= max(degree + 1, -(-3 * degree // 2))


def test_only_directions_along_which_a_map_is_rational_take_more_points_and_fewer_on_finer_meshes():
    counts = [point_counts(refined(hollow_cylinder(), spans=n)) for n in (1, 2, 4, 8)]
    assert {(first, last) for first, _, last in counts} == {(2, 2)}
    around = [middle for _, middle, _ in counts]
    assert around == sorted(around, reverse=True)
    assert around[0] > around[-1] > 3


@given(SEEDS, st.sampled_from(RIGHT_HANDED))
def test_point_counts_follow_the_directions(seed, way):
    patch = bent_patch(seed, (1, 2, 3), (3, 1, 1))
    counts = point_counts(patch)
    assert point_counts(turned_round(patch, *way)) == tuple(counts[axis] for axis in way[0])


def test_choosing_point_counts_costs_no_more_on_finer_meshes(monkeypatch):
    seen = []
    monkeypatch.setattr(space, "basis", lambda patch, xi, *rest: seen.append(len(xi)) or basis(patch, xi, *rest))
    for spans in (3, 6, 12):
        point_counts(refined(bent_patch(0, spans=(1, 1, 1)), spans=spans))
    assert seen[:3] == seen[3:6] == seen[6:]


@given(bent_patches(highest=3))
def test_forces_of_a_uniform_stress_are_right_with_the_points_chosen(patch):
    """Function by function, ∫ grad R_a dV is that of many more points."""
    counts = point_counts(patch)
    found, exact = (uniform_forces(patch, each) for each in (counts, [count + 6 for count in counts]))
    assert np.abs(found - exact).max() < 1e-11 * np.abs(exact).max()


def uniform_forces(patch, counts):
    forces = np.zeros((patch.weights.size, 3))
    for part in volume_quadrature(patch, counts):
        np.add.at(forces, part.indices, np.einsum("eqak,eq->eak", part.gradients, part.volume))
    return forces


def test_a_folded_patch_is_refused_with_the_place_of_the_fold():
    points = block_patch(spans=(2, 2, 2)).control_points.copy()
    points[2, 2, 2] = [0.4, 0.4, 0.4]
    patch = block_patch("bad", spans=(2, 2, 2))
    with pytest.raises(GeometryError, match=r'"bad".*Jacobian -.*xi = \(0\.[5-9]\d*, 0\.[5-9]\d*, 0\.[5-9]\d*\)'):
        list(volume_quadrature(replace(patch, control_points=points)))


def test_a_patch_collapsed_to_a_line_is_refused():
    patch = bent_patch(0, (3, 1, 1))
    with pytest.raises(GeometryError, match="Jacobian 0"):
        list(volume_quadrature(replace(patch, control_points=patch.control_points * [1, 0, 0])))


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


@given(SEEDS, st.sampled_from(RIGHT_HANDED), st.integers(0, 2))
def test_control_points_of_glued_faces_share_their_numbers(seed, way, axis):
    first, second = halves(bent_patch(seed, (1, 2, 3), (2, 2, 2)), axis, 0.5)
    space = number_control_points(glued_model({"body": [first, turned_round(second, *way)]}))
    (pair,) = space.model.glued
    shared = np.intersect1d(space.numbers["first"], space.numbers["second"])
    np.testing.assert_array_equal(shared, np.sort(space.face_numbers(pair.first)))
    np.testing.assert_array_equal(shared, np.sort(space.face_numbers(pair.second)))
    assert space.size == first.weights.size + second.weights.size - len(shared)
    for name, patch in space.model.patches.items():
        assert len(np.unique(space.numbers[name])) == patch.weights.size
        of_patch = space.control_points[space.numbers[name]]
        np.testing.assert_allclose(of_patch, patch.control_points.reshape(-1, 3), rtol=0, atol=1e-14)


@pytest.mark.parametrize("count", [3, 4, 5, 8])
def test_control_points_of_an_edge_in_many_patches_have_one_number(count):
    spans, degree = 2, 2
    space = number_control_points(glued_model({"star": star("s", count, degree=degree, spans=(spans,) * 3)}))
    n = spans + degree
    assert space.size == n * (1 + count * (n - 1) + count * (n - 1) ** 2)
    middle = space.face_grid(Face("s0", 0, 0))[0]
    for patch in space.model.patches:
        np.testing.assert_array_equal(space.numbers[patch].reshape(n, n, n)[0, 0], middle)


def test_numbers_of_glued_patches_follow_the_patches_without_holes():
    space = number_control_points(glued_model({"wall": wall("w", spans=((2, 1), (1, 2), (1, 1)), degree=2)}))
    sequence = np.concatenate(list(space.numbers.values()))
    seen = np.unique(sequence, return_index=True)
    np.testing.assert_array_equal(seen[0], np.arange(space.size))
    assert np.all(np.diff(seen[1]) > 0)


def test_faces_glued_twice_share_their_numbers_once():
    model = glued_model({"wall": wall("w")})
    twice = Model(model.patches, model.bodies, model.groups, model.glued * 2)
    once, again = number_control_points(model), number_control_points(twice)
    assert once.size == again.size
    for name in model.patches:
        np.testing.assert_array_equal(once.numbers[name], again.numbers[name])


def test_patches_that_touch_without_glue_share_nothing():
    glued = glued_model({"wall": wall("w")})
    apart = Model(glued.patches, glued.bodies, glued.groups)
    assert number_control_points(apart).size == sum(patch.weights.size for patch in glued.patches.values())


def test_numbers_of_a_group_of_faces_stand_once():
    space = number_control_points(glued_model({"wall": wall("w", spans=((2, 1), (1, 2), (1,)), degree=1)}))
    numbers = space.group_numbers("wall/top")
    assert len(numbers) == len(np.unique(numbers)) == 4 * 4
    np.testing.assert_array_equal(space.control_points[numbers, 2], 1)
