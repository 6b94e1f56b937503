"""Case files: what they consist of, reading them, and naming what is wrong in them."""

import copy
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from geom2iga.errors import CaseError, suggestion

TABLES = ("title", "units", "geometry", "solve", "post", "verify")

WORD = r"\w[\w-]{0,49}"  # what a name looks like

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
Count = Annotated[int, Field(strict=True, ge=1)]
Vector = tuple[Number, Number, Number]
Direction = tuple[list[Number], list[Number], list[Number]]


def _three(value: Any) -> Any:
    """Let one degree, or one number of spans, stand for three."""
    if isinstance(value, list | tuple):
        return value
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise ValueError(f"should be an integer of at least 1, or three of them, found {value!r}")
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


def read_case(path: str | Path) -> Case:
    """Read a case file; raise CaseError where it is missing, no TOML, or has unknown top-level keys."""
    path = Path(path)
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise CaseError(f"{path}: {(error.strerror or str(error)).lower()}; give the path of a case file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise CaseError(f"{path}: not a TOML file: {error}") from None
    return Case(tables, path.parent, path.name)


T = TypeVar("T", bound=Table)
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


def checked(source: Source, kind: type[T]) -> T:
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
    try:
        return kind.model_validate({key: case.tables[key] for key in kind.model_fields if key in case.tables})
    except ValidationError as error:
        errors = sorted(
            error.errors(), key=lambda each: each["type"] != "extra_forbidden"
        )  # a typo before what it leaves out
        raise CaseError(f"{case.name}: {_explained(errors[0], kind)}") from None


WORDS = {  # what pydantic calls things, and what they are in a case file
    "Input should": "should",
    "Tuple should": "should",
    " after validation": "",
    "valid tuple": "list",
    "valid dictionary or instance of": "table, a",
    "valid dictionary": "table",
    "a valid boolean": "true or false",
}


def _explained(error: Any, kind: type[Table]) -> str:
    """Turn one pydantic error into: key = value: what is allowed."""
    key = ""
    for part in error["loc"]:
        key += f"[{part}]" if isinstance(part, int) else f".{part}" if key else str(part)
    message = error["msg"].removeprefix("Value error, ")
    for theirs, ours in WORDS.items():
        message = message.replace(theirs, ours)
    if error["type"] == "extra_forbidden":
        parent, _, last = key.rpartition(".")
        return f'unknown key "{last}" in [{parent}]; {suggestion(last, _keys(kind, error["loc"][:-1]))}'
    if error["type"] == "missing":
        return f"{key} is missing"
    if error["type"] == "tuple_type" and isinstance(error["input"], Mapping):
        name = re.sub(r"\[[0-9]+]", "", key)
        return f"{key} is one table, should be a list of tables: write [[{name}]]"
    if error["type"] == "value_error":
        return f"{key}: {message}" if not message.startswith(("block[", "cad[", "breaks[")) else f"{key}.{message}"
    return f"{key} = {error['input']!r:.80}: {message[0].lower()}{message[1:]}"


def _keys(kind: Any, path: tuple[int | str, ...]) -> list[str]:
    """Find the keys allowed in the table that a path of keys leads to."""
    for part in path:
        fields = {info.alias or name: info for name, info in kind.model_fields.items()}
        if part in fields:
            kind = _table_in(fields[part].annotation)
    return [info.alias or name for name, info in kind.model_fields.items()]


def _table_in(annotation: Any) -> Any:
    """Find the Table class inside an annotation such as tuple[Block, ...] or Rotation | None."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return annotation
    return next((found for part in getattr(annotation, "__args__", ()) if (found := _table_in(part))), None)
