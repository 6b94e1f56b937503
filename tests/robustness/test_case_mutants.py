"""A small sample of what case_mutants runs by the thousand."""

import pytest

from tests.robustness.attempt import attempted
from tests.robustness.mutation import Mutant, mutant


def assert_clean(mutants):
    """Assert of mutants, by their numbers, that each ends as a command should."""
    endings = {number: attempted(case) for number, case in mutants.items()}
    assert {number: ending for number, ending in endings.items() if ending.wrong} == {}


@pytest.mark.parametrize("first", [0, *(pytest.param(first, marks=pytest.mark.slow) for first in (10, 20, 30))])
def test_a_case_file_that_is_nearly_right_is_checked_with_one_message_and_no_file_left(first, quiet_log):
    assert_clean({number: mutant(number)._replace(flags=("-q", "-n")) for number in range(first, first + 10)})


def test_a_case_file_that_is_still_right_leaves_whole_files(quiet_log):
    ending = attempted(mutant(19))
    assert (ending.code, ending.wrong) == (0, ())


@pytest.mark.slow
@pytest.mark.parametrize("first", range(40, 140, 20))
def test_a_case_file_that_is_nearly_right_ends_with_one_message_and_whole_files(first, quiet_log):
    assert_clean({number: mutant(number) for number in range(first, first + 20)})


def test_a_mutant_is_repeated_by_its_number():
    assert [mutant(number) for number in range(20)] == [mutant(number) for number in range(20)]


def test_an_unclean_end_is_told(quiet_log, monkeypatch):
    def broken(arguments):
        print("Traceback (most recent call last):\n  \x1b")
        return 1

    monkeypatch.setattr("tests.robustness.attempt.main", broken)
    wrong = " ".join(attempted(Mutant(b"", ("-q",))).wrong)
    assert all(word in wrong for word in ("exit 1", "traceback", "do not print", "one message"))
