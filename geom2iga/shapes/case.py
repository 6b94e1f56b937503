"""The tables of the case file that describe primitives: one class per kind, which builds what it says."""

from abc import ABC, abstractmethod
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from geom2iga.body_case import Body, OnePatch, Rotation
from geom2iga.errors import UserError
from geom2iga.model import Part
from geom2iga.shapes import primitives
from geom2iga.shapes.domes import Bottom
from geom2iga.tables import Finite, Moderate, Name, Number, Positive, Vector

Angle = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=360)]
Point = tuple[Number, Number]
Corners = tuple[Point, Point, Point, Point]


class Primitive(Body, ABC):
    """A body that a few numbers describe."""

    name: Name = Field(description="name of the body")
    origin: Vector = Field((0.0, 0.0, 0.0), description="where its reference point lies, before any rotation")
    rotate: Rotation | None = Field(None, description="rotation about an axis; without `about`, through the origin")

    @abstractmethod
    def shape(self) -> Part:
        """Build the body about the origin of space, or raise GeometryError."""

    def part(self) -> Part:
        """Build the body where it belongs.

        Returns
        -------
        Part
            Coarse patches, not yet refined to the mesh.
        """
        if self.rotate is None:
            return primitives.placed(self.shape(), self.origin)
        turn = self.rotate
        return primitives.placed(self.shape(), self.origin, turn.axis, turn.angle, turn.about)

    @model_validator(mode="after")
    def _can_be_built(self) -> Self:
        try:
            self.shape()
        except UserError as error:
            raise ValueError(str(error)) from None
        return self


class Cylinder(Primitive):
    """A solid cylinder that stands on its origin, or a sector of one; faces side, bottom, top, start, end."""

    radius: Positive = Field(description="its radius")
    height: Positive = Field(description="its height")
    angle: Angle = Field(360.0, description="of the sector [degrees], from the x axis towards the y axis")

    def shape(self) -> Part:
        """Build it on the origin of space."""
        return primitives.cylinder(self.name, self.radius, self.height, self.angle)


class Pipe(Primitive):
    """A hollow cylinder that stands on its origin; faces inner, outer, bottom, top, start, end."""

    inner: Positive = Field(description="inner radius")
    outer: Positive = Field(description="outer radius")
    height: Positive = Field(description="its height")
    angle: Angle = Field(360.0, description="of the sector [degrees], from the x axis towards the y axis")

    def shape(self) -> Part:
        """Build it on the origin of space."""
        return primitives.pipe(self.name, self.inner, self.outer, self.height, self.angle)


class Sphere(Primitive):
    """A ball about its origin; face outside."""

    radius: Positive = Field(description="its radius")

    def shape(self) -> Part:
        """Build it about the origin of space."""
        return primitives.sphere(self.name, self.radius)


class Hemisphere(Primitive):
    """Half a ball, its centre the origin, with a shank on its flat side or none; faces outside, flat, side."""

    radius: Positive = Field(description="its radius")
    height: Annotated[float, Finite, Field(ge=0), Moderate] = Field(0.0, description="of the shank")
    flat: Literal["up", "down"] = Field("up", description="where the flat side looks")

    def shape(self) -> Part:
        """Build it about the origin of space."""
        return primitives.hemisphere(self.name, self.radius, self.height, self.flat)


class DomedBlock(Primitive, OnePatch):
    """A block with a round bottom, whose lowest point is the origin; faces left, right, front, back, bottom, top."""

    size: tuple[Positive, Positive, Positive] = Field(description="edges along x and y, height above the lowest point")
    radius: Positive = Field(description="of curvature at the lowest point")
    bottom: Bottom = Field("sphere", description="sphere, cylinder (about a line along y) or paraboloid")
    quarter: bool = Field(
        False, strict=True, description="only what lies over positive x and y from the lowest point, of that size"
    )

    def shape(self) -> Part:
        """Build it over the origin of space."""
        return primitives.domed_block(self.name, self.size, self.radius, self.bottom, self.quarter)


class Extrusion(Primitive):
    """A four-sided profile moved along a vector; faces front, right, back, left, bottom, top."""

    points: Corners = Field(description="corners of the profile as [x, y] from the origin, counter-clockwise")
    through: dict[str, Point] = Field({}, description="points [x, y] that make arcs of sides: front, right, back, left")
    vector: Vector = Field(description="from the bottom to the top, its z positive")

    def shape(self) -> Part:
        """Build it from the origin of space."""
        return primitives.extrusion(self.name, self.points, self.vector, self.through)


class Revolution(Primitive):
    """A four-sided profile turned about z through the origin; faces bottom, outer, top, inner, start, end.

    The profile keeps off the axis.
    """

    points: Corners = Field(description="corners as [distance from the axis, above 0; z], counter-clockwise")
    through: dict[str, Point] = Field({}, description="points that make arcs of sides: bottom, outer, top, inner")
    angle: Angle = Field(360.0, description="of the sector [degrees], from the x axis towards the y axis")

    def shape(self) -> Part:
        """Build it about the z axis of space."""
        return primitives.revolution(self.name, self.points, self.through, self.angle)
