import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag

from geom2iga.errors import GeometryError
from geom2iga.patch import refined
from geom2iga.threads import one_blas_thread
from solve import sums
from solve.case import Support
from solve.constraints import constrain, find_conditions
from solve.elasticity import assemble_stiffness
from solve.linear import direct_solver
from solve.material import Material
from solve.space import number_control_points
from tests.cases import bent_patch, block_patch, model_of, solved
from tests.oracles import (
    assert_order,
    assert_rigid_motion_costs_nothing,
    assert_symmetric,
    stiffness_by_spans,
    volume_quadrature,
)
from tests.solve.joined import MODELS
from tests.strategies import SEEDS, bent_patches, rotations
from tests.verification.glued_bodies import RIGHT_HANDED, glued_model, halves, turned_round

STEEL = Material(200.0, 0.3)


def stiffness_of(*patches, materials=None):
    space = number_control_points(model_of(*patches))
    return assemble_stiffness(space, materials or dict.fromkeys(space.model.bodies, STEEL))


def assert_same_as_by_spans(model, tolerance=1e-13):
    space = number_control_points(model)
    materials = {body: Material(200.0 + place, 0.3) for place, body in enumerate(model.bodies)}
    found, expected = assemble_stiffness(space, materials), stiffness_by_spans(space, materials)
    assert found.has_canonical_format
    np.testing.assert_allclose(found.toarray(), expected, rtol=0, atol=tolerance * np.abs(expected).max())


@given(bent_patches(), st.lists(st.sampled_from([0.3, 0.7]), max_size=3), st.integers(0, 2))
def test_integrals_direction_by_direction_are_those_span_by_span(patch, knots, axis):
    repeated = [knot for knot in set(knots) for _ in range(min(knots.count(knot), patch.degrees[axis]))]
    patch = refined(patch, knots=[repeated if d == axis else [] for d in range(3)])
    assert_same_as_by_spans(model_of(patch))


@pytest.mark.parametrize("rational", [False, True])
def test_a_common_factor_of_the_weights_changes_nothing(rational):
    patch = bent_patch(0, (1, 2, 2), rational=rational)
    scaled = replace(patch, weights=3 * patch.weights)
    found, expected = stiffness_of(scaled).toarray(), stiffness_of(patch).toarray()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("axes", [(1, 1, 2), (1, 2, 1), (2, 1, 1)])
@pytest.mark.parametrize("chunk", [1, 200_000])
def test_a_long_patch_taken_in_tiles_is_the_same_as_span_by_span(monkeypatch, axes, chunk):
    monkeypatch.setattr(sums, "CHUNK", chunk)
    assert_same_as_by_spans(model_of(bent_patch(0, axes, [20 if degree > 1 else 2 for degree in axes])))


@pytest.mark.parametrize("way", RIGHT_HANDED, ids=str)
@pytest.mark.parametrize("axis", range(3))
def test_stiffness_of_glued_patches_does_not_depend_on_how_they_run(axis, way):
    patch = bent_patch(axis, (1, 2, 2), (2, 2, 2))
    first, second = halves(patch, axis, 0.5)
    assert_same_as_by_spans(glued_model({"body": (first, turned_round(second, *way))}))


@pytest.mark.parametrize("model", MODELS)
def test_what_patches_share_is_added_up(model):
    assert_same_as_by_spans(MODELS[model]())


def test_a_folded_patch_is_refused_with_the_place_of_the_fold():
    points = block_patch(spans=(2, 2, 2)).control_points.copy()
    points[2, 2, 2] = [0.4, 0.4, 0.4]
    patch = replace(block_patch("bad", spans=(2, 2, 2)), control_points=points)
    with pytest.raises(GeometryError, match=r'"bad".*Jacobian -.*xi = \(0\.[5-9]\d*, 0\.[5-9]\d*, 0\.[5-9]\d*\)'):
        stiffness_of(patch)


@pytest.mark.parametrize(("degree", "spans"), [(1, 20), (2, 16), (3, 14)])
def test_assembly_takes_at_most_one_and_a_half_times_the_memory_of_the_matrix(degree, spans):
    space = number_control_points(model_of(block_patch(degree=degree, spans=(spans,) * 3)))
    tracemalloc.start()
    stiffness = assemble_stiffness(space, {"block": STEEL})
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most <= 1.5 * (stiffness.data.nbytes + stiffness.indices.nbytes + stiffness.indptr.nbytes)


@given(bent_patches())
def test_stiffness_is_symmetric_and_rigid_motions_cost_nothing(patch):
    stiffness = stiffness_of(patch)
    assert_symmetric(stiffness)
    assert_rigid_motion_costs_nothing(stiffness, patch.control_points.reshape(-1, 3))


@given(SEEDS)
def test_only_the_six_rigid_motions_cost_nothing(seed):
    values = np.linalg.eigvalsh(stiffness_of(bent_patch(seed, (1, 2, 1), (1, 1, 1))).toarray())
    assert np.abs(values[:6]).max() < 1e-12 * values[-1]
    assert values[6] > 1e-4 * values[-1]


@given(bent_patches(), SEEDS, st.floats(-0.5, 0.45))
def test_a_linear_displacement_has_exactly_the_energy_of_its_uniform_strain(patch, seed, poisson):
    material = Material(200.0, poisson)
    gradient = np.random.default_rng(seed).normal(size=(3, 3))
    displacement = (patch.control_points.reshape(-1, 3) @ gradient.T).ravel()
    strain = (gradient + gradient.T) / 2
    xx, yy, zz, xy, yz, xz = material.stress(gradient[None])[0]
    stress = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    volume = sum(part.volume.sum() for part in volume_quadrature(patch))
    stiffness = stiffness_of(patch, materials={patch.name: material})
    energy = displacement @ (stiffness @ displacement) / 2
    assert energy == pytest.approx(np.sum(stress * strain) * volume / 2, rel=1e-11)


@given(rotations())
def test_stiffness_of_a_turned_body_is_the_turned_stiffness(turn):
    straight, turned = (stiffness_of(block_patch(degree=(2, 1, 1), turn=by)).toarray() for by in (None, turn))
    rotation = block_diag(*[turn.as_matrix()] * (len(straight) // 3))
    np.testing.assert_allclose(turned, rotation @ straight @ rotation.T, rtol=0, atol=1e-12 * straight.max())


def test_each_body_has_its_own_material_and_none_pulls_another():
    first, second = bent_patch(1, name="first"), bent_patch(2, name="second")
    both = stiffness_of(first, second, materials={"first": STEEL, "second": Material(1.0, 0.0)}).toarray()
    alone = [
        stiffness_of(first, materials={"first": STEEL}).toarray(),
        stiffness_of(second, materials={"second": Material(1.0, 0.0)}).toarray(),
    ]
    np.testing.assert_allclose(both, block_diag(*alone), rtol=0, atol=1e-13 * both.max())


def wave(points):
    """A displacement that vanishes on the faces of the unit cube, and its gradient u_i,j."""
    direction = np.array([1.0, -0.5, 2.0])
    sine, cosine = np.sin(np.pi * points), np.pi * np.cos(np.pi * points)
    value = sine.prod(axis=1)
    slope = np.stack([np.prod(np.where(np.arange(3) == j, cosine, sine), axis=1) for j in range(3)], axis=1)
    return value[:, None] * direction, direction[:, None] * slope[:, None, :]


def wave_force(points):
    """Minus the divergence of the stress of the wave: -(lambda + mu) grad div u - mu laplace u."""
    lame, mu = STEEL.lame
    direction = np.array([1.0, -0.5, 2.0])
    sine, cosine = np.sin(np.pi * points), np.cos(np.pi * points)
    second = np.empty((len(points), 3, 3))
    for i in range(3):
        for j in range(3):
            parts = [-sine[:, k] if i == j == k else cosine[:, k] if k in (i, j) else sine[:, k] for k in range(3)]
            second[:, i, j] = np.pi**2 * np.prod(parts, axis=0)
    return -(lame + mu) * second @ direction - mu * np.trace(second, axis1=1, axis2=2)[:, None] * direction


def wave_errors(degree, spans):
    """Errors of the displacement in L2 and of the strain in energy, relative, with all faces held."""
    patch = block_patch(degree=degree, spans=(spans,) * 3)
    space = number_control_points(model_of(patch))
    supports = [
        Support(on=f"block/{side}", ux=0, uy=0, uz=0) for side in ("left", "right", "front", "back", "bottom", "top")
    ]
    allowed = constrain(space, find_conditions(space, supports), supports)
    stiffness = assemble_stiffness(space, {"block": STEEL})
    points = patch.control_points.reshape(-1, 3)
    load = np.zeros((space.size, 3))
    for part in volume_quadrature(patch):
        at = np.einsum("eqa,eak->eqk", part.values, points[part.indices])
        force = wave_force(at.reshape(-1, 3)).reshape(at.shape)
        np.add.at(load, part.indices, np.einsum("eqa,eqk,eq->eak", part.values, force, part.volume, optimize=True))
    matrix = allowed.matrix
    free = solved(direct_solver(), matrix.T @ stiffness @ matrix, matrix.T @ load.ravel())
    displacement = (matrix @ free).reshape(-1, 3)
    squares = np.zeros(4)
    for part in volume_quadrature(patch):
        at, volume = np.einsum("eqa,eak->eqk", part.values, points[part.indices]).reshape(-1, 3), part.volume.ravel()
        value = np.einsum("eqa,eak->eqk", part.values, displacement[part.indices]).reshape(-1, 3)
        slope = np.einsum("eqai,eak->eqki", part.gradients, displacement[part.indices]).reshape(-1, 3, 3)
        exact, exact_slope = wave(at)
        squares += [
            volume @ np.sum((value - exact) ** 2, axis=1),
            volume @ np.sum(exact**2, axis=1),
            volume @ energy_density(slope - exact_slope),
            volume @ energy_density(exact_slope),
        ]
    return np.sqrt(squares[[0, 2]] / squares[[1, 3]])


def energy_density(gradient):
    xx, yy, zz, xy, yz, xz = STEEL.stress(gradient).T
    stress = np.moveaxis(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), 2, 0)
    return np.sum(stress * gradient, axis=(1, 2)) / 2


@pytest.mark.parametrize(("degree", "spans"), [(1, (6, 12)), (2, (4, 8)), (3, (4, 8))])
def test_a_smooth_solution_is_approached_with_order_p_plus_1_in_displacement_and_p_in_energy(degree, spans):
    with one_blas_thread():
        errors = np.array([wave_errors(degree, count) for count in spans])
    sizes = [1 / count for count in spans]
    assert_order(errors[:, 0], sizes, degree + 1, tolerance=0.3)  # the finest meshes are still coarse
    assert_order(errors[:, 1], sizes, degree)
