from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar, nnls
from scipy.sparse import csr_array

from solve.case import Newton
from solve.contact.laws import Penalty
from solve.linear import SuperLU
from solve.newton import RECENT, Status, minimise
from solve.system import System
from solve.tangents import Factorised
from tests.cases import contact_system, exact_step_along
from tests.strategies import SEEDS, contact_systems


def solved_with(system, **settings):
    return minimise(system, Newton(**settings), Factorised(system.tangent, SuperLU()))


def solution_by_complementarity(system):
    """Find the minimiser from the contact pressures alone.

    With p = -eps min(g, 0), the overlaps obey A (g + p / eps) = M p + q >= 0, p >= 0, p (M p + q) = 0, where
    M = G K^-1 G' + A / eps and q = G K^-1 f + g0: the optimality conditions of a nonnegative least squares problem.
    """
    stiffness, operator = system.stiffness.toarray(), system.gap_operator.toarray()
    compliance = operator @ np.linalg.solve(stiffness, operator.T) + np.diag(system.area / system.law.stiffness)
    offset = operator @ np.linalg.solve(stiffness, system.load) + system.initial_gap
    factor = np.linalg.cholesky(compliance)
    pressure, _ = nnls(factor.T, -np.linalg.solve(factor, offset))
    return np.linalg.solve(stiffness, system.load + operator.T @ pressure), pressure


@given(contact_systems())
def test_newton_finds_what_an_independent_solver_finds(system):
    found = solved_with(system)
    free, pressure = solution_by_complementarity(system)
    assert found.status is Status.CONVERGED
    np.testing.assert_allclose(found.free, free, rtol=0, atol=1e-7 * (1 + np.abs(free).max()))
    of_found = system.law.pressure(system.control_gaps(found.free))
    np.testing.assert_allclose(of_found, pressure, rtol=0, atol=1e-7 * found.scale)


@given(contact_systems())
def test_the_iteration_ends_in_few_steps_at_the_least_energy_of_all(system):
    found = solved_with(system)
    energies = [system.energy(np.zeros(len(system.load)))] + [step.energy for step in found.history]
    scale = max(1.0, np.abs(energies).max())
    assert found.status is Status.CONVERGED
    assert energies[-1] <= min(energies) + 1e-12 * scale
    assert len(found.history) <= 2 * len(system.area) + 2


def test_full_steps_that_come_back_to_an_active_set_give_way_to_an_exact_one():
    random = np.random.default_rng(18)
    factor = random.normal(size=(2, 2))
    stiffness, load = csr_array(factor @ factor.T + 0.01 * np.eye(2)), 10 * random.normal(size=2)
    operator, gap = csr_array(random.normal(size=(4, 2))), random.normal(size=4)
    system = System(stiffness, load, operator, gap, np.ones(4), Penalty(np.full(4, 1e4)), np.empty((2, 0)))
    found = solved_with(system)
    assert any(step.length != 1 for step in found.history)
    assert found.status is Status.CONVERGED


@given(contact_systems(floating=True))
@example(contact_system(seed=13, free=4, contacts=4, rigid_motions=3))  # its residual rises before contact holds it
@example(contact_system(seed=14, free=4, contacts=4, rigid_motions=3))  # it rolls far before the next gap closes
def test_a_body_that_contact_alone_holds_comes_to_rest_in_few_steps(system):
    found = solved_with(system)
    assert found.status is Status.CONVERGED
    assert len(found.history) <= 2 * len(system.area) + 2
    assert np.abs(system.residual(found.free)).max() <= 1e-8 * found.scale
    after_the_first = [step.energy for step in found.history[1:]] or [found.history[-1].energy]
    assert after_the_first[-1] <= min(after_the_first) + 1e-9 * (1 + np.abs(after_the_first).max())
    reaction = system.rigid.T @ system.contact_forces(system.control_gaps(found.free))
    np.testing.assert_allclose(reaction, -system.rigid.T @ system.load, rtol=0, atol=1e-7 * found.scale)


@given(contact_systems(floating=True), st.sampled_from([2.0**-13, 2.0**13]), st.sampled_from([2.0**-13, 2.0**13]))
@example(contact_system(seed=14, free=4, contacts=4, rigid_motions=3), 2.0**13, 2.0**-13)
def test_units_do_not_matter(system, length, stress):
    """Powers of two change no rounding, so that both take the same way."""
    changed = replace(
        system,
        stiffness=system.stiffness * stress,
        load=system.load * (stress * length),
        initial_gap=system.initial_gap * length,
        law=Penalty(system.law.stiffness * stress),
    )
    one, other = solved_with(system), solved_with(changed)
    assert len(one.history) == len(other.history)
    np.testing.assert_array_equal(other.free, length * one.free)


@given(contact_systems(), SEEDS)
def test_the_line_search_finds_the_least_energy_along_a_line(system, seed):
    random = np.random.default_rng(seed)
    free = random.normal(size=len(system.load))
    direction = system.residual(free) * random.uniform(0.1, 3) + random.normal(size=len(free)) * random.choice([0, 1])
    length = exact_step_along(system, free, direction)
    slope = -system.residual(free + length * direction) @ direction
    steepness = np.linalg.norm(direction) * system.force_scale(free + length * direction)
    assert length >= 0
    if length > 0:
        assert abs(slope) <= 1e-9 * steepness
    else:
        assert slope >= -1e-9 * steepness
    numeric = minimize_scalar(
        lambda t: system.energy(free + t * direction), bounds=(0, 2 * length + 1), method="bounded"
    )
    assert system.energy(free + length * direction) <= numeric.fun + 1e-9 * (1 + abs(numeric.fun))


@given(SEEDS, st.floats(0.1, 10))
def test_the_line_search_is_infinite_along_a_line_without_end(seed, force):
    system = particle(load=force)
    free = np.random.default_rng(seed).normal(size=1)
    assert exact_step_along(system, free, np.array([1.0])) == np.inf
    assert np.isfinite(exact_step_along(system, free, np.array([-1.0])))


def particle(load, gap=0.0, stiffness=0.0, penalty=1e5, rigid=True):
    """One unknown above one contact: positive is away from it."""
    return System(
        csr_array([[stiffness]]),
        np.array([load]),
        csr_array([[1.0]]),
        np.array([gap]),
        np.array([1.0]),
        Penalty(np.array([penalty])),
        np.ones((1, 1)) if rigid else np.empty((1, 0)),
    )


@pytest.mark.parametrize("gap", [0.0, 0.5, -0.5, 1e3])
def test_a_particle_falls_onto_its_contact_from_anywhere(gap):
    found = solved_with(particle(load=-2.0, gap=gap))
    assert found.status is Status.CONVERGED
    assert found.free[0] == pytest.approx(-gap - 2.0 / 1e5, rel=1e-9)
    assert len(found.history) <= 2


def test_without_load_nothing_moves():
    found = solved_with(particle(load=0.0, gap=0.5))
    assert found.status is Status.CONVERGED
    assert found.free[0] == 0
    assert not found.history


def test_a_particle_that_is_pulled_off_is_unbounded():
    assert solved_with(particle(load=2.0)).status is Status.UNBOUNDED


@given(SEEDS, st.floats(1e-3, 1e3))
def test_a_body_that_is_pulled_off_is_unbounded_whatever_rounding_leaves_of_its_stiffness(seed, size):
    system = contact_system(seed, free=6, contacts=1, rigid_motions=1)
    rigid = system.rigid[:, 0]
    opening = rigid * np.sign((system.gap_operator @ rigid)[0])
    pulled = replace(system, load=system.load - rigid * (rigid @ system.load) + size * opening)
    found = solved_with(pulled)
    assert found.status is Status.UNBOUNDED
    assert len(found.history) <= 3
    np.testing.assert_allclose(found.drift / np.linalg.norm(found.drift), opening, rtol=0, atol=1e-9)


def test_what_is_recent_are_the_last_active_sets_of_as_many_steps_as_matter():
    system = several_steps_needed()
    found = solved_with(system)
    assert len(found.recent) == min(RECENT, len(found.history) + 1)
    changes = [np.count_nonzero(one != other) for one, other in pairwise(found.recent)]
    assert changes == [step.changes for step in found.history][-len(changes) :]


def test_a_particle_that_nothing_holds_is_singular():
    system = particle(load=2.0, gap=1.0, rigid=False)
    assert solved_with(replace(system, gap_operator=csr_array([[0.0]]))).status is Status.SINGULAR


def test_a_particle_that_falls_so_far_that_rounding_outweighs_its_load_is_inaccurate():
    assert solved_with(particle(load=-1.0, gap=1e10)).status is Status.INACCURATE


def several_steps_needed():
    """Springs of very different stiffness above a contact each, so that one opens when another closes."""
    random = np.random.default_rng(4)
    factor = random.normal(size=(8, 8))
    return System(
        csr_array(factor @ factor.T + 0.01 * np.eye(8)),
        10 * random.normal(size=8),
        csr_array(random.normal(size=(12, 8))),
        random.normal(size=12),
        np.ones(12),
        Penalty(np.full(12, 1e4)),
        np.empty((8, 0)),
    )


def test_too_few_steps_are_no_convergence():
    system = several_steps_needed()
    whole = solved_with(system)
    assert whole.status is Status.CONVERGED
    assert len(whole.history) > 2
    cut = solved_with(system, max_steps=len(whole.history) - 1)
    assert cut.status is Status.MAX_STEPS
    assert len(cut.history) == len(whole.history) - 1
    assert solved_with(system, max_steps=len(whole.history)).status is Status.CONVERGED


def test_the_history_tells_what_each_step_did():
    system = several_steps_needed()
    told = []
    found = minimise(system, Newton(), Factorised(system.tangent, SuperLU()), told.append)
    assert tuple(told) == found.history
    assert [step.number for step in found.history] == list(range(1, len(found.history) + 1))
    last = found.history[-1]
    assert last.active == np.count_nonzero(system.control_gaps(found.free) <= 0)
    assert last.energy == system.energy(found.free)
    assert last.changes == 0
    assert last.residual == np.abs(system.residual(found.free)).max() / system.force_scale(found.free) <= 1e-10


@pytest.mark.parametrize("status", Status)
def test_every_status_but_success_says_what_to_do(status):
    assert (": " in status.value) == (status is not Status.CONVERGED)
