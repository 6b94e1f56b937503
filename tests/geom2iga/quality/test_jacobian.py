from dataclasses import replace
from fractions import Fraction
from itertools import pairwise, product
from math import prod

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geom2iga.bspline import open_knots
from geom2iga.patch import Patch, elevated, evaluate, reversed_along
from geom2iga.quality import bernstein
from geom2iga.quality.jacobian import prove_jacobian
from tests.cases import bent_patch, block_patch, hollow_cylinder, moved, turned
from tests.strategies import SEEDS, bent_patches, rotations


def sampled(patch, count=7):
    """The Jacobian on a grid that holds every knot."""
    axes = [np.unique(np.concatenate([np.linspace(*ends, count) for ends in pairwise(at)])) for at in patch.breaks]
    return np.linalg.det(evaluate(patch, np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3), 1)[1])


def least_around(patch, xi):
    """The smallest Jacobian just beside a point: on a knot it may differ from side to side."""
    spans = np.array([at[-1] - at[0] for at in patch.breaks])
    around = np.array(xi) + 1e-13 * spans * np.array(list(product((-1, 1), repeat=3)))
    return np.linalg.det(evaluate(patch, around, 1)[1]).min()


def polynomial(degrees, function):
    """A patch over the unit cube that equals a polynomial map of no higher degrees."""
    axes = [np.linspace(0, 1, degree + 1) for degree in degrees]
    points = np.stack(function(*np.meshgrid(*axes, indexing="ij")), axis=-1)
    for axis, (degree, at) in enumerate(zip(degrees, axes, strict=True)):
        points = bernstein.along(np.linalg.inv(bernstein.values(degree, at)[0]), points, axis)
    return Patch("polynomial", degrees, [open_knots([0, 1], degree) for degree in degrees], points)


def squeezed(least):
    """det J = (u + 0.37 v - 0.21 w - 0.611)² + least: smallest on an oblique plane."""
    return polynomial((3, 3, 3), lambda u, v, w: ((u + 0.37 * v - 0.21 * w - 0.611) ** 3 / 3 + least * u, v, w))


def exact_at_corner(patch, u, v, w):
    """The Jacobian of a patch of degree one at a corner, by fractions."""
    lines = [(slice(None), v, w), (u, slice(None), w), (u, v, slice(None))]
    ends = [patch.control_points[line] for line in lines]
    (a, b, c), (d, e, f), (g, h, i) = ([Fraction(y) - Fraction(x) for x, y in zip(*end, strict=True)] for end in ends)
    shares = [Fraction(patch.weights[line][1 - side]) for line, side in zip(lines, (u, v, w), strict=True)]
    factor = prod(shares) / Fraction(patch.weights[u, v, w]) ** 3
    return factor * (a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))


def wedge():
    """A cube one of whose edges is collapsed into a point."""
    points = block_patch().control_points.copy()
    points[1, :, 1] = points[1, :, 0]
    return replace(block_patch("wedge"), control_points=points)


@given(bent_patches())
def test_the_jacobian_of_a_bent_patch_is_proven_by_a_sharp_bound(patch):
    found, least = prove_jacobian(patch), sampled(patch).min()
    assert found.status == "proven"
    assert 0.5 * found.sampled_minimum <= found.bound <= min(least, found.sampled_minimum)
    assert found.sampled_minimum == pytest.approx(least_around(patch, found.xi), rel=1e-11)


@given(SEEDS, st.sampled_from([(1, 1, 1), (2, 2, 2), (3, 2, 1)]), st.floats(0.3, 2.0), st.booleans())
def test_no_sample_contradicts_what_is_found_of_a_shaken_patch(seed, degrees, reach, rational):
    random = np.random.default_rng(seed)
    patch = block_patch(degree=degrees, spans=(2, 1, 2))
    reach = reach / np.array(patch.shape)
    points = patch.control_points + reach * random.uniform(-1, 1, patch.control_points.shape)
    patch = replace(patch, control_points=points, weights=random.uniform(0.5, 2, patch.shape) if rational else None)
    found, least = prove_jacobian(patch), sampled(patch).min()
    if found.status == "proven":
        assert 0 < found.bound <= least
    else:
        assert found.bound is None
    if least < -1e-9:
        assert found.status in ("folded", "left-handed")
    assert (found.status in ("folded", "left-handed")) == (found.sampled_minimum < -1e-11)
    assert least_around(patch, found.xi) == pytest.approx(found.sampled_minimum, rel=1e-10, abs=1e-10)


@given(SEEDS, st.booleans())
def test_rounding_lifts_no_bound_above_the_exact_jacobian(seed, rational):
    random = np.random.default_rng(seed)
    block = turned(block_patch(size=10 ** random.uniform(-3, 0, 3)), Rotation.random(random_state=random))
    weights = random.uniform(0.8, 1.25, block.shape) if rational else None
    patch = replace(moved(block, 10 ** random.uniform(-2, 2, 3)), weights=weights)
    least = min(exact_at_corner(patch, *corner) for corner in product((0, 1), repeat=3))
    found = prove_jacobian(patch)
    assert found.bound <= least
    if not rational:
        assert found.bound == pytest.approx(float(least), rel=1e-9)


@given(st.integers(1, 4), rotations())
def test_the_bound_of_a_block_is_its_jacobian(degree, turn):
    found = prove_jacobian(block_patch(size=(2, 1.5, 1), degree=degree, turn=turn))
    assert found.bound == pytest.approx(3, rel=1e-12)
    assert found.relative_bound == pytest.approx(1, rel=1e-12)
    assert found.message.startswith("det J >= 3 proven, 1 of its mean")


@pytest.mark.parametrize("scale", [1e-6, 0.3, 1e6])
def test_the_share_of_the_mean_has_no_scale(scale):
    patch = bent_patch(0)
    larger = replace(patch, control_points=scale * patch.control_points)
    stretched = replace(larger, knots=[scale * knots for knots in patch.knots])
    expected = prove_jacobian(patch)
    for other in (larger, stretched):
        found = prove_jacobian(other)
        assert found.relative_bound == pytest.approx(expected.relative_bound, rel=1e-10)
        assert found.relative_minimum == pytest.approx(expected.relative_minimum, rel=1e-10)


def test_the_jacobian_of_a_ring_is_least_inside():
    found = prove_jacobian(hollow_cylinder(1, 2, 3))
    assert found.status == "proven"
    assert found.sampled_minimum == pytest.approx(sampled(hollow_cylinder(1, 2, 3), 50).min(), rel=1e-12)
    assert found.x[0] ** 2 + found.x[1] ** 2 == pytest.approx(1)


@pytest.mark.parametrize("rational", [False, True])
def test_a_control_point_pushed_through_the_far_side_folds_the_patch(rational):
    patch = bent_patch(5, (2, 2, 2), (1, 1, 1), rational=rational)
    points = patch.control_points.copy()
    points[0, 1, 1] += 8 * (points[2, 1, 1] - points[0, 1, 1])
    folded = replace(patch, control_points=points)
    found = prove_jacobian(folded)
    assert (found.status, found.bound) == ("folded", None)
    assert found.message.startswith(f"folded: det J = {found.sampled_minimum:.3g}, ")
    assert found.x == pytest.approx(evaluate(folded, [found.xi])[0][0])


def test_a_fold_between_the_samples_is_found_by_halving():
    patch = squeezed(-1e-6)
    assert sampled(patch).min() > 0
    found = prove_jacobian(patch)
    assert found.status == "folded"
    assert found.sampled_minimum == pytest.approx(-1e-6, rel=0.9)
    assert least_around(patch, found.xi) == pytest.approx(found.sampled_minimum, rel=1e-6)


def test_a_left_handed_patch_is_told_from_a_folded_one():
    found = prove_jacobian(reversed_along(bent_patch(3), 1))
    assert (found.status, found.bound) == ("left-handed", None)
    assert found.message.endswith("; reverse one direction")


@pytest.mark.parametrize("noise", [0.0, 1e-14])
@pytest.mark.parametrize("degree", [1, 3])
def test_a_collapsed_edge_is_degenerate_there(noise, degree):
    patch = moved(elevated(wedge(), (degree,) * 3), (5, 5, 5))
    points = patch.control_points + noise * np.random.default_rng(0).normal(size=patch.control_points.shape)
    found = prove_jacobian(replace(patch, control_points=points))
    assert (found.status, found.bound) == ("degenerate", None)
    assert found.xi[0] == 1
    assert found.message.startswith("degenerate: det J = 0 at xi = (1, ")


@pytest.mark.parametrize("flat", [(1, 1, 0), (0, 0, 0)])
def test_a_patch_without_volume_is_degenerate(flat):
    found = prove_jacobian(block_patch(size=flat))
    assert found.status == "degenerate"
    assert np.isnan(found.relative_minimum)


def test_a_jacobian_that_touches_zero_inside_is_not_proven():
    found = prove_jacobian(squeezed(0.0))
    assert found.status in ("not proven", "degenerate")
    nearly = prove_jacobian(squeezed(1e-9))
    assert (nearly.status, nearly.bound) == ("not proven", None)
    assert nearly.message.startswith("positivity not proven: sampled minimum det J = ")


def test_halving_proves_what_the_coefficients_alone_do_not():
    patch = squeezed(1e-3)
    assert prove_jacobian(patch, budget=0).status == "not proven"
    found = prove_jacobian(patch)
    assert found.status == "proven"
    assert 0.5 * found.sampled_minimum <= found.bound <= 1e-3
    sharper = prove_jacobian(patch, sharpness=0.95)
    assert 0.95 * sharper.sampled_minimum <= sharper.bound <= 1e-3
