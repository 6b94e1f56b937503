from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from solve.case import Augmentation, Newton
from solve.contact.laws import STIFF, Law, penalty_law
from solve.equilibrium import Settings, Start, find_equilibrium
from solve.linear import SuperLU
from solve.newton import Status, minimise
from solve.tangents import Factorised
from tests.cases import contact_system
from tests.strategies import SEEDS

WAYS = ("none", "updated", "solved")
COMPLIANCES = (0.0, 1e-9, 1e-3, 1.0)  # times the largest entry of the stiffness
ASKED = [pair for pair in product(WAYS, COMPLIANCES) if pair[0] != "none" or pair[1] >= 1 / STIFF]
MOST = 6  # gaps, so that all active sets can be tried


def largest_stiffness(system):
    return float(np.abs(system.stiffness.toarray()).max())


def under(system, law):
    """The same problem with the springs of a law."""
    return replace(system, law=law.springs)


def law_of(system, way, compliance=0.0, springs=100.0):
    """A law whose compliance and springs compare with the stiffness as given."""
    scale, ones = largest_stiffness(system), np.ones(len(system.area))
    soft = compliance / scale
    stiffness = 1 / soft if way == "none" else 1 / (soft + 1 / (springs * scale))
    return Law(stiffness * ones, soft * ones, way)


def found_with(system, law, start=None, tangents=None, report=lambda step: None, newton=None, **augmentation):
    system = under(system, law)
    settings = Settings(newton or Newton(), Augmentation(**{"max_steps": 10000, **augmentation}), 1.0)
    tangents = tangents or Factorised(system.tangent, SuperLU())
    return find_equilibrium(system, law, settings, tangents, report, start)


@st.composite
def pressed_systems(draw, floating=None):
    """Problems with fewer gaps than unknowns, so that no overlap need be left, held by supports or by contact alone."""
    free = draw(st.integers(2, 8))
    gaps = draw(st.integers(1, min(free - 1, MOST)))
    held = draw(st.booleans()) if floating is None else not floating
    rigid = 0 if held else draw(st.integers(1, min(3, gaps)))
    system = contact_system(draw(SEEDS), free, gaps, rigid)
    assume(system.holds(np.ones(gaps, dtype=bool)))
    return system


def solution_by_trying_all_sets(system, compliance):
    """Find displacement and pressure that obey p >= 0, g + c p >= 0, p (g + c p) = 0, by trying which gaps press."""
    best = (np.inf, None, None)
    stiffness, operator = system.stiffness.toarray(), system.gap_operator.toarray()
    free, gaps = len(system.load), len(system.area)
    force, length = np.abs(system.load).max(), np.abs(system.initial_gap).max()
    for active in map(list, product([False, True], repeat=gaps)):
        rows = operator[active]
        soft = np.diag((system.area * compliance)[active])
        matrix = np.block([[stiffness, -rows.T], [rows, soft]])
        right = np.concatenate([system.load, -system.initial_gap[active]])
        answer = np.linalg.lstsq(matrix, right, rcond=1e-14)[0]
        unsolved = np.abs(matrix @ answer - right).max()
        pressure = np.zeros(gaps)
        pressure[active] = answer[free:]
        gap = system.control_gaps(answer[:free]) + compliance * pressure
        wrong = max(unsolved, -pressure.min() / force, -gap.min() / length)
        if wrong < best[0]:
            best = (wrong, answer[:free], pressure)
    assert best[0] < 1e-8
    return best[1:]


def assert_close(found, expected, tolerance):
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize(("way", "compliance"), ASKED)
@given(pressed_systems())
def test_every_way_finds_what_trying_all_active_sets_finds(way, compliance, system):
    law = law_of(system, way, compliance)
    found = found_with(system, law)
    assert found.status is Status.CONVERGED
    free, pressure = solution_by_trying_all_sets(system, law.compliance)
    assert_close(found.free, free, 1e-6)
    assert_close(found.pressure, pressure, 1e-6)


@pytest.mark.parametrize("way", ["none", "solved"])
@given(SEEDS, st.integers(2, 4))
def test_more_gaps_than_unknowns_are_no_matter_where_overlap_is_allowed(way, seed, free):
    system = contact_system(seed, free, MOST)
    law = law_of(system, way, 1e-2)
    found = found_with(system, law)
    assert found.status is Status.CONVERGED
    expected = solution_by_trying_all_sets(system, law.compliance)
    assert_close(found.free, expected[0], 1e-6)
    assert_close(found.pressure, expected[1], 1e-6)


@pytest.mark.parametrize(("way", "compliance"), ASKED)
@given(pressed_systems())
def test_pressure_and_overlap_obey_the_law_and_forces_balance(way, compliance, system):
    law = law_of(system, way, compliance)
    found = found_with(system, law)
    gap = system.control_gaps(found.free) + law.compliance * found.pressure
    force, length = found.scale, max(1.0, np.abs(found.free).max())
    assert found.pressure.min() >= -1e-9 * force
    assert gap.min() >= -1e-8 * length
    assert np.abs(found.pressure * gap).max() <= 1e-8 * force * length
    residual = system.load - system.stiffness @ found.free + system.gap_operator.T @ found.pressure
    assert np.abs(residual).max() <= 1e-8 * force


@given(pressed_systems(), st.floats(1.01, 1e9))
def test_a_penalty_too_stiff_for_springs_loses_no_digits(system, times):
    scale = largest_stiffness(system)
    law = penalty_law(times * STIFF * scale, len(system.area), scale)
    found = found_with(system, law)
    free, pressure = solution_by_trying_all_sets(system, law.compliance)
    conditions = np.linalg.cond(system.gap_operator.toarray())
    assert_close(found.free, free, 1e-9 * conditions)
    assert_close(found.pressure, pressure, 1e-9 * conditions**2)


@pytest.mark.parametrize("way", ["updated", "solved"])
@given(pressed_systems(floating=False), st.floats(1, STIFF))
def test_the_springs_that_multipliers_are_found_with_do_not_matter(way, system, springs):
    one, other = (found_with(system, law_of(system, way, springs=s)) for s in (100.0, springs))
    assert one.status is other.status is Status.CONVERGED
    assert_close(other.free, one.free, 1e-6)
    assert_close(other.pressure, one.pressure, 1e-6)


@pytest.mark.parametrize(
    ("seed", "free", "gaps", "compliance", "updates"), [(95, 3, 5, 1e-3, 1), (2864, 3, 6, 0.0, 3), (268, 4, 6, 0.0, 7)]
)
def test_active_sets_that_come_back_give_way_to_updates_of_the_multiplier(seed, free, gaps, compliance, updates):
    system = contact_system(seed, free, gaps)
    law = law_of(system, "solved", compliance)
    found = found_with(system, law)
    assert found.status is Status.CONVERGED
    assert found.history[-1].update == updates
    expected = solution_by_trying_all_sets(system, law.compliance)
    assert_close(found.free, expected[0], 1e-8)
    assert_close(found.pressure, expected[1], 1e-8)


def statically_indeterminate():
    """Three springs on three contacts: each update of a multiplier changes all pressures."""
    return contact_system(5, 6, 3)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_updates_end_when_they_change_the_overlap_no_more(tolerance):
    system = statically_indeterminate()
    found = found_with(system, law_of(system, "updated", springs=1.0), tolerance=tolerance)
    assert found.status is Status.CONVERGED
    assert found.pressure.any()
    overlap = -np.minimum(system.control_gaps(found.free), 0.0)
    assert overlap.max() <= tolerance


def test_a_tighter_tolerance_of_the_overlap_takes_more_updates():
    system = statically_indeterminate()
    law = law_of(system, "updated", springs=1000.0)
    updates = [found_with(system, law, tolerance=t).history[-1].update for t in (1e-2, 1e-4, 1e-9)]
    assert updates == sorted(updates)
    assert updates[0] < updates[-1]


def test_too_few_updates_leave_the_bodies_overlapping():
    system = statically_indeterminate()
    found = found_with(system, law_of(system, "updated", springs=1.0), max_steps=1)
    assert found.status is Status.PENETRATION
    assert {step.update for step in found.history} <= {0, 1}
    overlap = -np.minimum(system.control_gaps(found.free), 0.0)
    assert overlap.max() > 1e-6


def test_too_few_steps_are_no_convergence():
    system = contact_system(3, 8, 6)
    law = law_of(system, "solved")
    assert found_with(system, law).status is Status.CONVERGED
    assert found_with(system, law, newton=Newton(max_steps=1)).status is Status.MAX_STEPS


@pytest.mark.parametrize("way", WAYS)
@given(pressed_systems(floating=False))
def test_from_the_solution_there_is_nothing_left_to_do(way, system):
    law = law_of(system, way, 0.0 if way != "none" else 1e-3)
    tangents = Factorised(under(system, law).tangent, SuperLU())
    rough = Newton(tolerance=1e-9)  # so that the rounding errors of the first solution count as none
    first = found_with(system, law, tangents=tangents, newton=rough)
    before = tangents.factorisations
    again = found_with(system, law, Start(first.free, first.pressure), tangents, newton=rough)
    assert again.status is Status.CONVERGED
    assert len(again.history) <= 1
    assert tangents.factorisations == before
    assert_close(again.free, first.free, 1e-9)
    assert_close(again.pressure, first.pressure, 1e-9)


@pytest.mark.parametrize("way", WAYS)
@given(pressed_systems(floating=False))
def test_from_the_solution_under_the_opposite_loads_it_comes_back(way, system):
    law = law_of(system, way, 0.0 if way != "none" else 1e-3)
    there = found_with(replace(system, load=-system.load), law)
    back = found_with(system, law, Start(there.free, there.pressure))
    cold = found_with(system, law)
    assert back.status is Status.CONVERGED
    assert_close(back.free, cold.free, 1e-6)
    assert_close(back.pressure, cold.pressure, 1e-6)


@pytest.mark.parametrize("way", WAYS)
@given(pressed_systems(floating=False))
def test_far_from_its_contacts_a_body_is_a_linear_spring(way, system):
    far = replace(system, initial_gap=1e6 * (1 + np.abs(system.initial_gap)))
    found = found_with(far, law_of(far, way, 1e-3))
    assert found.status is Status.CONVERGED
    np.testing.assert_array_equal(found.pressure, 0)
    assert_close(found.free, np.linalg.solve(system.stiffness.toarray(), system.load), 1e-9)
    assert {step.update for step in found.history} <= {0}


@pytest.mark.parametrize("way", WAYS)
def test_without_any_contact_a_body_is_a_linear_spring(way):
    system = contact_system(0, 4, 0)
    law = Law(np.empty(0), np.empty(0), way)
    found = found_with(system, law)
    assert found.status is Status.CONVERGED
    assert found.pressure.shape == (0,)
    assert_close(found.free, np.linalg.solve(system.stiffness.toarray(), system.load), 1e-9)


@pytest.mark.parametrize(("way", "compliance"), ASKED)
@given(pressed_systems(), st.sampled_from([2.0**-13, 2.0**13]), st.sampled_from([2.0**-13, 2.0**13]))
def test_units_do_not_matter(way, compliance, system, length, stress):
    """Powers of two change no rounding, so that both take the same way."""
    law = law_of(system, way, compliance)
    changed = replace(
        system,
        stiffness=system.stiffness * stress,
        load=system.load * (stress * length),
        initial_gap=system.initial_gap * length,
    )
    other_law = Law(law.stiffness * stress, law.compliance / stress, way)
    one = found_with(system, law, tolerance=1e-8)
    other = found_with(changed, other_law, tolerance=1e-8 * length)
    assert len(one.history) == len(other.history)
    np.testing.assert_array_equal(other.free, length * one.free)
    np.testing.assert_array_equal(other.pressure, length * stress * one.pressure)


@pytest.mark.parametrize("way", WAYS)
def test_the_history_is_what_was_reported_numbered_from_one(way):
    system, told = contact_system(3, 8, 6), []
    law = law_of(system, way, 1e-3 if way == "none" else 0.0)
    found = found_with(system, law, report=told.append)
    assert tuple(told) == found.history
    assert [step.number for step in found.history] == list(range(1, len(told) + 1))
    assert all(one.update <= two.update for one, two in pairwise(found.history))


def test_a_penalty_is_newton_alone():
    system = contact_system(3, 8, 6)
    law = law_of(system, "none", 1e-3)
    sprung = under(system, law)
    alone = minimise(sprung, Newton(), Factorised(sprung.tangent, SuperLU()))
    found = found_with(system, law)
    np.testing.assert_array_equal(found.free, alone.free)
    np.testing.assert_array_equal(found.pressure, alone.pressure)
