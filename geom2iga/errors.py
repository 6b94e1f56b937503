"""What can go wrong on the user's side; each kind has its exit code."""

from collections.abc import Iterable
from difflib import get_close_matches


class UserError(Exception):
    """An error that its message explains to the user: where, what was found, what to do."""

    exit_code = 2


class CaseError(UserError):
    """The command or the case file is wrong."""


class GeometryError(UserError):
    """The geometry cannot become blocks."""

    exit_code = 3


class NotConvergedError(UserError):
    """The solver did not reach equilibrium."""

    exit_code = 4


class VerificationError(UserError):
    """A [[verify]] entry was missed."""

    exit_code = 5


def suggestion(name: str, known: Iterable[str]) -> str:
    """Say what a misspelt name could have been.

    >>> suggestion("lower/tap", ["lower/top", "upper/top"])
    'did you mean "lower/top"? Known: lower/top, upper/top'
    """
    known = list(known)
    close = get_close_matches(name, known, 1)
    guess = f'did you mean "{close[0]}"? ' if close else ""
    return f"{guess}Known: {', '.join(known) or 'none'}"
