import logging

import pytest

import geom2iga
import solve
from geom2iga import limits
from geom2iga.errors import CaseError
from geom2iga.tables import checked
from solve import memory
from solve.case import SolveCase
from solve.linear import Pardiso, SuperLU, direct_solver
from solve.problem import prepare
from tests.cases import patch_test_case


def case_of(spans, method="auto", degree=2):
    case = patch_test_case(degree, (spans,) * 3, (spans - 1,) * 3, penalty="auto")
    case["solve"]["linear"] = {"method": method}
    return case


def problem_of(case):
    return prepare(geom2iga.build(case), checked(case, SolveCase).solve)


@pytest.mark.parametrize(("spans", "way"), [(4, "pardiso"), (10, "conjugate gradients")])
def test_small_problems_are_factorised_large_ones_iterated(spans, way):
    case = case_of(spans)
    assert solve.solve(geom2iga.build(case), case).statistics["linear_solver"] == way


@pytest.mark.parametrize(("method", "way"), [("direct", "pardiso"), ("iterative", "conjugate gradients")])
def test_the_case_may_choose(method, way):
    case = case_of(4, method)
    assert solve.solve(geom2iga.build(case), case).statistics["linear_solver"] == way


def test_iterations_need_less_memory_than_factors_and_superlu_more_than_pardiso():
    problem = problem_of(case_of(8))
    assert memory.needed(problem, None) < memory.needed(problem, Pardiso()) < memory.needed(problem, SuperLU())


def test_the_memory_of_factors_grows_faster_than_the_unknowns_that_of_iterations_does_not():
    small, large = problem_of(case_of(6)), problem_of(case_of(12))
    unknowns = large.allowed.size / small.allowed.size
    assert memory.needed(large, Pardiso()) / memory.needed(small, Pardiso()) > 1.2 * unknowns
    assert memory.needed(large, None) / memory.needed(small, None) < 1.2 * unknowns


@pytest.mark.parametrize("method", ["direct", "iterative"])
def test_what_cannot_fit_ends_with_a_sentence_before_it_is_tried(method, monkeypatch):
    case = case_of(6, method)
    problem = problem_of(case)
    free = 0.9 * memory.needed(problem, None if method == "iterative" else direct_solver())
    monkeypatch.setattr(limits, "group_memory", lambda: free)
    with pytest.raises(
        CaseError, match=rf"unknowns need about .* GB of memory, {free / 1e9:.2g} GB are free: take fewer spans"
    ) as error:
        solve.solve(problem.space.model, case)
    assert ("iterative" in str(error.value)) == (method == "direct")


def test_where_conjugate_gradients_fail_factors_take_over_and_say_so(monkeypatch, caplog):
    monkeypatch.setattr("solve.iterative.MOST_ITERATIONS", 3)
    monkeypatch.setattr(memory, "FEW", 0)
    case = case_of(4)
    with caplog.at_level(logging.INFO, "geom2iga"):
        result = solve.solve(geom2iga.build(case), case)
    assert result.status is solve.Status.CONVERGED
    assert result.statistics["linear_solver"] == "pardiso"
    assert "conjugate gradients failed" in caplog.text


def test_asked_for_they_fail_with_advice(monkeypatch):
    monkeypatch.setattr("solve.iterative.MOST_ITERATIONS", 3)
    case = case_of(4, "iterative")
    result = solve.solve(geom2iga.build(case), case)
    assert result.status is solve.Status.SLOW
    assert 'solve.linear.method = "direct"' in result.status.value
