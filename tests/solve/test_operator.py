import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geom2iga.errors import GeometryError
from geom2iga.patch import Patch, elevated, refined
from geom2iga.threads import one_blas_thread
from solve import bricks
from solve.elasticity import assemble_stiffness
from solve.material import Material
from solve.operator import Stiffness
from solve.rules import exact_rules, full_rules, smooth_rules
from solve.space import number_control_points
from tests.cases import bent_patch, block_patch, hollow_cylinder, model_of, moved
from tests.oracles import assert_rigid_motion_costs_nothing
from tests.solve.joined import closed_ring
from tests.strategies import SEEDS, bent_patches, rotations
from tests.verification.glued_bodies import glued_model, halves, star, turned_round, wall

STEEL, RUBBER = Material(200.0, 0.3), Material(0.02, 0.49)


def space_of(*patches):
    return number_control_points(model_of(*patches))


def stiffness_of(space, rules=full_rules, materials=None, **options):
    return Stiffness(space, materials or dict.fromkeys(space.model.bodies, STEEL), rules(space), **options)


def assert_as_assembled(space, rules=exact_rules, materials=None, tolerance=1e-12, **options):
    """The operator does to random displacements what the assembled matrix does."""
    materials = materials or dict.fromkeys(space.model.bodies, STEEL)
    matrix = assemble_stiffness(space, materials)
    operator = stiffness_of(space, rules, materials, **options)
    assert operator.shape == matrix.shape
    for displacement in np.random.default_rng(0).normal(size=(2, space.dofs)):
        expected = matrix @ displacement
        np.testing.assert_allclose(operator @ displacement, expected, rtol=0, atol=tolerance * np.abs(expected).max())


@settings(max_examples=12)
@given(bent_patches(), st.booleans(), st.sampled_from([1, 3, 512]))
def test_on_bent_rational_patches_the_operator_is_the_assembled_matrix(patch, stored, size):
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(bricks, "SPANS", size)  # of a brick
        assert_as_assembled(space_of(patch), stored=stored)


@settings(max_examples=12)
@given(rotations(), st.tuples(*[st.integers(1, 5)] * 3), st.tuples(*[st.integers(1, 3)] * 3), st.booleans())
def test_on_turned_cuboids_of_any_degrees_the_operator_is_the_assembled_matrix(turn, degrees, spans, stored):
    assert_as_assembled(space_of(block_patch(size=(1, 0.1, 3), degree=degrees, spans=spans, turn=turn)), stored=stored)


def weighted(patch, weights):
    return replace(patch, weights=np.broadcast_to(weights, patch.shape))


def with_repeated_knots():
    knots = [[0.3, 0.3, 0.7], [0.5, 0.5, 0.5], [0.2, 0.9, 0.9]]
    return refined(bent_patch(0, (3, 3, 3), (1, 1, 1)), knots=knots)


MODELS = {
    "one span of degree 1": model_of(block_patch()),
    "degree 5": model_of(bent_patch(0, (5, 4, 5), (2, 1, 1))),
    "degrees 1, 3, 2": model_of(bent_patch(1, (1, 3, 2), (3, 2, 4))),
    "quarter of a hollow cylinder": model_of(refined(elevated(hollow_cylinder(), (2, 3, 2)), spans=2)),
    "repeated knots": model_of(with_repeated_knots()),
    "far from the origin": model_of(moved(bent_patch(2), (50.0, -100.0, 20.0))),
    "two halves": glued_model({"body": halves(bent_patch(3), 1, 0.4)}),
    "glued and turned round": glued_model(
        {"body": (halves(bent_patch(3), 0, 0.5)[0], turned_round(halves(bent_patch(3), 0, 0.5)[1], (1, 2, 0), (0, 1)))}
    ),
    "four blocks around an edge": glued_model({"body": wall("b", degree=2, shift=(0.2, -0.1))}),
    "glued to itself": closed_ring(),
    "weights all 2": model_of(weighted(bent_patch(1, rational=False), 2.0)),
    "weights all 2, affine": model_of(weighted(block_patch(degree=2), 2.0)),
    "weights all 2 to rounding, affine": model_of(weighted(block_patch(degree=2), np.linspace(2, 2 + 1e-10, 3))),
    "three blocks around an edge": glued_model({"body": star("s", 3, degree=2)}),
}

NAMES = list(MODELS)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("rules", [full_rules, exact_rules])
def test_the_operator_is_the_assembled_matrix(name, rules):
    assert_as_assembled(number_control_points(MODELS[name]), rules, stored=False)


def test_each_body_has_its_own_material():
    space = space_of(bent_patch(1, name="first"), block_patch("second", degree=2))
    assert_as_assembled(space, materials={"first": STEEL, "second": RUBBER})


@pytest.mark.parametrize("stored", [pytest.param(False, marks=pytest.mark.slow), True])
@pytest.mark.parametrize("name", NAMES)
def test_in_single_precision_it_is_as_exact_as_that_allows(name, stored):
    space = number_control_points(MODELS[name])
    rounded = stiffness_of(space, precision=np.float32, stored=stored)
    assert (rounded @ np.ones(space.dofs, dtype=np.float32)).dtype == rounded.dtype == np.float32
    assert_as_assembled(space, full_rules, tolerance=1e-5, precision=np.float32, stored=stored)


@settings(max_examples=10)
@given(bent_patches(), SEEDS)
def test_with_few_points_it_is_symmetric_and_rigid_motions_cost_nothing(patch, seed):
    space = space_of(patch)
    operator = stiffness_of(space, smooth_rules)
    dense = operator @ np.eye(space.dofs)
    np.testing.assert_allclose(dense, dense.T, rtol=0, atol=1e-12 * np.abs(dense).max())
    assert_rigid_motion_costs_nothing(dense, space.control_points)
    assert np.linalg.eigvalsh(dense)[0] >= -1e-11 * np.abs(dense).max()


@settings(max_examples=8)
@given(st.tuples(*[st.integers(1, 4)] * 3), SEEDS)
def test_with_few_points_only_the_six_rigid_motions_cost_nothing_up_to_degree_4(degrees, seed):
    space = space_of(bent_patch(seed, degrees, (1, 1, 2)))
    energies = np.linalg.eigvalsh(stiffness_of(space, smooth_rules) @ np.eye(space.dofs))
    assert np.count_nonzero(energies < 1e-8 * energies[-1]) == 6


def folded(degree=2, spans=(1, 1, 1)):
    """A cube of which a corner is pushed in until it comes out on the other side."""
    patch = block_patch("folded", degree=degree, spans=spans)
    points = patch.control_points.copy()
    points[-1, -1, -1] -= 3
    return Patch("folded", patch.degrees, patch.knots, points)


@pytest.mark.parametrize("stored", [False, True])
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_folded_patch_is_refused_as_assembly_refuses_it(degree, stored):
    space = space_of(folded(degree))
    with pytest.raises(GeometryError) as refused:
        assemble_stiffness(space, {"folded": STEEL})
    with pytest.raises(GeometryError, match=re.escape(str(refused.value))):
        stiffness_of(space, stored=stored) @ np.zeros(space.dofs)


@pytest.mark.parametrize("stored", [False, True])
def test_any_number_of_threads_gives_the_same_bits(monkeypatch, stored):
    space = space_of(bent_patch(0, spans=(3, 4, 3)), block_patch("other", degree=3, spans=(4, 4, 4)))
    displacement, found = np.random.default_rng(0).normal(size=space.dofs), []
    monkeypatch.setattr(bricks, "SPANS", 8)
    with one_blas_thread():
        for threads in (1, 2, 5):
            monkeypatch.setenv("OMP_NUM_THREADS", str(threads))
            found.append((stiffness_of(space, stored=stored) @ displacement).tobytes())
    assert len(set(found)) == 1


def test_several_displacements_are_taken_at_once():
    space = space_of(bent_patch(0))
    operator = stiffness_of(space)
    both = np.random.default_rng(0).normal(size=(space.dofs, 2))
    np.testing.assert_array_equal(operator @ both, np.stack([operator @ one for one in both.T], axis=1))
