"""The [geometry] table of the case file."""

from collections.abc import Iterator
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from geom2iga import bspline
from geom2iga.body_case import Body, OnePatch, Rotation, check_spans
from geom2iga.cad.case import Cad, Import
from geom2iga.shapes.case import Cylinder, DomedBlock, Extrusion, Hemisphere, Pipe, Revolution, Sphere
from geom2iga.tables import Degrees, Direction, Name, Positive, Table, Units, Vector, repeated


class Block(OnePatch):
    """A cuboid, built by gmsh; a body of one patch."""

    name: Name = Field(description="name of the body")
    origin: Vector = Field((0.0, 0.0, 0.0), description="its corner of smallest x, y, z, before any rotation")
    size: tuple[Positive, Positive, Positive] = Field(description="its edges along x, y, z, before any rotation")
    rotate: Rotation | None = Field(None, description="rotation about an axis")
    knots: Direction | None = Field(None, description="full open knot vectors")

    @model_validator(mode="after")
    def _graded_once(self) -> Self:
        if self.grading and self.knots:
            raise ValueError("give only one of grading and knots")
        return self

    def knot_vectors(self, degrees: tuple[int, int, int]) -> tuple[bspline.Array, ...] | None:
        """Return the knot vectors where the block gives them; raise ValueError where they do not fit the degrees."""
        for direction, (knots, degree) in enumerate(zip(self.knots or (), degrees, strict=False)):
            try:
                bspline.check_knots(np.array(knots), degree)
                check_spans(np.array(knots))
            except ValueError as error:
                raise ValueError(f"knots[{direction}]: {error}") from None
        if self.breaks is not None:
            return tuple(bspline.open_knots(at, p) for at, p in zip(self.breaks, degrees, strict=True))
        return None if self.knots is None else tuple(map(np.array, self.knots))


class Geometry(Table):
    """The [geometry] table: what the bodies are."""

    degree: Degrees = Field((1, 1, 1), description="one degree or three, for all bodies that give none")
    block: tuple[Block, ...] = Field((), description="cuboids")
    cylinder: tuple[Cylinder, ...] = Field((), description="solid cylinders and sectors of them")
    pipe: tuple[Pipe, ...] = Field((), description="hollow cylinders and sectors of them")
    sphere: tuple[Sphere, ...] = Field((), description="balls")
    hemisphere: tuple[Hemisphere, ...] = Field((), description="half balls, with a shank or without")
    domed_block: tuple[DomedBlock, ...] = Field((), description="blocks with a round bottom")
    extrusion: tuple[Extrusion, ...] = Field((), description="four-sided profiles moved along a vector")
    revolution: tuple[Revolution, ...] = Field((), description="four-sided profiles turned about z")
    cad: tuple[Cad, ...] = Field((), description="CAD files")
    imported: tuple[Import, ...] = Field((), alias="import", description="volumes from other isogeometric programs")

    @property
    def tables(self) -> Iterator[tuple[str, Body]]:
        """All tables of bodies with their keys, in the sequence in which the bodies are numbered."""
        for field, info in type(self).model_fields.items():
            tables = getattr(self, field)
            for number, table in enumerate(tables if isinstance(tables, tuple) else ()):
                if isinstance(table, Body):
                    yield f"geometry.{info.alias or field}[{number}]", table

    @property
    def files(self) -> list[str]:
        """All files that the table names."""
        return [each.file for each in self.cad] + [each.file for each in self.imported]

    @model_validator(mode="after")
    def _fits(self) -> Self:
        tables = [table for _, table in self.tables]
        if not tables:
            raise ValueError("there is no body: add a [[geometry.block]]")
        names = [part.name for table in tables for part in (getattr(table, "bodies", ()) or (table,))]  # type: ignore
        if name := repeated(name for name in names if name is not None):
            raise ValueError(f'two bodies are called "{name}"')
        for number, block in enumerate(self.block):
            try:
                block.knot_vectors(block.degree or self.degree)
            except ValueError as error:
                raise ValueError(f"block[{number}].{error}") from None
        return self


class GeometryCase(Table):
    """What the first stage reads of a case."""

    title: str = Field("", description="one line that says what the case is")
    units: Units = Field(Units(), description="labels of units")
    geometry: Geometry = Field(description="what the bodies are")
