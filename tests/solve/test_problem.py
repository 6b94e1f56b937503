"""Passes of a contact: which side is secondary, with which law."""

import numpy as np
import pytest

import geom2iga
from geom2iga.errors import CaseError
from solve.case import Solve
from solve.problem import prepare
from tests.cases import block_patch, model_of, patch_test_case

SCALE = 1000.0 * 4  # E/h of spans of a quarter


def problem_of(degree=2, **contact):
    case = patch_test_case(degree, lower_spans=(4, 4, 1), upper_spans=(4, 4, 1))
    case["solve"]["contact"] = [{"secondary": "upper/bottom", "primary": "lower/top", **contact}]
    return prepare(geom2iga.build(case), Solve.model_validate(case["solve"]))


def test_one_pass_has_the_sides_of_the_case():
    (only,) = problem_of().passes
    assert (only.number, only.definition.secondary, only.definition.primary) == (0, "upper/bottom", "lower/top")
    assert only.penalty == pytest.approx(10 * SCALE, rel=1e-12)


def test_the_second_pass_has_the_sides_exchanged_and_each_half_the_stiffness():
    one, other = problem_of(two_pass=True).passes
    assert one.number == other.number == 0
    assert (one.definition.secondary, one.definition.primary) == ("upper/bottom", "lower/top")
    assert (other.definition.secondary, other.definition.primary) == ("lower/top", "upper/bottom")
    assert one.penalty == pytest.approx(5 * SCALE, rel=1e-12)
    assert other.penalty == one.penalty  # of the smallest span on either side
    np.testing.assert_allclose([part.mortar.area.sum() for part in (one, other)], 1.0, rtol=1e-12)


def test_gaps_and_laws_of_all_passes_stand_one_after_the_other():
    problem = problem_of(two_pass=True)
    counts = [len(part.mortar.area) for part in problem.passes]
    assert len(problem.mortar.area) == len(problem.law.stiffness) == sum(counts)
    expected = np.repeat([part.penalty for part in problem.passes], counts)
    np.testing.assert_allclose(problem.law.stiffness, expected, rtol=1e-14)
    assert problem.mortar.centres.shape == (sum(counts), 3)


def test_a_lagrange_multiplier_has_no_finite_penalty():
    (only,) = problem_of(enforcement="lagrange").passes
    assert only.penalty == np.inf
    np.testing.assert_array_equal(only.law.compliance, 0)


def test_the_size_is_that_of_the_smallest_body():
    assert problem_of().size == pytest.approx(3**0.5, rel=1e-12)


def test_a_pressure_space_that_does_not_exist_is_named_with_its_contact():
    with pytest.raises(CaseError, match=r'solve.contact\[0\]: multiplier = "p-2" needs degree 2'):
        problem_of(degree=1, multiplier="p-2")


def test_without_contact_there_is_nothing_to_stack():
    support = {"on": "block/bottom", "ux": 0.0, "uy": 0.0, "uz": 0.0}
    tables = {"material": [{"young": 1.0, "poisson": 0.0}], "support": [support]}
    problem = prepare(model_of(block_patch()), Solve.model_validate(tables))
    assert problem.passes == ()
    assert problem.mortar.area.shape == problem.law.stiffness.shape == (0,)
