"""Reader of OpenCASCADE's boundary representation: the text of .brep files and inside of .xao files.

The text lists locations, curves in parameter planes, curves, surfaces and shapes, each a run of words that begins with
the number of its kind. Every list counts from 1, that of the shapes from its end (BRep Format, OpenCASCADE
documentation).
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from geom2iga.bspline import Array
from geom2iga.errors import GeometryError

SECTIONS = (
    "Locations", "Curve2ds", "Curves", "Polygon3D", "PolygonOnTriangulations", "Surfaces", "Triangulations", "TShapes"
)  # fmt: skip
KINDS = {
    "Ve": "vertex", "Ed": "edge", "Wi": "wire", "Fa": "face", "Sh": "shell", "So": "solid", "CS": "compsolid",
    "Co": "compound",
}  # fmt: skip
CURVES = ("", "line", "circle", "ellipse", "parabola", "hyperbola", "Bezier", "B-spline", "trimmed", "offset")
SURFACES = (
    "", "plane", "cylinder", "cone", "sphere", "torus", "extrusion", "revolution", "Bezier", "B-spline", "trimmed",
    "offset",
)  # fmt: skip
LARGEST = 1e101  # OpenCASCADE writes infinity as 2e100
LONGEST = 1000  # locations that a location may consist of: some that double those before have more than fit anywhere
Location = tuple[tuple[int, int], ...]  # elementary locations and their powers, the last one applied first


@dataclass(frozen=True, eq=False)
class Elementary:
    """A curve or surface given by vectors and numbers.

    Parameters
    ----------
    kind : str
        As in `CURVES` or `SURFACES`.
    vectors : (n, d)
        A point, then directions, in OpenCASCADE's sequence.
    numbers : tuple of float
        Radii, angles.
    basis : the curve that is extruded, revolved or trimmed, the surface that is trimmed; else None
    """

    kind: str
    vectors: Array
    numbers: tuple[float, ...] = ()
    basis: Any = None


@dataclass(frozen=True, eq=False)
class Free:
    """A B-spline or Bezier curve or surface.

    Parameters
    ----------
    kind : str
    degrees : (d,)
    knots : d arrays
        With their multiplicities; of a periodic direction those of one period, ends included.
    coefficients : (n_1, ..., n_d, k + 1)
        Homogeneous: weighted positions, weights.
    periodic : (d,)
    """

    kind: str
    degrees: tuple[int, ...]
    knots: tuple[Array, ...]
    coefficients: Array
    periodic: tuple[bool, ...]


class Use(NamedTuple):
    """A shape inside another: its number, where it is put, whether it is turned around."""

    shape: int
    location: Location
    reversed: bool


class Trace(NamedTuple):
    """A curve of an edge, in space (surface 0) or in the parameter plane of a surface, and its range.

    Along the seam of a closed surface there are two in the parameter plane, a period apart.
    """

    curve: Any
    surface: int
    location: Location
    range: tuple[float, float]
    other: Any = None


@dataclass(frozen=True, eq=False)
class Shape:
    """One shape: a vertex has a point, an edge traces, a face the number and location of its surface."""

    kind: str
    children: tuple[Use, ...]
    point: tuple[float, ...] = ()
    traces: tuple[Trace, ...] = ()
    degenerate: bool = False
    surface: int = 0
    location: Location = ()


@dataclass(frozen=True, eq=False)
class Brep:
    """A whole text: its shapes by number, their surfaces by number, the root, the elementary locations (3, 4)."""

    shapes: dict[int, Shape]
    surfaces: list[Any]
    root: Use
    locations: list[Location]
    transformations: dict[int, Array]

    def matrix(self, location: Location) -> Array:
        """Affine map (3, 4) of a location."""
        full = np.eye(4)
        for number, power in location:
            full = full @ np.linalg.matrix_power(np.vstack([self.transformations[number], [0, 0, 0, 1]]), power)
        return full[:3]


def combined(outer: Location, inner: Location) -> Location:
    """Apply the inner location first; neighbours that are powers of one elementary location become one."""
    parts = list(outer)
    for number, power in inner:
        if parts and parts[-1][0] == number:
            power += parts.pop()[1]
        if power:
            parts.append((number, power))
    return tuple(parts)


class _Words:
    """The words of one section, taken one after the other."""

    def __init__(self, text: str) -> None:
        self.words = re.sub(r"(?<=\d)(?=C[0-3N]|G[12])", " ", text).split()  # "30CN": OpenCASCADE leaves no space
        self.next = 0

    def word(self) -> str:
        self.next += 1
        return self.words[self.next - 1]

    def integer(self) -> int:
        return int(self.word())

    def integers(self, count: int) -> list[int]:
        return [self.integer() for _ in range(count)]

    def numbers(self, count: int) -> Array:
        if not 0 <= count <= len(self.words) - self.next:
            raise ValueError("fewer words than the record says")
        self.next += count
        values = np.array(self.words[self.next - count : self.next], dtype=float)
        if np.abs(values).max(initial=0.0) <= LARGEST:  # not so where one is no number
            return values
        raise ValueError("a number that is none, or too large to compute with")

    def vectors(self, count: int, width: int) -> Array:
        return self.numbers(count * width).reshape(count, width)


def read_brep(text: str) -> Brep:
    """Read the text of a boundary representation.

    Raises
    ------
    GeometryError
        It is none, or is cut off.
    """
    version = re.search(r"CASCADE Topology V(\d)", text)
    if version is None:
        raise GeometryError("this is no boundary representation of OpenCASCADE: its first line is missing")
    parts = re.split(rf"^({'|'.join(SECTIONS)}) (\d+)\s", text[version.end() :], flags=re.MULTILINE)[1:]
    try:
        sections = {name: (int(count), _Words(body)) for name, count, body in zip(*[iter(parts)] * 3, strict=True)}
        transformations, locations = _read_locations(*sections["Locations"])
        curves_2d = _read_list(*sections["Curve2ds"], lambda words: _read_curve(words, 2))
        curves = _read_list(*sections["Curves"], lambda words: _read_curve(words, 3))
        surfaces = _read_list(*sections["Surfaces"], _read_surface)
        count, words = sections["TShapes"]
        reader = _Shapes(words, count, locations, curves, curves_2d, version[1] == "2")
        shapes = {count - number: reader.shape() for number in range(count)}
        _check_descent(shapes)
        return Brep(shapes, surfaces, next(reader.uses()), locations, transformations)
    except (KeyError, IndexError, RecursionError, ValueError, StopIteration):
        raise GeometryError("the boundary representation of OpenCASCADE cannot be read: cut off or damaged") from None


def _check_descent(shapes: dict[int, Shape]) -> None:
    """Raise ValueError where a shape consists of one that stands after it, and so might hold itself."""
    for number, shape in shapes.items():
        if not all(number < use.shape and use.shape in shapes for use in shape.children):
            raise ValueError("a shape that holds one that stands after it")


def _read_list(count: int, words: _Words, read: Callable[[_Words], Any]) -> list[Any]:
    """Read `count` records; number 0 stands for none."""
    return [None, *(read(words) for _ in range(count))]


def _read_locations(count: int, words: _Words) -> tuple[dict[int, Array], list[Location]]:
    """Read elementary locations as matrices, all locations as products of them."""
    transformations: dict[int, Array] = {}
    locations: list[Location] = [()]
    for number in range(1, count + 1):
        if words.integer() == 1:
            transformations[number] = words.vectors(3, 4)
            locations.append(((number, 1),))
            continue
        location: Location = ()
        while part := words.integer():
            power = words.integer()
            location = combined(_power(locations[part], power), location)  # what is applied first stands first
            if len(location) > LONGEST:
                raise ValueError("a location of too many parts")
        locations.append(location)
    return transformations, locations


def _power(location: Location, power: int) -> Location:
    """Apply a location several times, or backwards."""
    step = location if power > 0 else tuple((number, -times) for number, times in reversed(location))
    if len(step) == 1:
        return ((step[0][0], step[0][1] * abs(power)),) if power else ()
    if len(step) * abs(power) > LONGEST:
        raise ValueError("a location of too many parts")
    result: Location = ()
    for _ in range(abs(power)):
        result = combined(result, step)
    return result


def _read_curve(words: _Words, width: int) -> Any:
    """Read a curve in space (width 3) or in a parameter plane (width 2)."""
    kind = CURVES[words.integer()]
    frame = 4 if width == 3 else 3  # in space the normal comes first
    match kind:
        case "line":
            return Elementary(kind, words.vectors(2, width))
        case "circle" | "parabola":
            return Elementary(kind, words.vectors(frame, width), tuple(words.numbers(1)))
        case "ellipse" | "hyperbola":
            return Elementary(kind, words.vectors(frame, width), tuple(words.numbers(2)))
        case "Bezier" | "B-spline":
            return _read_free(words, kind, 1, width)
        case "trimmed":
            return Elementary(kind, np.empty((0, width)), tuple(words.numbers(2)), _read_curve(words, width))
    distance = tuple(words.numbers(1))
    direction = words.vectors(1 if width == 3 else 0, width)
    return Elementary(kind, direction, distance, _read_curve(words, width))


def _read_surface(words: _Words) -> Any:
    """Read a surface."""
    kind = SURFACES[words.integer()]
    match kind:
        case "plane" | "cylinder" | "sphere":
            return Elementary(kind, words.vectors(4, 3), tuple(words.numbers(0 if kind == "plane" else 1)))
        case "cone" | "torus":
            return Elementary(kind, words.vectors(4, 3), tuple(words.numbers(2)))
        case "extrusion" | "revolution":
            vectors = words.vectors(1 if kind == "extrusion" else 2, 3)
            return Elementary(kind, vectors, (), _read_curve(words, 3))
        case "Bezier" | "B-spline":
            return _read_free(words, kind, 2, 3)
    numbers = tuple(words.numbers(4 if kind == "trimmed" else 1))
    return Elementary(kind, np.empty((0, 3)), numbers, _read_surface(words))


def _read_free(words: _Words, kind: str, directions: int, width: int) -> Free:
    """Read a Bezier or B-spline curve or surface."""
    rational = [word != "0" for word in (words.word() for _ in range(directions))]
    spline = kind == "B-spline"
    periodic = [words.integer() == 1 for _ in range(directions if spline else 0)] or [False] * directions
    degrees = words.integers(directions)
    shape = words.integers(directions) if spline else [degree + 1 for degree in degrees]
    distinct = words.integers(directions) if spline else [0] * directions
    size = int(np.prod(shape))
    values = words.vectors(size, width + any(rational))
    weights = values[:, width:] if any(rational) else np.ones((size, 1))
    coefficients = np.concatenate([values[:, :width] * weights, weights], axis=1).reshape(*shape, width + 1)
    if spline:
        pairs = [words.vectors(count, 2) for count in distinct]
        for pair, degree, count, closed in zip(pairs, degrees, shape, periodic, strict=True):
            if pair[:, 1].sum() != count + (pair[-1, 1] if closed else degree + 1):
                raise ValueError("multiplicities that do not fit")
        knots = [np.repeat(p[:, 0], p[:, 1].astype(int)) for p in pairs]
    else:
        knots = [np.repeat([0.0, 1.0], degree + 1) for degree in degrees]
    return Free(kind, tuple(degrees), tuple(knots), coefficients, tuple(periodic))


class _Shapes:
    """Reads the records of shapes."""

    def __init__(self, words: _Words, count: int, locations: list[Location], curves: Any, plane: Any, uv: bool) -> None:
        self.words, self.count, self.locations = words, count, locations
        self.curves, self.plane_curves, self.ends_in_plane = curves, plane, uv

    def shape(self) -> Shape:
        words = self.words
        kind = KINDS[words.word()]
        held: dict[str, Any] = {}
        if kind == "vertex":
            words.numbers(1)
            held["point"] = tuple(words.numbers(3))
            self.skip_points()
        elif kind == "edge":
            words.numbers(3)
            held["degenerate"] = words.integer() == 1
            held["traces"] = tuple(self.traces())
        elif kind == "face":
            words.numbers(2)
            held["surface"], held["location"] = words.integer(), self.locations[words.integer()]
            if words.words[words.next] == "2":
                words.integers(2)
        words.word()  # seven flags
        return Shape(kind, tuple(self.uses()), **held)

    def uses(self) -> Iterator[Use]:
        while self.words.next < len(self.words.words) and (word := self.words.word()) != "*":
            yield Use(int(word[1:]), self.locations[self.words.integer()], word[0] == "-")

    def skip_points(self) -> None:
        """Pass over the places of a vertex on curves and surfaces."""
        while True:
            self.words.numbers(1)
            kind = self.words.integer()
            if not kind:
                return
            self.words.numbers(2 if kind == 1 else 3)

    def traces(self) -> Iterator[Trace]:
        words = self.words
        while kind := words.integer():
            if kind == 1:
                yield self.trace(self.curves[words.integer()], 0)
            elif kind in (2, 3):
                curve = self.plane_curves[words.integer()]
                other = self.plane_curves[words.integer()] if kind == 3 else None
                self.skip(1 if kind == 3 else 0)  # the smoothness across the seam
                yield self.trace(curve, words.integer(), other)
                self.skip((8 if kind == 3 else 4) if self.ends_in_plane else 0)
            else:
                self.skip({4: 5, 5: 2, 6: 3, 7: 4}[kind])  # smoothness across the edge, polygons

    def trace(self, curve: Any, surface: int, other: Any = None) -> Trace:
        location = self.locations[self.words.integer()]
        low, high = self.words.numbers(2)
        return Trace(curve, surface, location, (float(low), float(high)), other)

    def skip(self, count: int) -> None:
        self.words.next += count
