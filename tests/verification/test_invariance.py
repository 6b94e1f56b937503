"""The answer does not depend on where a problem lies, its units, its numbering and its parameters."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geom2iga.patch import refined
from solve import Result
from tests.strategies import SEEDS
from tests.verification.invariance import (
    CHANGES,
    Change,
    Setting,
    blocks,
    dome,
    glued,
    iteratively,
    largest_difference,
    observed,
    rings,
    solved,
    three_steps,
    with_patches,
)

SAME = 1e-9

QUICK: dict[str, Callable[[], Setting]] = {
    "blocks": blocks,
    "multiplier": lambda: blocks(enforcement="lagrange"),
    "augmented": lambda: blocks(enforcement="augmented-lagrange"),
    "points": lambda: blocks(method="kts"),
    "two passes": lambda: blocks(two_pass=True),
    "lower multiplier": lambda: blocks(multiplier="p-2"),
    "conjugate gradients": lambda: iteratively(blocks()),
    "paraboloid in steps": lambda: three_steps(dome("paraboloid")),
    "rings": rings,
    "rings, spans": lambda: rings(integration="element"),
}
THOROUGH = QUICK | {
    "cylinder": lambda: dome("cylinder"),
    "cylinder, two passes": lambda: dome("cylinder", two_pass=True),
    "cylinder, conjugate gradients": lambda: iteratively(dome("cylinder", enforcement="lagrange")),
    "paraboloid, augmented": lambda: three_steps(dome("paraboloid", enforcement="augmented-lagrange")),
    "paraboloid, spans": lambda: dome("paraboloid", integration="element", method="kts"),
    "sphere, multiplier": lambda: dome("sphere", enforcement="lagrange"),
    "rings, multiplier": lambda: rings(enforcement="lagrange"),
    "rings, lower multiplier": lambda: rings(enforcement="lagrange", multiplier="p-2"),
    "glued": glued,
    "glued, two passes, conjugate gradients": lambda: iteratively(glued(two_pass=True, integration="element")),
}


@cache
def original(name: str) -> tuple[Setting, Result]:
    """A setting and its answer."""
    setting = THOROUGH[name]()
    return setting, solved(setting)


def assert_unchanged(name: str, changes: list[Change], seed: int) -> None:
    """Some changes, one after the other, leave all that is seen of the answer as it is."""
    setting, result = original(name)
    changed, random = setting, np.random.default_rng(seed)
    for change in changes:
        changed = change(changed, random)
    found = observed(solved(changed), changed, setting)
    difference, where = largest_difference(found, observed(result, setting, setting))
    assert difference < SAME, where


def some_changes() -> st.SearchStrategy[list[Change]]:
    """One to four changes."""
    return st.lists(st.sampled_from(CHANGES), min_size=1, max_size=4)


@settings(max_examples=8)
@given(st.sampled_from(sorted(QUICK)), some_changes(), SEEDS)
def test_results_do_not_depend_on_place_direction_units_numbering_and_parameters(name, changes, seed):
    assert_unchanged(name, changes, seed)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(THOROUGH))
@settings(max_examples=20)
@given(changes=some_changes(), seed=SEEDS)
def test_no_results_depend_on_place_direction_units_numbering_and_parameters(name, changes, seed):
    assert_unchanged(name, changes, seed)


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
def test_a_change_changes_the_problem(change):
    setting, _ = original("blocks")
    changed = change(setting, np.random.default_rng(1))
    before, after = ([*s.model.patches.values(), repr(s.table), [*s.model.groups]] for s in (setting, changed))
    assert any(
        one != other if isinstance(one, str | list) else _differ(one, other)
        for one, other in zip(before, after, strict=True)
    )


def _differ(one, other) -> bool:
    same = one.name == other.name and one.shape == other.shape and np.array_equal(one.weights, other.weights)
    same = same and np.array_equal(one.control_points, other.control_points)
    return not (same and all(map(np.array_equal, one.knots, other.knots)))


@pytest.mark.parametrize("name", ["rings", pytest.param("blocks", marks=pytest.mark.slow)])
@settings(max_examples=2)
@given(seed=SEEDS)
def test_results_do_not_depend_on_the_sequence_in_which_knots_are_inserted(name, seed):
    setting, _ = original(name)
    random = np.random.default_rng(seed)
    new = [(int(random.integers(3)), float(random.uniform(0.05, 0.95))) for _ in range(3)]

    def inserted(sequence):
        return lambda patch: refined_one_by_one(patch, [new[k] for k in sequence])

    first, other = (with_patches(setting, inserted(s)) for s in (range(3), random.permutation(3)))
    seen = observed(solved(first), first, setting)
    difference, where = largest_difference(observed(solved(other), other, setting), seen)
    assert difference < SAME, where


def refined_one_by_one(patch, new):
    """Insert knots, a direction and a place each, one after the other."""
    for direction, place in new:
        patch = refined(patch, knots=[[place] if d == direction else [] for d in range(3)])
    return patch


@pytest.mark.parametrize("name", ["two passes", pytest.param("cylinder, two passes", marks=pytest.mark.slow)])
def test_exchanging_the_sides_changes_nothing_where_both_are_secondary_in_turn(name):
    setting, result = original(name)
    found = observed(solved(exchanged(setting)), setting, setting)
    expected = observed(result, setting, setting)
    difference, where = largest_difference(found, expected)
    assert difference < SAME, where


def exchanged(setting: Setting) -> Setting:
    """Make the secondary sides of all contacts primary, and the other way round."""
    contacts = [c | {"secondary": c["primary"], "primary": c["secondary"]} for c in setting.table["contact"]]
    return replace(setting, table={**setting.table, "contact": contacts})
