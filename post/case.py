"""The [post] table and the [[verify]] entries of the case file."""

from typing import Annotated, Literal, Self, get_args

import numpy as np
from pydantic import Field, model_validator

from geom2iga.bspline import Array
from geom2iga.display import counted
from geom2iga.tables import Name, Number, Positive, Table, Units, Vector, repeated

Scalar = Literal[
    "ux",
    "uy",
    "uz",
    "displacement_magnitude",
    "stress_xx",
    "stress_yy",
    "stress_zz",
    "stress_xy",
    "stress_yz",
    "stress_xz",
    "von_mises",
    "principal_1",
    "principal_2",
    "principal_3",
    "hydrostatic_pressure",
]
OfContact = Literal["pressure", "pressure_max", "gap", "penetration", "contact_area", "contact_force", "contact_moment"]
Samples = Annotated[int, Field(strict=True, ge=2, le=64)]
Format = Literal["png", "svg", "pdf"]
COMPONENTS = {"stress": 6, "displacement": 3, "contact_force": 3, "contact_moment": 3}
ON_CONTACTS = get_args(OfContact)


class Cut(Table):
    """A plane that bodies are cut along."""

    origin: Vector = Field(description="a point of it [length]")
    normal: Vector = Field(description="at right angles to it, of any length; what lies behind is drawn")

    @model_validator(mode="after")
    def _has_a_direction(self) -> Self:
        if not any(self.normal):
            raise ValueError("normal: has no length")
        return self

    @property
    def direction(self) -> Array:
        """The normal as a unit vector (3,), whatever its length."""
        scaled = np.array(self.normal) / np.abs(self.normal).max()
        return scaled / np.linalg.norm(scaled)

    def heights(self, points: Array) -> Array:
        """Distances (q,) of points (q, 3) from the plane, positive in front of it [length]."""
        found: Array = (points - np.array(self.origin)) @ self.direction
        return found


class Look(Table):
    """What a picture of bodies shows, and from where."""

    bodies: Annotated[tuple[str, ...], Field(min_length=1)] | None = Field(
        None, description="which are drawn; left out: all"
    )
    cut: Cut | None = Field(None, description="plane that shows the inside; left out: outer faces")
    view: Vector | None = Field(
        None, description="direction from the bodies towards the viewer; left out: from the front, right and above"
    )
    box: tuple[Vector, Vector] | None = Field(
        None, description="two opposite corners of what fills the picture [length]; left out: all"
    )
    limits: tuple[Number, Number] | None = Field(
        None, description="ends of the colours, lowest and highest; values beyond have those of the ends"
    )
    knot_lines: bool = Field(True, strict=True, description="draw knot lines; false: the edges of patches alone")

    @model_validator(mode="after")
    def _can_be_drawn(self) -> Self:
        if self.view and not any(self.view):
            raise ValueError("view: has no length")
        if self.box and any(a == b for a, b in zip(*self.box, strict=True)):
            raise ValueError("box: is empty, its corners should differ in x, y and z")
        if self.limits and self.limits[0] >= self.limits[1]:
            raise ValueError(f"limits: the first should be below the second, found {list(self.limits)}")
        return self


class Picture(Look):
    """A picture of a field on the deformed bodies."""

    name: Name = Field(description="of picture_<name>.png")
    field: Scalar = Field(description="what colours the bodies")


class PointProbe(Table):
    """All fields at one point of a body, for each load step."""

    name: Name = Field(description="of point_<name>.csv and, where there are several load steps, point_<name>.png")
    at: Vector = Field(description="undeformed place [length]")
    body: str | None = Field(None, description="that holds the point; left out: the only one that does")
    field: Scalar = Field("von_mises", description="what its picture shows over the load steps")


class LineProbe(Table):
    """All fields along a straight line through the bodies."""

    name: Name = Field(description="of line_<name>.csv and line_<name>.png")
    start: Vector = Field(description="undeformed place of its first point [length]")
    end: Vector = Field(description="undeformed place of its last point [length]")
    points: Annotated[int, Field(strict=True, ge=2, le=100_000)] = Field(101, description="at equal distances")
    body: str | None = Field(None, description="the only one that is looked at; left out: all")
    field: Scalar = Field("von_mises", description="what its picture shows")

    @model_validator(mode="after")
    def _has_a_length(self) -> Self:
        if self.start == self.end:
            raise ValueError("end: is where the line starts")
        return self


class Post(Table):
    """The [post] table: what to write."""

    samples: Samples | None = Field(
        None,
        description="sample points per span and direction, 2 to 64, in files, summary and checks; left out: 4, or "
        "fewer, at least 2, where that makes more than 4 million",
    )
    pictures: bool = Field(True, strict=True, description="draw the pictures")
    formats: Annotated[tuple[Format, ...], Field(min_length=1)] = Field(("png",), description="of the pictures")
    deformation: Annotated[Positive, Field(le=1e12)] | None = Field(
        None, description="factor on displacements in pictures, at most 1e12; left out: chosen"
    )
    report: bool = Field(True, strict=True, description="write report.html, which needs no other file and no network")
    bezier: bool = Field(True, strict=True, description="write bezier.vtu, exact geometry and displacement")
    load_steps: bool = Field(
        True, strict=True, description="write bezier and contact files of earlier load steps, too, and a .pvd of each"
    )
    gauss_points: bool = Field(False, strict=True, description="write gauss.vtu, stress at the Gauss points")
    picture: tuple[Picture, ...] = Field((), description="further pictures")
    point: tuple[PointProbe, ...] = Field((), description="points whose fields are written to files")
    line: tuple[LineProbe, ...] = Field((), description="lines along which fields are written to files")

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        for key in ("picture", "point", "line"):
            if twice := repeated(entry.name for entry in getattr(self, key)):
                raise ValueError(f'{key}: two are named "{twice}"')
        return self


class Verify(Table):
    """A known answer that the case must show."""

    quantity: Literal["stress", "displacement"] | Scalar | OfContact = Field(
        description="what is compared, at every sample point"
    )
    value: Number | tuple[Number, ...] = Field(description="the exact value, a list for stress (6) and vectors (3)")
    tolerance: Positive = Field(description="largest difference allowed")
    on: str | None = Field(None, description="a body, a face or a secondary face; left out: everywhere")
    source: str = Field("", description="where the exact value comes from")

    @model_validator(mode="after")
    def _has_its_components(self) -> Self:
        wanted = COMPONENTS.get(self.quantity, 1)
        found = len(self.value) if isinstance(self.value, tuple) else 1
        if wanted != found:
            raise ValueError(f"value: {self.quantity} has {counted(wanted, 'component', 'components')}, found {found}")
        return self


class PostCase(Table):
    """What the third stage reads of a case."""

    title: str = Field("", description="one line that says what the case is")
    units: Units = Field(Units(), description="labels of units")
    post: Post = Field(Post(), description="what to write")
    verify: tuple[Verify, ...] = Field((), description="known answers that the case must show")
