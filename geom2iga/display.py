"""How models, patches and results show themselves, as text and as tables in notebooks."""

from collections.abc import Iterable, Sequence
from html import escape
from itertools import islice

import numpy as np

from geom2iga.bspline import Array

MOST = 12  # names and lines that are shown of many


def shortened(names: Iterable[object], separator: str = ", ") -> str:
    """Write names in a row, and of many only the first.

    >>> shortened("abc"), shortened(range(100))
    ('a, b, c', '0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, ...')
    """
    names = iter(names)
    shown = [str(name) for name in islice(names, MOST)]
    return separator.join([*shown, *["..."][: len(list(islice(names, 1)))]])


def counted(count: int, one: str, several: str) -> str:
    """Count things in words.

    >>> counted(1, "body", "bodies"), counted(2, "body", "bodies")
    ('1 body', '2 bodies')
    """
    return f"{count} {one if count == 1 else several}"


def boxed(points: Array) -> str:
    """Say how many control points (..., 3) there are, and how large the box around them is.

    >>> boxed(np.array([[0.0, 0, 0], [1, 2, 0.5]]))
    '2 control points in a box of 1 x 2 x 0.5'
    """
    points = points.reshape(-1, 3)
    edges = np.ptp(points, axis=0) if len(points) else np.zeros(3)
    return f"{len(points)} control points in a box of {' x '.join(f'{edge:.4g}' for edge in edges)}"


def html_table(caption: str, head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Make a table of HTML; what it says may hold any characters.

    >>> html_table("All", ["name"], [["<b>"]])
    '<table><caption>All</caption><tr><th>name</th></tr><tr><td>&lt;b&gt;</td></tr></table>'
    """
    lines = [("th", head), *(("td", row) for row in rows)]
    body = "".join(f"<tr>{''.join(f'<{tag}>{escape(str(cell))}</{tag}>' for cell in line)}</tr>" for tag, line in lines)
    return f"<table><caption>{escape(caption)}</caption>{body}</table>"
