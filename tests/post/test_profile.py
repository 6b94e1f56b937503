from math import inf

import numpy as np
import pytest

from geom2iga.tables import Units
from post.exact import HertzSpheres
from post.plots import Curve, draw_profile
from post.profile import Profile, pressure_profile

EXACT = HertzSpheres(0.6, (10.0, inf), (1000.0, 1000.0), (0.3, 0.3))


def sampled(factor=1.0, stretch=1.0):
    """The closed form, higher and wider by factors, at shuffled distances."""
    distance = np.random.default_rng(0).permutation(np.linspace(0, 2 * EXACT.reach, 4001))
    return Profile(distance, factor * EXACT.pressure(distance / stretch))


def test_the_closed_form_itself_has_no_error():
    assert list(sampled().errors(EXACT).values()) == pytest.approx([0, 0, 0], abs=1e-3)


def test_a_higher_and_wider_profile_is_told_from_the_closed_form():
    errors = sampled(1.1, 1.2).errors(EXACT)
    assert list(errors.values()) == pytest.approx([0.1, 0.1, 0.2], abs=1e-3)


def test_a_profile_is_cut_off_at_a_distance():
    near = sampled().within(EXACT.reach)
    assert near.distance.max() == pytest.approx(EXACT.reach, rel=1e-3)
    assert len(near.pressure) == len(near.distance) < 4001


def test_a_profile_is_drawn_as_points_on_the_curve():
    figure = draw_profile([Curve("computed", *sampled())], EXACT.pressure, Units(length="mm", force="N"))
    (axes,) = figure.axes
    curve, points = axes.lines
    assert len(points.get_xdata()) == 4001
    np.testing.assert_allclose(curve.get_ydata(), EXACT.pressure(curve.get_xdata()))
    assert axes.get_xlabel() == "distance from the middle of contact [mm]"
    assert axes.get_ylabel() == "contact pressure $p$ [N/mm²]"


def test_the_profile_of_the_patch_test_is_flat(patch_test):
    profile = pressure_profile(patch_test, lambda points: points[:, 0] - 1.0)
    assert (profile.distance.min(), profile.distance.max()) == pytest.approx((-0.5, 0.5))
    assert profile.pressure == pytest.approx(np.ones(len(profile.pressure)), abs=1e-10)
