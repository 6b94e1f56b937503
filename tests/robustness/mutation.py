"""Case files that are nearly right: valid ones with values, keys, tables, characters or bytes changed at random."""

import copy
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import tomlkit

from tests.robustness.cad_parts import FILES

SEEDS = (*sorted((Path(__file__).parent / "seeds").glob("*.toml")),)
EVERY_TABLE = Path(__file__).parents[2] / "examples/guide/docs/reference/every-table.toml"
TALL = 300  # powers of ten
WORDS = (
    *("", "x", "lower", "upper/bottom", "uper/bottom", "łower/tøp", "a" * 5000, "../../etc/passwd", "/", "\u202e"),
    *("lower/\n", "auto", "true", "mortr", "\x1b[31mred", "bar", "bar/top", "upper", "lower/top", "dome/bottom"),
)
NUMBERS = (
    *(True, False, 0, 1, -1, 7, 2**31, 2**63 - 1, -(2**63), 10**30, 10**400, 0.0, -0.0, 1.5, -1.5, 5e-324, 1e-300),
    *(1e-30, 1e30, 1e150, 1e300, float("nan"), float("inf"), float("-inf")),
)
LISTS = (
    *([], [1], [1.0, 2.0], [0.0] * 3, [1, 2, 3, 4], [[0.0, 1.0]] * 3, [[]], ["x"], {}, {"a": 1}, [{}], [{"name": "x"}]),
    *([1e-8] * 3, [1e8] * 3, ["png", "pdf"], [0] * 500, [[[[[[1]]]]]]),
)
EXTRA: dict[str, tuple[Any, ...]] = {  # keys of a case file, with values that they or others take
    "spans": (3, [1, 2, 3], [9, 1, 1]),
    "degree": (0, 1, 3, 4, 9, 20, [1, 2, 3]),
    "method": ("kts", "direct", "iterative"),
    "enforcement": ("lagrange", "augmented-lagrange"),
    "cad": tuple([{"file": file}] for file in (*FILES, "/etc/passwd", "/dev/zero", "case.toml", ".", "none.step")),
    "import": tuple([{"name": "more", "file": file}] for file in (*FILES, "/dev/zero", "case.toml", ".")),
    "file": (
        *FILES,
        "/etc/passwd",
        "/dev/zero",
        "/dev/null",
        "case.toml",
        "case.out/geometry.h5",
        ".",
        "..",
        "x" * 5000,
    ),
    "multiplier": ("p-2",),
    "two_pass": (True,),
    "exposed": (True,),
    "pictures": ([{"name": "x", "field": "ux"}], True),
    "factors": ([0.5, 1.0], [], [1.0, 0.0, -1.0], [1e30], [0.0]),
    "faces": ([{"name": "new", "z": 1.0}], [{"name": "new", "normal": [0, 0, 1]}], [{"name": "new", "sphere": 1.0}]),
    "rotate": ({"axis": [1.0, 1e20, 3.0], "angle": 7.0}, {"angle": 1e20}, {"angle": 45.0}),
    "grading": ({"toward": "top", "ratio": 3.0}, {"toward": "tap", "ratio": 1e6}, [{"toward": "top", "ratio": 1e30}]),
    "body": ("lower", "lowe"),
    "near": ([0.0, 0.0, 0.0], [1e20, 0.0, 0.0]),
    **{
        key: WORDS + NUMBERS
        for key in ("span_size", "young", "poisson", "on", "samples", "deformation", "angle", "bodies")
    },
    **{key: NUMBERS + LISTS for key in ("radius", "normal", "traction", "knots", "breaks", "reach", "points", "tags")},
}
PIECES = ("é", " ", "/", "x", "\t", "", "😀", "\\", '"', "_", "aa", "\x00")

Place = tuple[str | int, ...]


class Mutant(NamedTuple):
    """A case file and the flags that the command gets."""

    content: bytes
    flags: tuple[str, ...]


@cache
def _seed(path: Path) -> Any:
    return tomlkit.parse(path.read_text(encoding="utf-8")).unwrap()


def mutant(number: int) -> Mutant:
    """Make the mutant of a number: always the same."""
    random = Random(number)
    case = copy.deepcopy(_seed(EVERY_TABLE if number % 8 == 0 else random.choice(SEEDS)))
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        places = list(_places(case))
        if places:
            random.choice(CHANGES)(random, case, places)
    text = tomlkit.dumps(case)
    content = random.choice(TEXT_CHANGES)(random, text.encode()) if number % 7 == 0 else text.encode()
    return Mutant(content, random.choice((("-q",), ("-q",), ("-q",), ("-q", "-n"), ())))


def _places(table: Any, at: Place = ()) -> Iterator[Place]:
    """Yield the paths of keys and numbers that lead to all values of a case."""
    for key, value in table.items() if isinstance(table, dict) else enumerate(table):
        yield (*at, key)
        if isinstance(value, dict | list):
            yield from _places(value, (*at, key))


def _held(case: Any, place: Place) -> Any:
    for key in place:
        case = case[key]
    return case


def _left_out(random: Random, case: Any, places: list[Place]) -> None:
    place = random.choice(places)
    del _held(case, place[:-1])[place[-1]]


def _replaced(random: Random, case: Any, places: list[Place]) -> None:
    place = random.choice(places)
    _held(case, place[:-1])[place[-1]] = copy.deepcopy(random.choice(random.choice((WORDS, NUMBERS, LISTS))))


def _scaled(random: Random, case: Any, places: list[Place]) -> None:
    """Change the sign and the magnitude of a number."""
    numeric = [place for place in places if type(_held(case, place)) in (int, float)]
    if not numeric:
        return
    place = random.choice(numeric)
    value, sign = _held(case, place), random.choice((1, 1, 1, -1))
    if isinstance(value, int):
        changed: Any = sign * random.choice((0, value + 1, value * 10, value * 100, 10 ** random.randrange(18)))
    else:
        powers = (random.uniform(-3, 3), random.uniform(-20, 20), random.uniform(-TALL, TALL))
        changed = sign * (value or 1.0) * 10.0 ** random.choice(powers)
    _held(case, place[:-1])[place[-1]] = changed


def _far_apart(random: Random, case: Any, places: list[Place]) -> None:
    """Change the magnitudes of many numbers at once."""
    top = random.choice((3, 10, 25))
    for place in places:
        if type(_held(case, place)) is float and random.random() < 0.3:
            _held(case, place[:-1])[place[-1]] *= 10.0 ** random.uniform(-top, top)


def _misspelt(random: Random, case: Any, places: list[Place]) -> None:
    place = random.choice([place for place in places if isinstance(place[-1], str)] or [("",)])
    table, name = _held(case, place[:-1]), str(place[-1])
    if name in table:
        table[_respelt(random, name)] = table.pop(name)


def _misnamed(random: Random, case: Any, places: list[Place]) -> None:
    texts = [place for place in places if isinstance(_held(case, place), str)]
    if texts:
        place = random.choice(texts)
        _held(case, place[:-1])[place[-1]] = _respelt(random, _held(case, place))


def _respelt(random: Random, word: str) -> str:
    at = random.randrange(len(word) + 1)
    return word[:at] + random.choice(PIECES) + word[at + random.randrange(2) :]


def _doubled(random: Random, case: Any, places: list[Place]) -> None:
    """Repeat an entry of a list, or all of them."""
    place = random.choice(places)
    where, value = _held(case, place[:-1]), _held(case, place)
    if isinstance(where, list):
        where.insert(random.randrange(len(where) + 1), copy.deepcopy(value))
    elif isinstance(value, list):
        where[place[-1]] = copy.deepcopy(value * random.choice((2, 3, 50)))


def _exchanged(random: Random, case: Any, places: list[Place]) -> None:
    """Put a value, or a whole table, in the place of another."""
    place, other = random.choice(places), random.choice(places)
    _held(case, place[:-1])[place[-1]] = copy.deepcopy(_held(case, other))


def _shuffled(random: Random, case: Any, places: list[Place]) -> None:
    lists = [place for place in places if isinstance(_held(case, place), list)]
    if lists:
        random.shuffle(_held(case, random.choice(lists)))


def _added(random: Random, case: Any, places: list[Place]) -> None:
    tables = [place for place in places if isinstance(_held(case, place), dict)]
    if tables:
        key = random.choice(list(EXTRA))
        _held(case, random.choice(tables))[key] = copy.deepcopy(random.choice(EXTRA[key]))


def _cut(random: Random, data: bytes) -> bytes:
    return data[: random.randrange(len(data) + 1)]


def _flipped(random: Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(random.randrange(1, 20)):
        changed[random.randrange(len(data))] = random.randrange(256)
    return bytes(changed)


def _swapped(random: Random, data: bytes) -> bytes:
    lines = data.splitlines(True)
    i, j = random.randrange(len(lines)), random.randrange(len(lines))
    lines[i], lines[j] = lines[j], lines[i]
    return b"".join(lines)


def _twice(random: Random, data: bytes) -> bytes:
    """Repeat some lines."""
    lines = data.splitlines(True)
    i, count = random.randrange(len(lines)), random.choice((1, 1, 5, len(lines)))
    return b"".join(lines[: i + count] + lines[i:])


def _set(random: Random, data: bytes) -> bytes:
    """Give some key a value that is long, deep or strange."""
    values = (
        b"[" + b"0," * random.choice((20_000, 3_000_000)) + b"]",
        b"[" * 5000 + b"]" * 5000,
        b"{a=" * 3000 + b"1" + b"}" * 3000,
        b"9" * 5000,
        b"1e999",
        b"0x" + b"f" * 3000,
        b'"' + b"\xc3\xa9" * 1_000_000 + b'"',
        *(b"2026-13-45", b"1979-05-27T07:32:00Z", b"07:32:00", b"1__0", b"+nan", b"'''\n\n\n'''", b'"\\ud800"'),
    )
    found = list(re.finditer(rb"= (.*)", data))
    if not found:
        return data
    at = random.choice(found)
    return data[: at.start(1)] + random.choice(values) + data[at.end(1) :]


def _strange(random: Random, data: bytes) -> bytes:
    """Return another file altogether, or one with strange bytes before or after."""
    deep = b"a" + b".a" * 20_000 + b" = 1\n"
    many = b"".join(
        b"[[geometry.sphere]]\nname = 'a%d'\nradius = 1.0\n" % n for n in range(random.choice((50, 200_000)))
    )
    return random.choice(
        (
            b"",
            random.randbytes(random.choice((10, 1000, 100_000))),
            b"\0" * random.randrange(1, 50) + data,
            b"\xef\xbb\xbf" + data,
            b"\xff\xfe" + data.decode().encode("utf-16-le"),
            data.replace(b"\n", b"\r\n"),
            data.replace(b"\n", b"\r"),
            data + b"# " + b"x" * 10_000_000,
            deep + data,
            data + b"\n" + many,
        )
    )


Change = Callable[[Random, Any, list[Place]], None]
CHANGES: tuple[Change, ...] = (
    *(
        _left_out,
        _replaced,
        _replaced,
        _replaced,
        _misspelt,
        _misnamed,
        _doubled,
        _exchanged,
        _shuffled,
        _added,
        _added,
    ),
    *(_scaled,) * 8,
    *(_far_apart,) * 2,
)
TEXT_CHANGES: tuple[Callable[[Random, bytes], bytes], ...] = (_cut, _flipped, _swapped, _twice, _set, _set, _strange)
