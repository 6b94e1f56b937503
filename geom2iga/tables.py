"""Case files: what they consist of, reading them, and naming what is wrong in them."""

import copy
import re
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from geom2iga.errors import CaseError, shown, suggestion
from geom2iga.explain import explained

TABLES = ("title", "units", "geometry", "solve", "post", "verify")

WORD = r"\w[\w-]{0,49}"  # what a name looks like

MOST_INTEGER = 2**63 - 1
LARGEST, SMALLEST = 1e30, 1e-30  # of numbers: their products and powers in what follows can be computed
MOST_BYTES = 4 << 20  # of a case file
MOST_LEVELS = 20  # of lists and tables within each other
MOST_NUMBERS, MOST_TABLES = 100_000, 2_000  # of one list
LONG_KEY = re.compile(r"""(?<![\w."'-])([\w"'-]+[ \t]*\.[ \t]*){100}""")  # tomllib's time grows with the square of it


def _moderate(value: float) -> float:
    if abs(value) > LARGEST:
        raise ValueError(f"should lie between {-LARGEST:g} and {LARGEST:g}, found {value:g}: choose larger units")
    return value


def _not_tiny(value: float) -> float:
    if value < SMALLEST:
        raise ValueError(f"should be at least {SMALLEST:g}, found {value:g}: choose smaller units")
    return value


Finite = Field(strict=True, allow_inf_nan=False)
Moderate = AfterValidator(_moderate)  # after bounds, so that the schema for editors shows these
Number = Annotated[float, Finite, Moderate]
Positive = Annotated[float, Finite, Field(gt=0), Moderate, AfterValidator(_not_tiny)]
Count = Annotated[int, Field(strict=True, ge=1)]
Vector = tuple[Number, Number, Number]
Direction = tuple[list[Number], list[Number], list[Number]]


def _three(value: Any) -> Any:
    """Let one degree, or one number of spans, stand for three."""
    if isinstance(value, list | tuple):
        return value
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise ValueError(f"should be an integer of at least 1, or three of them, found {shown(value)}")
    return (value,) * 3


def _word(value: Any) -> Any:
    """Names become parts of face names and of paths in files."""
    if not isinstance(value, str) or not re.fullmatch(WORD, value):
        raise ValueError(f'a name consists of up to 50 letters, digits, "_" and "-", found "{value!s:.80}"')
    return value


Degree = Annotated[int, Field(strict=True, ge=1, le=20)]
Degrees = Annotated[
    tuple[Degree, Degree, Degree],
    BeforeValidator(_three, json_schema_input_type=Degree | tuple[Degree, Degree, Degree]),
]
Spans = Annotated[int, Field(strict=True, ge=1, le=10_000)]
SpansEach = Annotated[
    tuple[Spans, Spans, Spans],
    BeforeValidator(_three, json_schema_input_type=Spans | tuple[Spans, Spans, Spans]),
]
Name = Annotated[str, BeforeValidator(_word, json_schema_input_type=Annotated[str, Field(pattern=f"^{WORD}$")])]


class Table(BaseModel):
    """A table of the case file: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Units(Table):
    """Labels for plots and tables; the numbers themselves must be consistent."""

    length: str = Field("", description="unit of length, such as mm")
    force: str = Field("", description="unit of force, such as N")

    @property
    def stress(self) -> str:
        """Unit of stress, empty where one of its parts is."""
        return f"{self.force}/{self.length}²" if self.length and self.force else ""


T = TypeVar("T")


@dataclass(frozen=True)
class Case:
    """A case file as read: its tables, whose names alone are checked, and the folder its paths are relative to."""

    tables: Mapping[str, Any]
    folder: Path = Path()
    name: str = "case"

    def __post_init__(self) -> None:
        for key in self.tables:
            if key not in TABLES:
                raise CaseError(f'{self.name}: unknown table "{key}"; {suggestion(str(key), TABLES)}')
        _check_size(self.tables, self.name)

    def changed(self, values: Mapping[str, Any]) -> "Case":
        """Return a copy with some values replaced or added; the number after the last entry of a list adds one.

        >>> case = Case({"geometry": {"degree": 1, "block": [{"name": "lower", "spans": [4, 4, 4]}]}})
        >>> case.changed({"geometry.degree": 3, "geometry.block.0.spans": [2, 2, 2]}).tables["geometry"]
        {'degree': 3, 'block': [{'name': 'lower', 'spans': [2, 2, 2]}]}
        """
        tables = copy.deepcopy(dict(self.tables))
        for key, value in values.items():
            try:
                _place(tables, [int(part) if part.isdigit() else part for part in key.split(".")], value)
            except (AttributeError, IndexError, KeyError, TypeError):
                raise CaseError(f'the case has no place for "{key}"') from None
        return Case(tables, self.folder, self.name)


def _place(table: Any, path: list[int | str], value: Any) -> None:
    """Put a value where a path of keys and list numbers leads."""
    for part, following in zip(path, [*path[1:], None], strict=True):
        if isinstance(part, int) and part == len(table):
            table.append({})
        if following is None:
            table[part] = copy.deepcopy(value)
        else:
            table = table.setdefault(part, {}) if isinstance(part, str) else table[part]


def _check_size(tables: Mapping[str, Any], name: str) -> None:
    """Raise CaseError for lists that are too long, and for tables in tables in tables without an end."""
    left: list[tuple[str, Any, int]] = [("", tables, 0)]
    while left:
        key, value, level = left.pop()
        if level > MOST_LEVELS:
            raise CaseError(f"{name}: {key[:80]}: more than {MOST_LEVELS} lists or tables within each other")
        if isinstance(value, Mapping):
            left += [(f"{key}.{part}" if key else str(part), each, level + 1) for part, each in value.items()]
        elif isinstance(value, int) and abs(value) > MOST_INTEGER:
            raise CaseError(f"{name}: {key} has more digits than numbers of TOML may have, write it as 1e20 or so")
        elif isinstance(value, list | tuple):
            most = MOST_TABLES if value and isinstance(value[0], Mapping) else MOST_NUMBERS
            if len(value) > most:
                raise CaseError(f"{name}: {key} has {len(value)} entries, should have at most {most}")
            left += [(f"{key}[{n}]", each, level + 1) for n, each in enumerate(value) if not isinstance(each, float)]


def repeated(names: Iterable[T]) -> T | None:
    """Return the first name that stands more than once, None where all differ.

    >>> repeated(["a", "b", "b", "a"]), repeated("abc")
    ('a', None)
    """
    return next((name for name, count in Counter(names).items() if count > 1), None)


def read_case(path: str | Path) -> Case:
    """Read a case file; raise CaseError where it is missing, no TOML, or has unknown top-level keys."""
    path = Path(path)
    too_deep = f"{path}: more than {MOST_LEVELS} lists or tables within each other"
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise CaseError(f"{path}: longer than {MOST_BYTES >> 20} MB, which no case file is")
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
        if LONG_KEY.search(text):
            raise CaseError(too_deep)
        tables = tomllib.loads(text)
    except OSError as error:
        raise CaseError(f"{path}: {(error.strerror or str(error)).lower()}; give the path of a case file") from None
    except RecursionError:
        raise CaseError(too_deep) from None
    except UnicodeDecodeError as error:
        raise CaseError(f"{path}: not a TOML file: it is not text in UTF-8 (byte {error.start})") from None
    except tomllib.TOMLDecodeError as error:
        raise CaseError(f"{path}: not a TOML file: {error}") from None
    except ValueError:  # of int(): Python reads no longer ones
        raise CaseError(f"{path}: not a TOML file: a number has thousands of digits") from None
    return Case(tables, path.parent, path.name)


Kind = TypeVar("Kind", bound=Table)
Source = str | Path | Mapping[str, Any] | Case | Table


def as_case(source: str | Path | Mapping[str, Any] | Case) -> Case:
    """Make a Case of a path or a dict; a Case stays what it is."""
    if isinstance(source, Case):
        return source
    if isinstance(source, Mapping):
        return Case(source)
    if not isinstance(source, str | Path):
        raise CaseError(f"expected the path of a case file, a dict or a Case, found a {type(source).__name__}")
    return read_case(source)


def checked(source: Source, kind: type[Kind]) -> Kind:
    """Check what one stage reads of a case.

    Parameters
    ----------
    source : path, dict, Case, or an object of `kind`, which is returned as it is
    kind : type
        The pydantic model of the stage.

    Raises
    ------
    CaseError
        Names the first wrong key in full, the value found and what is allowed.
    """
    if isinstance(source, kind):
        return source
    if isinstance(source, Table):
        raise CaseError(f"expected a {kind.__name__}, found a {type(source).__name__}")
    case = as_case(source)
    tables = {key: case.tables[key] for key in kind.model_fields if key in case.tables}
    try:
        return kind.model_validate(tables)
    except ValidationError as error:
        raise CaseError(f"{case.name}: {explained(error, kind, tables)}") from None
