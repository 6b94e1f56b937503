"""The closed forms give the known answers, and obey the laws that they come from."""

from math import inf, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from post.exact import HertzCylinders, HertzSpheres, NestedShells, Shell, StackedBlocks

POSITIVE = st.floats(0.1, 10)
PAIRS = st.tuples(POSITIVE, POSITIVE)
RATIOS = st.tuples(st.floats(0, 0.49), st.floats(0, 0.49))
DIMENSIONS = st.sampled_from([2, 3])


def shells(dimension=3, inside=0.0, outside=0.0):
    inner = Shell(20.0, 30.0, 2000.0, 0.3, inside=inside, dimension=dimension)
    return inner, Shell(30.0, 40.0, 2000.0, 0.3, outside=outside, dimension=dimension)


def test_equal_cylinders_are_those_of_the_literature():
    pair = HertzCylinders(10.0, (8.0, 8.0), (200.0, 200.0), (0.3, 0.3))
    assert pair.reach == pytest.approx(0.68078, abs=5e-6)
    assert pair.largest_pressure == pytest.approx(9.35135, abs=5e-6)


def test_unequal_spheres_are_those_of_kratos():
    pair = HertzSpheres(117808.787, (6.1237, 6.1237), (1e8, 1e6), (0.29, 0.29))
    assert pair.reach == pytest.approx(0.63018, abs=5e-6)
    assert pair.largest_pressure == pytest.approx(1.41642e5, rel=5e-6)


def test_a_sphere_on_a_rigid_plane_is_that_of_the_literature():
    pair = HertzSpheres(60 * pi, (8.0, inf), (1000.0, inf), (0.3, 0.0))
    assert pair.reach == pytest.approx(1.00964, abs=5e-6)
    assert pair.largest_pressure == pytest.approx(88.290, abs=5e-4)


@given(POSITIVE, PAIRS, PAIRS, RATIOS)
def test_hertz_pressure_adds_up_to_the_force(force, radii, young, poisson):
    spheres = HertzSpheres(force, radii, young, poisson)
    total = quad(lambda r: 2 * pi * r * float(spheres.pressure(r)), 0, spheres.reach)[0]
    assert total == pytest.approx(force, rel=1e-6)
    cylinders = HertzCylinders(force, radii, young, poisson)
    total = quad(lambda x: 2 * float(cylinders.pressure(x)), 0, cylinders.reach)[0]
    assert total == pytest.approx(force, rel=1e-6)


@given(POSITIVE, PAIRS, PAIRS, RATIOS)
def test_the_force_does_the_work_of_the_elastic_energy_as_spheres_approach(force, radii, young, poisson):
    """Hertz: force ~ approach^(3/2), F = 4/3 E* √R δ^(3/2)."""
    pair = HertzSpheres(force, radii, young, poisson)
    assert 4 / 3 * pair.modulus * pair.radius**0.5 * pair.approach**1.5 == pytest.approx(force, rel=1e-12)


def test_no_pressure_is_outside_the_circle():
    pair = HertzSpheres(1.0, (1.0, inf), (1.0, 1.0), (0.3, 0.3))
    assert pair.pressure([0.0, pair.reach, 2 * pair.reach]) == pytest.approx([pair.largest_pressure, 0, 0], abs=1e-7)


@pytest.mark.parametrize(("inside", "outside", "pressure"), [(25.0, 0.0, 4.8942), (0.0, 25.0, 20.1058)])
def test_hollow_spheres_of_one_material_press_as_one_sphere_would(inside, outside, pressure):
    pair = NestedShells(*shells(3, inside, outside))
    assert pair.pressure == pytest.approx(pressure, abs=5e-5)
    whole = Shell(20.0, 40.0, 2000.0, 0.3, inside, outside)
    for shell in pair.loaded:
        radius = np.linspace(shell.inner, shell.outer, 5)
        assert shell.displacement(radius) == pytest.approx(whole.displacement(radius), rel=1e-12)
        assert shell.hoop_stress(radius) == pytest.approx(whole.hoop_stress(radius), rel=1e-12)


@given(DIMENSIONS, POSITIVE, st.floats(1.1, 3), POSITIVE, st.floats(0, 0.49), POSITIVE, POSITIVE)
def test_a_shell_obeys_equilibrium_hooke_and_its_pressures(dimension, inner, ratio, young, poisson, inside, outside):
    shell = Shell(inner, ratio * inner, young, poisson, inside, outside, dimension)
    assert shell.radial_stress([shell.inner, shell.outer]) == pytest.approx([-inside, -outside], rel=1e-9)
    r, h = inner * (1 + ratio) / 2, 1e-5 * inner
    slope = (shell.radial_stress(r + h) - shell.radial_stress(r - h)) / (2 * h)
    radial, hoop = shell.radial_stress(r), shell.hoop_stress(r)
    size = (inside + outside) / inner
    assert slope + (dimension - 1) * (radial - hoop) / r == pytest.approx(0, abs=1e-6 * size / (ratio - 1) ** 2)
    other = hoop if dimension == 3 else poisson * (radial + hoop)  # along the third direction
    strain = (hoop - poisson * (radial + other)) / young
    assert shell.displacement(r) / r == pytest.approx(strain, abs=1e-9 * (inside + outside) / young / (ratio - 1))


@given(DIMENSIONS, st.floats(1e2, 1e6), st.floats(0, 0.01))
def test_nested_shells_overlap_by_the_pressure_over_the_penalty(dimension, penalty, interference):
    pair = NestedShells(*shells(dimension, outside=25.0), penalty, interference)
    inner, outer = pair.loaded
    overlap = interference - (outer.displacement(30.0) - inner.displacement(30.0))
    assert overlap * penalty == pytest.approx(pair.pressure, rel=1e-6)
    assert inner.radial_stress(30.0) == pytest.approx(outer.radial_stress(30.0), rel=1e-9)


def test_the_extruded_taylor_test_settles_in_plane_strain():
    exact = StackedBlocks(10.0, 1000.0, (5.0, 2.0), poisson=0.4)
    assert exact.settlement == pytest.approx((-0.042, -0.042, -0.0588), rel=1e-12)
    assert exact.stress == pytest.approx([0, -4, -10, 0, 0, 0])


def test_each_block_of_a_stack_settles_on_what_is_below():
    exact = StackedBlocks(1.0, (1000.0, 500.0, 250.0), (1.0, 2.0, 3.0), penalty=1e4)
    assert exact.settlement == pytest.approx((-0.001, -0.0011, -0.0051, -0.0052, -0.0172), rel=1e-12)
