"""The tables of the case file that describe CAD files and files of other isogeometric programs."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from geom2iga.body_case import Body, Mesh, Tags
from geom2iga.tables import Count, Name, Positive, Vector

Unit = Literal["MM", "CM", "M", "KM", "UM", "IN", "FT"]


class Part(Mesh):
    """Volumes of a CAD model that form one body; what it says of the mesh goes before what the model's table says."""

    name: Name = Field(description="name of the body")
    group: str | None = Field(None, description="the volumes of this physical group")
    label: str | None = Field(None, description="the volumes of this label, as STEP files give them to solids")
    tags: Tags | None = Field(None, description="the volumes of these numbers in gmsh")
    near: Vector | None = Field(None, description="of those left, the one that holds or is nearest to this point")


class CadModel(Body):
    """A CAD model: which volumes form which body, how they become patches."""

    name: Name | None = Field(None, description="all volumes are one body of this name")
    bodies: tuple[Part, ...] = Field((), description="or which volumes form which body; left out: physical groups")
    route: Literal["exact", "mesh"] = Field("exact", description="exact NURBS, or a fit to a mesh of hexahedra")
    exact: bool = Field(True, strict=True, description="false: faces that no exact way reaches are fitted")
    accuracy: Positive = Field(1e-6, description="what a fit should reach, in sizes of the model")
    max_degree: Count = Field(8, description="the highest degree that an exact shape may need")
    fit_spans: Annotated[int, Field(strict=True, ge=2, le=64)] = Field(8, description="spans of the mesh route")

    @model_validator(mode="after")
    def _named_once(self) -> Self:
        if self.name is not None and self.bodies:
            raise ValueError("give only one of name and bodies")
        return self


class Cad(CadModel):
    """A CAD file."""

    file: str = Field(description="STEP, IGES, BREP, XAO or .geo file, relative to the case file")
    unit: Unit = Field("MM", description="unit of length that a STEP or IGES file is turned into")
    trusted: bool = Field(False, strict=True, description="true: a .geo script may run commands of the system")


class Import(Body):
    """A multipatch volume from another isogeometric program; a body."""

    name: Name = Field(description="name of the body")
    file: str = Field(description="G+Smo XML file, relative to the case file")
    patches: Tags | None = Field(None, description="numbers of its volumes, from 1; left out: all")
