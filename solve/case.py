"""The [solve] table of the case file."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from geom2iga.tables import Count, Finite, Number, Positive, Table, Vector, repeated

USE_PENALTY = 'use enforcement = "penalty"'


class Material(Table):
    """Isotropic linear elasticity of some bodies."""

    bodies: tuple[str, ...] | None = Field(None, description="names of bodies; left out: all")
    young: Positive = Field(description="Young's modulus [stress]")
    poisson: Annotated[float, Finite, Field(gt=-1, lt=0.5)] = Field(
        description="Poisson's ratio, above -1 and below 0.5"
    )


class Support(Table):
    """Prescribed displacement of a face."""

    on: str = Field(description='face, such as "lower/bottom"')
    ux: Number | None = Field(None, description="displacement along x [length]")
    uy: Number | None = Field(None, description="displacement along y [length]")
    uz: Number | None = Field(None, description="displacement along z [length]")
    normal: Number | None = Field(None, description="displacement along the outward normal of a plane face [length]")

    @model_validator(mode="after")
    def _prescribes(self) -> Self:
        if all(value is None for value in (self.ux, self.uy, self.uz, self.normal)):
            raise ValueError("prescribes nothing: give ux, uy, uz or normal")
        return self


class Load(Table):
    """Pressure or traction on a face."""

    on: str = Field(description='face, such as "upper/top"')
    pressure: Number | None = Field(None, description="pushes into the body [stress]")
    traction: Vector | None = Field(None, description="force per area [stress]")
    exposed: bool = Field(False, strict=True, description="only where the face's contact partner does not cover it")

    @model_validator(mode="after")
    def _loads(self) -> Self:
        if (self.pressure is None) == (self.traction is None):
            raise ValueError("give either pressure or traction")
        return self


class BodyForce(Table):
    """Force per volume of some bodies."""

    bodies: tuple[str, ...] | None = Field(None, description="names of bodies; left out: all")
    force: Vector = Field(description="force per volume")


class Contact(Table):
    """A pair of faces that may touch."""

    secondary: str = Field(description="face whose basis functions carry the pressure")
    primary: str = Field(description="face whose normal defines the gap")
    method: Literal["mortar", "kts"] = Field(
        "mortar", description="gaps averaged over control points, or the gap of each quadrature point"
    )
    enforcement: Literal["penalty", "augmented-lagrange", "lagrange"] = Field(
        "penalty", description="pressure from overlap, multiplier updated until none is left, or multiplier as unknown"
    )
    penalty: Positive | Literal["auto"] = Field("auto", description="pressure per overlap; auto: 10 E/h")
    multiplier: Literal["p", "p-2"] = Field("p", description="degree of the contact pressure, p that of the face")
    two_pass: bool = Field(False, strict=True, description="each side is secondary in turn, with half the pressure")
    integration: Literal["segment", "element"] = Field(
        "segment", description="cells cut along the knot lines of both sides, or the secondary's spans"
    )
    points: Annotated[Count, Field(le=64)] | None = Field(
        None, description="Gauss points per cell and direction, at most 64; left out: enough"
    )
    reach: Positive | None = Field(None, description="largest gap that is looked at [length]; left out: any")

    @property
    def on_control_points(self) -> bool:
        """Whether pressures are control values of the secondary face's own basis."""
        return self.method == "mortar" and self.multiplier == "p"

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.enforcement != "penalty":
            if self.method == "kts":
                raise ValueError(f'method = "kts" has more gaps than the bodies can close: {USE_PENALTY}')
            if self.two_pass:
                raise ValueError(f"two_pass asks for the same twice: {USE_PENALTY}")
        if self.enforcement == "lagrange" and self.penalty != "auto":
            raise ValueError('enforcement = "lagrange" has no penalty: leave it out')
        if self.method == "kts" and self.multiplier != "p":
            raise ValueError('method = "kts" has a pressure at each point: leave multiplier out')
        return self


class Linear(Table):
    """How linear systems are solved."""

    method: Literal["auto", "direct", "iterative"] = Field(
        "auto",
        description="sparse factors, or conjugate gradients that store no matrix; auto: by the number of unknowns",
    )


class Newton(Table):
    """When the semismooth Newton iteration ends."""

    max_steps: Count = Field(200, description="most Newton steps")
    tolerance: Annotated[Positive, Field(le=1e-3)] = Field(
        1e-12, description="largest residual over the largest force, on control points; at most 1e-3"
    )


class Augmentation(Table):
    """When the updates of the multiplier of augmented Lagrange end."""

    max_steps: Count = Field(200, description="most updates")
    tolerance: Annotated[Positive, Field(le=1e-2)] = Field(
        1e-10, description="largest penetration over the size of the smallest body; at most 1e-2"
    )


class Steps(Table):
    """Load steps: shares of all loads and prescribed displacements."""

    count: Annotated[int, Field(strict=True, ge=1, le=10000)] | None = Field(None, description="so many equal steps")
    factors: tuple[Number, ...] | None = Field(
        None, min_length=1, max_length=10_000, description="or the share of the loads in each step"
    )

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.count is None) == (self.factors is None):
            raise ValueError("give either count or factors")
        return self

    @property
    def several(self) -> bool:
        """Whether there is more than one step."""
        return len(self.shares) > 1

    @property
    def shares(self) -> tuple[float, ...]:
        """Share of the loads in each step."""
        return self.factors or tuple((n + 1) / (self.count or 1) for n in range(self.count or 1))


class Solve(Table):
    """The [solve] table: materials, supports, loads, contacts."""

    material: tuple[Material, ...] = Field(min_length=1, description="one entry per kind of material")
    support: tuple[Support, ...] = Field((), description="prescribed displacements of faces")
    load: tuple[Load, ...] = Field((), description="pressures and tractions on faces")
    body_force: tuple[BodyForce, ...] = Field((), description="forces per volume")
    contact: tuple[Contact, ...] = Field((), description="pairs of faces that may touch")
    linear: Linear = Field(Linear(), description="how linear systems are solved")
    newton: Newton = Field(Newton(), description="when the iteration ends")
    augmentation: Augmentation = Field(Augmentation(), description="when the updates of augmented Lagrange end")
    steps: Steps = Field(Steps(count=1), description="load steps; left out: all at once")

    @model_validator(mode="after")
    def _pairs_differ(self) -> Self:
        ways = {(contact.secondary, contact.primary): contact.enforcement for contact in self.contact}
        if twice := repeated((contact.secondary, contact.primary) for contact in self.contact):
            secondary, primary = twice
            raise ValueError(f'contact: "{secondary}" on "{primary}" stands twice, leave one out')
        for (secondary, primary), way in ways.items():
            if (primary, secondary) in ways and {way, ways[primary, secondary]} != {"penalty"}:
                both = f'"{secondary}" on "{primary}" stands the other way round, too, which asks for the same twice'
                raise ValueError(f"contact: {both}: {USE_PENALTY} in both, or leave one out")
        return self


class SolveCase(Table):
    """What the second stage reads of a case."""

    solve: Solve = Field(description="materials, supports, loads and contacts")
