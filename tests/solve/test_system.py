import numpy as np
import pytest
from hypothesis import given
from scipy.sparse import csr_array

from solve.constraints import AffineMap
from solve.contact.laws import Penalty
from solve.contact.mortar import Mortar
from solve.system import System, reduced_system
from tests.oracles import assert_symmetric, assert_tangent
from tests.strategies import SEEDS, contact_systems


def anywhere(system, seed=0):
    """A random point where no control gap vanishes to rounding."""
    return np.random.default_rng(seed).normal(size=len(system.load))


@given(contact_systems(), SEEDS)
def test_the_residual_is_minus_the_gradient_of_the_energy(system, seed):
    at = anywhere(system, seed)
    assert_tangent(system.energy, -system.residual(at), at, tolerance=1e-5)


@given(contact_systems(), SEEDS)
def test_the_tangent_is_minus_the_derivative_of_the_residual(system, seed):
    at = anywhere(system, seed)
    active = system.control_gaps(at) <= 0
    tangent = system.tangent(active).toarray()
    assert_tangent(lambda free: -system.residual(free), tangent, at, tolerance=1e-5)
    assert_symmetric(tangent)


@given(contact_systems(), SEEDS)
def test_the_energy_is_convex(system, seed):
    one, other = np.random.default_rng(seed).normal(size=(2, len(system.load)))
    ends = (system.energy(one) + system.energy(other)) / 2
    assert system.energy((one + other) / 2) <= ends + 1e-12 * (1 + abs(ends))


@given(contact_systems(), SEEDS)
def test_open_gaps_leave_the_elastic_energy_alone(system, seed):
    at = anywhere(system, seed)
    far = System(
        system.stiffness,
        system.load,
        system.gap_operator,
        np.full(len(system.area), 1e3),
        system.area,
        system.law,
        system.rigid,
    )
    assert far.energy(at) == pytest.approx(at @ system.stiffness @ at / 2 - system.load @ at, rel=1e-12)
    np.testing.assert_array_equal(far.contact_forces(far.control_gaps(at)), 0)


@given(contact_systems(), SEEDS)
def test_the_force_scale_is_the_largest_entry_of_any_kind_of_force(system, seed):
    at = anywhere(system, seed)
    contact = system.gap_operator.T @ system.law.pressure(system.control_gaps(at))
    assert system.force_scale(at) == max(np.abs(f).max() for f in (system.load, system.stiffness @ at, contact))


@given(SEEDS)
def test_the_reduced_problem_has_the_energy_and_the_forces_of_the_whole_one(seed):
    random = np.random.default_rng(seed)
    dofs, free, gaps = 9, 5, 4
    factor = random.normal(size=(dofs, dofs))
    stiffness, load = csr_array(factor @ factor.T), random.normal(size=dofs)
    area, law = random.uniform(0.5, 2, gaps), Penalty(random.uniform(1, 10, gaps))
    operator = csr_array(random.normal(size=(gaps, dofs)))
    mortar = Mortar(np.arange(gaps), operator, random.normal(size=gaps), area, np.zeros((gaps, 3)))
    allowed = AffineMap(csr_array(np.linalg.qr(random.normal(size=(dofs, free)))[0]), random.normal(size=dofs))
    rigid = random.normal(size=(dofs, 1))
    whole = System(stiffness, load, operator, mortar.initial_gap, area, law, rigid)
    reduced = reduced_system(stiffness, load, mortar, law, allowed, rigid)
    one, other = random.normal(size=(2, free))
    of = [allowed.matrix @ at + allowed.offset for at in (one, other)]
    np.testing.assert_allclose(reduced.control_gaps(one), whole.control_gaps(of[0]), rtol=0, atol=1e-12)
    difference = whole.energy(of[0]) - whole.energy(of[1])
    assert reduced.energy(one) - reduced.energy(other) == pytest.approx(difference, rel=1e-9, abs=1e-9)
    np.testing.assert_allclose(reduced.residual(one), allowed.matrix.T @ whole.residual(of[0]), rtol=0, atol=1e-10)


@given(contact_systems(floating=True), SEEDS)
def test_pressed_control_points_hold_a_floating_body_if_every_motion_of_it_changes_one_of_their_gaps(system, seed):
    active = np.random.default_rng(seed).random(len(system.area)) < 0.5
    rates = (system.gap_operator[active] @ system.rigid) / system.area[active, None]
    assert system.holds(active) == (np.linalg.matrix_rank(rates, tol=1e-6) == system.rigid.shape[1])


@given(contact_systems(floating=True), SEEDS)
def test_loose_motions_are_the_rigid_ones_that_change_no_gap_of_the_pressed_control_points(system, seed):
    active = np.random.default_rng(seed).random(len(system.area)) < 0.3
    loose = system.loose(active)
    np.testing.assert_allclose(loose.T @ loose, np.eye(loose.shape[1]), rtol=0, atol=1e-12)
    np.testing.assert_allclose(system.rigid @ (system.rigid.T @ loose), loose, rtol=0, atol=1e-9)
    np.testing.assert_allclose(system.gap_operator[active] @ loose, 0, rtol=0, atol=1e-8)
    assert (loose.shape[1] == 0) == system.holds(active)


@given(contact_systems())
def test_a_supported_body_needs_no_contact_to_be_held(system):
    assert system.holds(np.zeros(len(system.area), dtype=bool))
