from dataclasses import replace
from math import pi, radians, sin

import numpy as np
import pytest
from hypothesis import given

from geom2iga.bspline import open_knots
from geom2iga.patch import Patch, reversed_along
from geom2iga.quality.volume import enclosed_volume, volume
from tests.cases import bent_patch, block_patch, hollow_cylinder, moved
from tests.strategies import bent_patches


def spherical_sector(angle):
    """Between the spheres of radius 1 and 2, both longitude and latitude within half the angle: rational in both."""
    half = angle / 2
    radius, height = np.array([np.cos(half), 1 / np.cos(half), np.cos(half)]), np.array([-1, 0, 1]) * np.sin(half)
    weights = np.array([1, np.cos(half), 1])
    along = np.stack(np.broadcast_arrays(radius[:, None] * radius, height[:, None] * radius, height), axis=-1)
    points = np.array([along, 2 * along])
    knots = (open_knots([0, 1], 1), open_knots([0, 1], 2), open_knots([0, 1], 2))
    return Patch("sector", (1, 2, 2), knots, points, np.broadcast_to(weights[:, None] * weights, (2, 3, 3)))


@pytest.mark.parametrize("degrees", [90, 120, 150])
def test_the_volume_of_a_spherical_sector_is_exact(degrees):
    angle = radians(degrees)
    sector = spherical_sector(angle)
    expected = 7 / 3 * angle * 2 * sin(angle / 2)
    assert volume(sector) == pytest.approx(expected, rel=1e-13)
    assert enclosed_volume(sector) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("find", [volume, enclosed_volume])
def test_the_volumes_of_a_block_and_of_a_quarter_ring_are_exact(find):
    assert find(block_patch(size=(2, 3, 0.5), degree=3, spans=(2, 1, 3))) == pytest.approx(3, rel=1e-14)
    assert find(hollow_cylinder(1, 2, 5)) == pytest.approx(pi * 3 / 4 * 5, rel=1e-14)


@given(bent_patches())
def test_the_volume_inside_is_the_volume_enclosed(patch):
    assert volume(patch) == pytest.approx(enclosed_volume(patch), rel=1e-12)


def test_the_volume_does_not_change_with_the_distance_from_the_origin():
    patch = bent_patch(1)
    far = moved(patch, (1e6, -1e6, 0))
    back = moved(far, (-1e6, 1e6, 0))  # what rounding left of it
    assert volume(far) == pytest.approx(volume(back), rel=1e-13)
    assert enclosed_volume(far) == pytest.approx(volume(back), rel=1e-13)


def test_a_left_handed_patch_has_a_negative_volume():
    patch = reversed_along(bent_patch(2), 1)
    assert volume(patch) < 0
    assert enclosed_volume(patch) == pytest.approx(volume(patch), rel=1e-12)


def test_a_common_factor_of_the_weights_does_not_matter():
    ring = hollow_cylinder()
    assert volume(replace(ring, weights=7 * ring.weights)) == pytest.approx(pi * 3 / 4, rel=1e-14)
