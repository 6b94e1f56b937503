"""What all tables of the case file that describe bodies have in common: mesh, names of faces, rotation."""

from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from geom2iga.bspline import Array
from geom2iga.tables import (
    Count,
    Degrees,
    Direction,
    Finite,
    Moderate,
    Name,
    Number,
    Positive,
    SpansEach,
    Table,
    Vector,
    repeated,
)

Tags = Annotated[tuple[Count, ...], Field(min_length=1)]


def _several(value: Any) -> Any:
    """Let one table stand for a list of one."""
    return [value] if isinstance(value, dict) else value


def _round(value: Any) -> Any:
    """Let a radius stand for a table that holds it."""
    return {"radius": value} if isinstance(value, int | float) else value


class Rotation(Table):
    """A rotation of a body about an axis."""

    axis: Vector = Field((0.0, 0.0, 1.0), description="direction of the axis")
    angle: Number = Field(description="angle [degrees], right-handed")
    about: Vector | None = Field(
        None, description="a point of the axis; left out: the centre of a block, the origin of other bodies"
    )

    @model_validator(mode="after")
    def _has_direction(self) -> Self:
        if not any(self.axis):
            raise ValueError("the axis of rotation has no direction")
        return self


class Round(Table):
    """A sphere or a cylinder that faces lie on."""

    radius: Positive = Field(description="its radius")
    centre: Vector | None = Field(None, description="its centre, or a point of its axis; left out: any")


RoundOrRadius = Annotated[Round, BeforeValidator(_round, json_schema_input_type=Round | Positive)]


class Selector(Table):
    """Which faces are meant; where several keys are given, all of them hold."""

    x: Number | None = Field(None, description="in the plane at this x")
    y: Number | None = Field(None, description="in the plane at this y")
    z: Number | None = Field(None, description="in the plane at this z")
    normal: Vector | None = Field(None, description="plane, with the outward normal along this vector")
    sphere: RoundOrRadius | None = Field(None, description="on a sphere: radius, centre")
    cylinder: RoundOrRadius | None = Field(None, description="on a cylinder: likewise")
    group: str | None = Field(None, description="in this physical group")
    tags: Tags | None = Field(None, description="of these numbers in gmsh")
    near: Vector | None = Field(None, description="of those left, the one nearest to this point")

    @model_validator(mode="after")
    def _has_direction(self) -> Self:
        if self.normal is not None and not any(self.normal):
            raise ValueError("the normal has no direction")
        return self


class Faces(Selector):
    """A name for a group of faces."""

    name: Name = Field(description="the name, as supports, loads and contacts write it")
    body: Name | None = Field(None, description="of this body; left out: of all bodies of the table")

    @model_validator(mode="after")
    def _selects(self) -> Self:
        if self.model_fields_set <= {"name", "body"}:
            keys = ", ".join(key for key in Selector.model_fields)
            raise ValueError(f'"{self.name}" selects nothing: give one of {keys}')
        return self


class Grading(Table):
    """Spans that grow away from named faces, in a geometric sequence."""

    toward: str = Field(description="faces where the spans are smallest, such as bottom")
    ratio: Annotated[float, Finite, Field(ge=1), Moderate] = Field(description="largest span over smallest")
    equal: Count = Field(1, description="so many spans next to the faces are of one size, before they grow")


Gradings = Annotated[
    tuple[Grading, ...], BeforeValidator(_several, json_schema_input_type=Grading | tuple[Grading, ...])
]


class Mesh(Table):
    """Degree and spans of a body, on top of those that its exact shape needs."""

    degree: Degrees | None = Field(None, description="at least; one or three; left out: geometry.degree")
    spans: SpansEach | None = Field(
        None, description="per patch, one number, or three along its own directions; glued ones take the most; or 1"
    )
    span_size: Positive | None = Field(None, description="or the length that no span is to exceed")
    grading: Gradings = Field((), description="unequal spans")

    @model_validator(mode="after")
    def _one_of(self) -> Self:
        given = [key for key in ("spans", "span_size", "breaks", "knots") if getattr(self, key, None) is not None]
        if len(given) > 1:
            raise ValueError(f"give only one of {' and '.join(given)}")
        return self


class Body(Mesh):
    """A body, or several from one file, and names for groups of their faces."""

    faces: tuple[Faces, ...] = Field((), description="names for groups of faces")

    @model_validator(mode="after")
    def _named_once(self) -> Self:
        if name := repeated(faces.name for faces in self.faces):
            raise ValueError(f'two groups of faces are called "{name}"')
        return self


NARROWEST = 1e-9  # of a direction: what the spans of a case are at least long


def check_spans(knots: Array) -> None:
    """Raise ValueError where a span between different knots, which do not decrease, is next to nothing."""
    steps = np.diff(knots)
    narrow = np.flatnonzero((steps > 0) & (steps < NARROWEST * (knots[-1] - knots[0])))
    if narrow.size:
        one, other = knots[narrow[0]], knots[narrow[0] + 1]
        raise ValueError(f"{one:g} and {other:g} are nearer than {NARROWEST:g} of the whole: leave one of them out")


class OnePatch(Body):
    """A body of one patch, whose directions are known beforehand."""

    breaks: Direction | None = Field(None, description="distinct knots per direction, from 0 to 1")

    @model_validator(mode="after")
    def _increasing(self) -> Self:
        if self.grading and self.breaks:
            raise ValueError("give only one of grading and breaks")
        for direction, at in enumerate(self.breaks or ()):
            if len(at) < 2 or at[0] != 0 or at[-1] != 1 or np.any(np.diff(at) <= 0):
                raise ValueError(f"breaks[{direction}] must increase from 0 to 1, found {at}")
            try:
                check_spans(np.array(at))
            except ValueError as error:
                raise ValueError(f"breaks[{direction}]: {error}") from None
        return self
