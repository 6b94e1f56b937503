import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array, diags_array, random_array

from solve.linear import Pardiso, SingularMatrixError, SuperLU, direct_solver
from tests.cases import solved
from tests.strategies import SEEDS

SOLVERS = [SuperLU, Pardiso]


def positive_definite(seed, size):
    sparse = random_array((size, size), density=0.3, rng=np.random.default_rng(seed))
    return csr_array(sparse @ sparse.T + diags_array(np.full(size, 0.5)))


@pytest.fixture(scope="module")
def solvers():
    return [kind() for kind in SOLVERS]


@given(seed=SEEDS, size=st.integers(1, 40))
def test_both_solvers_solve_and_agree(solvers, seed, size):
    matrix, exact = positive_definite(seed, size), np.random.default_rng(seed).normal(size=size)
    for solver in solvers:
        np.testing.assert_allclose(solved(solver, matrix, matrix @ exact), exact, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", SOLVERS)
def test_a_solver_takes_one_matrix_after_another_and_several_right_hand_sides(kind):
    solver = kind()
    for seed in range(3):
        matrix = positive_definite(seed, 10 + seed)
        solver.factorise(matrix)
        for exact in np.random.default_rng(seed).normal(size=(2, 10 + seed)):
            np.testing.assert_allclose(solver.solve(matrix @ exact), exact, rtol=0, atol=1e-12)


class Careless:
    """A solver whose factors are 1 % off."""

    name = "careless"

    def factorise(self, matrix):
        self._inverse = np.linalg.inv(matrix.toarray()) * 1.01

    def solve(self, right):
        return self._inverse @ right


def test_two_refinements_square_the_error_of_the_factors_and_more():
    matrix = positive_definite(0, 20)
    exact = np.random.default_rng(0).normal(size=20)
    error = np.linalg.norm(solved(Careless(), matrix, matrix @ exact) - exact) / np.linalg.norm(exact)
    assert error == pytest.approx(0.01**3, rel=1e-6)


@pytest.mark.parametrize("kind", SOLVERS)
def test_a_singular_matrix_is_refused(kind):
    matrix = csr_array(np.diag([1.0, 2, 0, 3]))
    with pytest.raises(SingularMatrixError):
        solved(kind(), matrix, np.ones(4))


def test_pardiso_refuses_an_indefinite_matrix():
    with pytest.raises(SingularMatrixError):
        solved(Pardiso(), csr_array(np.array([[1.0, 2], [2, 1]])), np.ones(2))


class Lost(Careless):
    """A solver that divides by zero without noticing."""

    def solve(self, right):
        return np.full(len(right), np.nan)


def test_a_solution_that_is_no_number_is_refused():
    with pytest.raises(SingularMatrixError):
        solved(Lost(), csr_array(np.eye(2)), np.ones(2))


@pytest.mark.parametrize("kind", SOLVERS)
def test_nothing_to_solve_for_is_solved(kind):
    assert solved(kind(), csr_array((0, 0)), np.empty(0)).shape == (0,)


def test_the_solver_is_pardiso_where_it_is_installed_and_can_be_named():
    assert direct_solver().name == "pardiso"
    assert direct_solver("superlu").name == "superlu"


def test_superlu_takes_over_where_pardiso_is_missing(monkeypatch):
    monkeypatch.setattr("solve.linear.find_spec", lambda name: None)
    assert direct_solver().name == "superlu"
