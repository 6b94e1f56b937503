"""The [post] table and the [[verify]] entries of the case file."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from geom2iga.tables import Number, Positive, Table, Units

Quantity = Literal[
    "stress",
    "stress_xx",
    "stress_yy",
    "stress_zz",
    "stress_xy",
    "stress_yz",
    "stress_xz",
    "von_mises",
    "displacement",
    "ux",
    "uy",
    "uz",
    "pressure",
    "pressure_max",
    "gap",
    "penetration",
    "contact_area",
    "contact_force",
    "contact_moment",
]
Samples = Annotated[int, Field(strict=True, ge=2, le=64)]
COMPONENTS = {"stress": 6, "displacement": 3, "contact_force": 3, "contact_moment": 3}
ON_CONTACTS = ("pressure", "pressure_max", "gap", "penetration", "contact_area", "contact_force", "contact_moment")


class Post(Table):
    """The [post] table: what to write."""

    samples: Samples | None = Field(
        None,
        description="sample points per span and direction, 2 to 64, in files, summary and checks; left out: 4, or "
        "fewer, at least 2, where that makes more than 4 million",
    )
    pictures: bool = Field(True, strict=True, description="draw the pictures")
    deformation: Positive | None = Field(None, description="factor on displacements in pictures; left out: chosen")


class Verify(Table):
    """A known answer that the case must show."""

    quantity: Quantity = Field(description="what is compared, at every sample point")
    value: Number | tuple[Number, ...] = Field(description="the exact value, a list for stress (6) and vectors (3)")
    tolerance: Positive = Field(description="largest difference allowed")
    on: str | None = Field(None, description="a body, a face or a secondary face; left out: everywhere")
    source: str = Field("", description="where the exact value comes from")

    @model_validator(mode="after")
    def _has_its_components(self) -> Self:
        wanted = COMPONENTS.get(self.quantity, 1)
        found = len(self.value) if isinstance(self.value, tuple) else 1
        if wanted != found:
            raise ValueError(f"value: {self.quantity} has {wanted} components, found {found}")
        return self


class PostCase(Table):
    """What the third stage reads of a case."""

    title: str = Field("", description="one line that says what the case is")
    units: Units = Field(Units(), description="labels of units")
    post: Post = Field(Post(), description="what to write")
    verify: tuple[Verify, ...] = Field((), description="known answers that the case must show")
