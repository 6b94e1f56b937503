"""The [geometry] table of the case file."""

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from geom2iga import bspline
from geom2iga.tables import Direction, Name, Number, Positive, Table, Triple, Units, Vector


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
