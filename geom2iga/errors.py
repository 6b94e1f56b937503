"""What can go wrong on the user's side; each kind has its exit code."""

from collections.abc import Iterable
from difflib import get_close_matches

LONGEST = 1500  # characters of a message
MOST_NAMES = 40  # that are listed


def one_line(text: str) -> str:
    r"""Write a text that may hold anything on one line of bounded length, what does not print as in Python.

    >>> one_line("a\nb\x1bc")
    'a b\\x1bc'
    """
    text = " ".join(text[: 10 * LONGEST].splitlines())
    text = "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in text)
    return text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} ... {text[5 - LONGEST // 2 :]}"


def shown(value: object, most: int = 80) -> str:
    """Write a value as Python does, of a long one only the beginning.

    >>> shown("abc"), shown([1] * 100, 20)
    ("'abc'", '[1, 1, 1, 1, 1,  ...')
    """
    text = repr(value)
    return text if len(text) <= most else f"{text[: most - 4]} ..."


class UserError(Exception):
    """An error that its message explains to the user: where, what was found, what to do; in one line."""

    exit_code = 2

    def __init__(self, message: str = "") -> None:
        super().__init__(one_line(message))


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
    more = f", ... {len(known)} in all" if len(known) > MOST_NAMES else ""
    return f"{guess}Known: {', '.join(known[:MOST_NAMES]) or 'none'}{more}"
