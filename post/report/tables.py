"""What stands in the tables of the page and not in the summary as it is."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from math import prod
from typing import Any, NamedTuple

from post.quantities import QUANTITIES
from solve.newton import Step
from solve.result import Result

OF_CONTACT = {  # quantities of checks: in words, and what their unit is made of
    "stress": ("stress xx yy zz xy yz xz", "stress"),
    "displacement": ("displacement x y z", "length"),
    "pressure": ("contact pressure", "stress"),
    "pressure_max": ("largest contact pressure", "stress"),
    "gap": ("gap", "length"),
    "penetration": ("overlap", "length"),
    "contact_area": ("contact area", "area"),
    "contact_force": ("contact force x y z", "force"),
    "contact_moment": ("contact moment x y z", "moment"),
}


class Mesh(NamedTuple):
    """How a patch is divided."""

    body: str
    patch: str
    degrees: tuple[int, ...]
    spans: tuple[int, ...]
    control_points: tuple[int, ...]
    total: int
    rational: bool


class Body(NamedTuple):
    """A body, and what it is made of."""

    name: str
    patches: int
    young: float
    poisson: float


class Load(NamedTuple):
    """A load step and its Newton steps."""

    number: int
    factor: float | None  # none where it did not converge
    steps: tuple[Step, ...]


class Quantity(NamedTuple):
    """What a check compares."""

    title: str
    dimension: str


def meshes(result: Result) -> Iterator[Mesh]:
    """Yield how each patch is divided, body by body."""
    for body, names in result.model.bodies.items():
        for name in names:
            patch = result.model.patches[name]
            spans = tuple(len(at) - 1 for at in patch.breaks)
            yield Mesh(body, name, tuple(patch.degrees), spans, patch.shape, prod(patch.shape), patch.is_rational)


def bodies(result: Result) -> Iterator[Body]:
    """Yield all bodies."""
    for name, patches in result.model.bodies.items():
        material = result.materials[name]
        yield Body(name, len(patches), material.young, material.poisson)


def newton_table(result: Result) -> Iterator[Load]:
    """Yield the load steps with their Newton steps."""
    for number, steps in groupby(result.history, key=lambda step: step.load_step):
        factor = result.states[number - 1].load_factor if number <= len(result.states) else None
        yield Load(number, factor, tuple(steps))


def quantity(name: str) -> Quantity:
    """Say what a check compares, and what its unit is made of."""
    if name in QUANTITIES:
        return Quantity(QUANTITIES[name].title, QUANTITIES[name].dimension)
    return Quantity(*OF_CONTACT[name])


def sums(vectors: Sequence[Sequence[float]]) -> list[float]:
    """Add up vectors, component by component."""
    return [sum(parts) for parts in zip(*vectors, strict=True)]


def largest(entries: Mapping[Any, Mapping[str, Any]], key: str) -> Any:
    """Find which of some entries has the largest number under a key."""
    return max(entries, key=lambda name: entries[name][key])
