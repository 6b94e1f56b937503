"""Iterations for bodies of several patches: bounded in the number of patches and of their spans."""

import numpy as np
import pytest

from solve.case import Support
from solve.constraints import constrain, find_conditions
from solve.elasticity import assemble_stiffness
from solve.inverse import Inverse
from solve.material import Material
from solve.space import number_control_points
from tests.cases import block_patch, model_of
from tests.verification.glued_bodies import glued_model, star, wall

STEEL = Material(200.0, 0.3)
CLAMPED = Support(on="body/bottom", ux=0, uy=0, uz=0)


def bar(patches, spans, degree=2):
    """A bar of cubes upon each other."""
    return glued_model(
        {"body": wall("b", (0, 0, 0), (1, 1, patches), degree, ((spans,), (spans,), (spans,) * patches))}
    )


def iterations(model, supports=(CLAMPED,), tolerance=1e-4):
    """How many conjugate gradients take for random forces."""
    space = number_control_points(model)
    allowed = constrain(space, find_conditions(space, supports), supports).matrix
    stiffness = assemble_stiffness(space, dict.fromkeys(model.bodies, STEEL))
    inverse = Inverse(space, dict.fromkeys(model.bodies, STEEL), (allowed @ allowed.T).tocsr(), ())

    def conditioned(force):
        return allowed.T @ inverse.displacements(inverse.modes(allowed @ force)).astype(float)

    residual = np.random.default_rng(0).normal(size=allowed.shape[1])
    direction = conditioned(residual)
    power = first = residual @ direction
    for count in range(200):
        if power <= tolerance**2 * first:
            return count
        pushed = allowed.T @ (stiffness @ (allowed @ direction))
        residual = residual - power / (direction @ pushed) * pushed
        better = conditioned(residual)
        before, power = power, residual @ better
        direction = better + power / before * direction
    return 200


def test_they_do_not_grow_with_the_length_of_a_chain_of_patches():
    assert iterations(bar(12, 2)) <= iterations(bar(4, 2)) + 2


def test_they_hardly_grow_with_the_spans_of_a_patch():
    assert iterations(bar(2, 6)) <= iterations(bar(2, 2)) + 5


def test_eight_cubes_take_hardly_more_of_them_than_one():
    one = model_of(block_patch("body", degree=2, spans=(4, 4, 4)))
    eight = glued_model({"body": wall("b", degree=2, spans=((2, 2),) * 3)})
    assert iterations(eight) <= iterations(one) + 3


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_extraordinary_edges_and_flat_patches_do_not_matter_much(degree):
    assert iterations(glued_model({"body": star("s", 5, degree=degree, spans=(3, 3, 3))})) <= 25
    flat = glued_model({"body": wall("b", size=(2, 2, 0.2), degree=degree, spans=((2, 2), (2, 2), (2, 2)))})
    assert iterations(flat) <= 40


def test_a_body_whose_corners_are_all_held_needs_no_coarse_part():
    supports = (CLAMPED, Support(on="body/top", ux=0, uy=0, uz=0))
    flat = glued_model({"body": wall("b", degree=2, spans=((2, 2), (2, 2), (2,)))})
    assert iterations(flat, supports) <= 25
