import pytest

import solve
from tests.verification.penalty_sweep import all_settings, run

SETTINGS = list(all_settings())
FEW = SETTINGS[7::30]


def check(settings):
    found = run(*settings)
    assert found.status is solve.Status.CONVERGED
    assert found.steps <= 25
    assert found.imbalance < 1e-8


def test_there_are_more_than_300_runs():
    assert len(set(SETTINGS)) == len(SETTINGS) > 300


@pytest.mark.parametrize("settings", FEW, ids=str)
def test_newton_ends_in_few_steps_with_balanced_forces(settings):
    check(settings)


@pytest.mark.slow
@pytest.mark.parametrize("settings", [s for s in SETTINGS if s not in FEW], ids=str)
def test_newton_ends_in_few_steps_with_balanced_forces_whatever_penalty_and_start(settings):
    check(settings)
