"""The case file: reading it, naming what is wrong in it, and its [geometry] table."""

import copy
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from geom2iga import bspline
from geom2iga.errors import CaseError, suggestion

TABLES = ("title", "units", "geometry", "solve", "post", "verify")

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
Count = Annotated[int, Field(strict=True, ge=1)]
Vector = tuple[Number, Number, Number]
Counts = tuple[Count, Count, Count]
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
    if not isinstance(value, str) or not re.fullmatch(r"\w[\w-]*", value):
        raise ValueError(f'a name consists of letters, digits, "_" and "-", found "{value}"')
    return value


Triple = Annotated[Counts, BeforeValidator(_three)]
Name = Annotated[str, BeforeValidator(_word)]


class Table(BaseModel):
    """A table of the case file: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Units(Table):
    """Labels for plots and tables; the numbers themselves must be consistent."""

    length: str = Field("", description="unit of length, such as mm")
    force: str = Field("", description="unit of force, such as N")


class Rotation(Table):
    """A rotation of a block about an axis."""

    axis: Vector = Field((0.0, 0.0, 1.0), description="direction of the axis")
    angle: Number = Field(description="angle [degrees], right-handed")
    about: Vector | None = Field(None, description="a point of the axis; left out: the centre of the block")

    @model_validator(mode="after")
    def _has_direction(self) -> Self:
        if not np.linalg.norm(self.axis) > 0:
            raise ValueError("the axis of rotation has no direction")
        return self


class Mesh(Table):
    """Degree and knots of one patch; at most one of spans, breaks and knots."""

    degree: Triple | None = Field(None, description="one degree or three; left out: geometry.degree")
    spans: Triple | None = Field(None, description="equal spans, one number or three; left out with the others: 1")
    breaks: Direction | None = Field(None, description="distinct knots per direction, from 0 to 1")
    knots: Direction | None = Field(None, description="full open knot vectors")

    @model_validator(mode="after")
    def _one_of(self) -> Self:
        given = [key for key in ("spans", "breaks", "knots") if getattr(self, key) is not None]
        if len(given) > 1:
            raise ValueError(f"give only one of {' and '.join(given)}")
        for direction, at in enumerate(self.breaks or ()):
            if len(at) < 2 or at[0] != 0 or at[-1] != 1 or np.any(np.diff(at) <= 0):
                raise ValueError(f"breaks[{direction}] must increase from 0 to 1, found {at}")
        return self

    def knot_vectors(self, degrees: tuple[int, int, int]) -> tuple[bspline.Array, ...]:
        """Make the three knot vectors for given degrees; raise ValueError where `knots` do not fit them."""
        if self.knots is not None:
            vectors = tuple(np.array(k) for k in self.knots)
            for direction, (knots, degree) in enumerate(zip(vectors, degrees, strict=True)):
                try:
                    bspline.check_knots(knots, degree)
                except ValueError as error:
                    raise ValueError(f"knots[{direction}]: {error}") from None
            return vectors
        at = [np.array(b) for b in self.breaks or ()] or [np.linspace(0, 1, n + 1) for n in self.spans or (1, 1, 1)]
        return tuple(bspline.open_knots(a, p) for a, p in zip(at, degrees, strict=True))


class Block(Mesh):
    """A cuboid, built by gmsh; a body of one patch."""

    name: Name = Field(description="name of the body")
    origin: Vector = Field((0.0, 0.0, 0.0), description="its corner of smallest x, y, z, before any rotation")
    size: tuple[Positive, Positive, Positive] = Field(description="its edges along x, y, z, before any rotation")
    rotate: Rotation | None = Field(None, description="rotation about an axis")


class Cad(Mesh):
    """A volume from a CAD file; so far one volume per file, with six plane faces."""

    name: Name = Field(description="name of the body")
    file: str = Field(description="STEP or BREP file, relative to the case file")


class Geometry(Table):
    """The [geometry] table: what the bodies are."""

    degree: Triple = Field((1, 1, 1), description="one degree or three, for all bodies that give none")
    block: tuple[Block, ...] = Field((), description="cuboids")
    cad: tuple[Cad, ...] = Field((), description="volumes from CAD files")

    @property
    def bodies(self) -> tuple[Block | Cad, ...]:
        """All bodies in the sequence in which they are numbered."""
        return (*self.block, *self.cad)

    def degrees(self, body: Mesh) -> tuple[int, int, int]:
        """Triple of one body."""
        return body.degree or self.degree

    @model_validator(mode="after")
    def _fits(self) -> Self:
        names = [body.name for body in self.bodies]
        if not names:
            raise ValueError("there is no body: add a [[geometry.block]]")
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f'two bodies are called "{name}"')
        for kind in ("block", "cad"):
            for number, body in enumerate(getattr(self, kind)):
                try:
                    body.knot_vectors(self.degrees(body))
                except ValueError as error:
                    raise ValueError(f"{kind}[{number}].{error}") from None
        return self


class GeometryCase(Table):
    """What the first stage reads of a case."""

    title: str = Field("", description="one line that says what the case is")
    units: Units = Field(Units(), description="labels of units")
    geometry: Geometry = Field(description="what the bodies are")


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
        raise CaseError(f"{case.name}: {_explained(error.errors()[0], kind)}") from None


WORDS = {  # what pydantic calls things, and what they are in a case file
    "Input should": "should",
    "Tuple should": "should",
    " after validation": "",
    "valid tuple": "list",
    "valid dictionary or instance of": "table, a",
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
        return f"{key} is one table, should be a list of tables: write [[{key}]]"
    if error["type"] == "value_error":
        return f"{key}: {message}" if not message.startswith(("block[", "cad[", "breaks[")) else f"{key}.{message}"
    return f"{key} = {error['input']!r:.80}: {message[0].lower()}{message[1:]}"


def _keys(kind: Any, path: tuple[int | str, ...]) -> list[str]:
    """Find the keys allowed in the table that a path of keys leads to."""
    for part in path:
        if isinstance(part, str) and part in kind.model_fields:
            kind = _table_in(kind.model_fields[part].annotation)
    return list(kind.model_fields)


def _table_in(annotation: Any) -> Any:
    """Find the Table class inside an annotation such as tuple[Block, ...] or Rotation | None."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return annotation
    return next((found for part in getattr(annotation, "__args__", ()) if (found := _table_in(part))), None)
