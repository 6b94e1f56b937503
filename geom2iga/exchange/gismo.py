"""G+Smo: multipatch volumes as XML, in and out."""

import base64
from collections import Counter, defaultdict
from math import prod
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from geom2iga.bspline import Array, breaks, check_knots
from geom2iga.errors import CaseError, GeometryError
from geom2iga.exchange.common import NO_GROUP, one_line, outer_faces, rows, side_number
from geom2iga.files import replacing
from geom2iga.glue import normalised
from geom2iga.model import Glued, Model, Part
from geom2iga.patch import Face, Patch, evaluate, reversed_along

VOLUMES = ("TensorBSpline3", "TensorNurbs3")
KINDS = {"BSpline": "curve", "Nurbs": "curve", "TrimSurface": "surface"}  # where no number at the end says it
DIMENSIONS = {"1": "curve", "2": "surface", "3": "volume"}


def write_gismo(path: str | Path, model: Model) -> None:
    """Write a model as one MultiPatch with its interfaces; labels name the patches, boundaries the groups.

    Every outer face stands in one boundary. Patches without weights are written as polynomial ones.
    """
    root = Element("xml")
    for number, patch in enumerate(model.patches.values()):
        _put_patch(root, number, patch)
    numbers = {name: number for number, name in enumerate(model.patches)}
    multipatch = SubElement(root, "MultiPatch", parDim="3", id=str(len(numbers)))
    SubElement(multipatch, "patches", type="id_range").text = f"0 {len(numbers) - 1}"
    if model.glued:
        SubElement(multipatch, "interfaces").text = "\n".join(_interface(pair, numbers) for pair in model.glued)
    for name, faces in outer_faces(model).items():
        boundary = SubElement(multipatch, "boundary", {} if name == NO_GROUP else {"name": name})
        boundary.text = "\n".join(f"{numbers[face.patch]} {side_number(face)}" for face in faces)
    ElementTree.indent(root, " ")
    with replacing(Path(path)) as temporary:
        ElementTree.ElementTree(root).write(temporary, encoding="UTF-8", xml_declaration=True)


def _put_patch(root: Element, number: int, patch: Patch) -> None:
    """Append a patch; the first direction runs fastest."""
    rational = bool(np.ptp(patch.weights))
    kind = "TensorNurbs" if rational else "TensorBSpline"
    geometry = SubElement(root, "Geometry", type=f"{kind}3", id=str(number), label=one_line(patch.name))
    basis = SubElement(geometry, "Basis", type=f"{kind}Basis3")
    tensor = SubElement(basis, "Basis", type="TensorBSplineBasis3") if rational else basis
    for direction, (degree, knots) in enumerate(zip(patch.degrees, patch.knots, strict=True)):
        one = SubElement(tensor, "Basis", type="BSplineBasis", index=str(direction))
        SubElement(one, "KnotVector", degree=str(degree)).text = rows(knots).strip()
    if rational:
        SubElement(basis, "weights").text = rows(patch.weights.reshape(-1, 1, order="F"))
    points = patch.control_points.reshape(-1, 3, order="F")
    SubElement(geometry, "coefs", geoDim="3").text = rows(points)


def _interface(pair: Glued, numbers: dict[str, int]) -> str:
    """Write two sides, then for each direction of the first patch that of the second one, and whether they agree."""
    first, second = pair.first, pair.second
    there = second.axes[::-1] if pair.orientation & 1 else second.axes
    directions, alike = [0, 0, 0], [0, 0, 0]
    directions[first.axis], alike[first.axis] = second.axis, int(first.side == second.side)
    for k in range(2):
        directions[first.axes[k]] = there[k]
        alike[first.axes[k]] = 1 - (pair.orientation >> (k + 1) & 1)
    sides = (numbers[first.patch], side_number(first), numbers[second.patch], side_number(second))
    return " ".join(map(str, (*sides, *directions, *alike)))


def read_gismo(path: str | Path, body: str) -> Part:
    """Read all trivariate patches of a file, and the named boundaries of its MultiPatch.

    Parameters
    ----------
    body : str
        Name of the body; patches are called by it, numbered from 1 where there are several.

    Returns
    -------
    Part
        Knots run from 0 to 1; left-handed patches have their first direction reversed.

    Raises
    ------
    CaseError
        The file cannot be read.
    GeometryError
        No XML, no volume in it, or a volume that is none.
    """
    root = _parsed(Path(path))
    geometries = list(root.iter("Geometry"))
    kinds = [_kind(geometry) for geometry in geometries]
    volumes = [geometry for geometry, kind in zip(geometries, kinds, strict=True) if kind == "volume"]
    if not volumes:
        found = ", ".join(f"{count} {kind}{'s' * (count > 1)}" for kind, count in Counter(kinds).items())
        raise GeometryError(f'"{path}" holds {found or "no geometry"}, no volume: save a trivariate spline')
    patches, names, mirrored = [], {}, set()
    for number, geometry in enumerate(volumes, 1):
        name = f"{body}/{number}" if len(volumes) > 1 else body
        key = geometry.get("id", name)
        try:
            patch = normalised(_patch(geometry, name))
        except ValueError as error:
            raise GeometryError(f'"{path}", geometry {key}: {error}') from None
        if _left_handed(patch):
            patch = reversed_along(patch, 0)
            mirrored.add(name)
        patches.append(patch)
        names[key] = name
    try:
        faces = _boundaries(root, body, names, mirrored)
    except ValueError as error:
        raise GeometryError(f'"{path}", boundary: {error}') from None
    return Part(tuple(patches), faces)


class _NoDoctype(ElementTree.TreeBuilder):
    """Builds no tree of a document that declares entities: they can grow without bounds, or open files."""

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        """Refuse."""
        raise ValueError(f"it declares a document type, {name}, which G+Smo files never do")


def _parsed(path: Path) -> Element:
    """Parse a file; what stands before its XML declaration is ignored, as G+Smo does."""
    if path.exists() and not path.is_file():
        raise CaseError(f'"{path}" is no file, but a folder or a device')
    try:
        content = path.read_bytes()
    except OSError as error:
        raise CaseError(f'"{path}": {(error.strerror or str(error)).lower()}') from None
    try:
        parser = ElementTree.XMLParser(target=_NoDoctype())
        return ElementTree.fromstring(content[max(content.find(b"<?xml"), 0) :], parser)
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise GeometryError(f'"{path}" is no G+Smo file: {error}') from None


def _kind(geometry: Element) -> str:
    """Call a geometry curve, surface or volume."""
    kind = geometry.get("type", "")
    return KINDS.get(kind, DIMENSIONS.get(kind[-1:], f'"{kind}"'))


def _patch(geometry: Element, name: str) -> Patch:
    """Make a patch of a Geometry; raise ValueError where it does not hold together."""
    kind = geometry.get("type", "")
    if kind not in VOLUMES:
        raise ValueError(f"a {kind} cannot be read: convert it to one of {', '.join(VOLUMES)}")
    if geometry.find("transform") is not None:
        raise ValueError("its transform cannot be read: apply it to the coefficients")
    basis = _child(geometry, "Basis")
    rational = kind == "TensorNurbs3"
    vectors = (_child(basis, "Basis") if rational else basis).findall("Basis/KnotVector")
    if len(vectors) != 3:
        raise ValueError(f"a volume has 3 knot vectors, found {len(vectors)}")
    degrees, knots = zip(*[_knots(vector) for vector in vectors], strict=True)
    shape = tuple(len(each) - degree - 1 for each, degree in zip(knots, degrees, strict=True))
    coefficients = _child(geometry, "coefs")
    if coefficients.get("geoDim") != "3":
        raise ValueError(f"a volume lies in 3 dimensions, found {coefficients.get('geoDim')}")
    points = _arranged(_numbers(coefficients), shape, 3, coefficients.get("order") == "coordinates")
    weights = _arranged(_numbers(_child(basis, "weights")), shape, 1)[..., 0] if rational else np.ones(shape)
    return Patch(name, degrees, knots, points, weights)


def _child(element: Element, tag: str) -> Element:
    """Return the first child of a kind, or raise ValueError."""
    child = element.find(tag)
    if child is None:
        raise ValueError(f"its <{element.tag}> has no <{tag}>")
    return child


def _knots(vector: Element) -> tuple[int, Array]:
    """Read the degree and the knots of one direction; raise ValueError where they are not open."""
    degree = vector.get("degree", "")
    if not degree.isdecimal():
        raise ValueError(f'a knot vector needs its degree, a number, found "{degree}"')
    knots = _numbers(vector)
    check_knots(knots, int(degree))
    return int(degree), knots


def _numbers(element: Element) -> Array:
    """Read the numbers of an element, written as text or, in newer files, as base 64."""
    text, form = element.text or "", element.get("format", "ascii").lower()
    if form == "ascii":
        return np.array(text.split(), dtype=float)
    if form not in ("b64float64", "b64float32"):
        raise ValueError(f'numbers in the format "{form}" cannot be read: save them as text')
    try:
        content = base64.b64decode("".join(text.split()), validate=True)
        return np.frombuffer(content, dtype=np.dtype(form[3:]).newbyteorder("<")).astype(float)
    except ValueError:
        raise ValueError(f"the numbers of its <{element.tag}> are no {form}") from None


def _arranged(values: Array, shape: tuple[int, ...], size: int, by_coordinate: bool = False) -> Array:
    """Arrange numbers as (*shape, size); in the file the first direction runs fastest, point by point as a rule."""
    count = prod(shape) * size
    if values.size != count:
        raise ValueError(f"{' x '.join(map(str, shape))} control points take {count} numbers, found {values.size}")
    if by_coordinate:
        return values.reshape((*shape, size), order="F")
    return np.moveaxis(values.reshape((size, *shape), order="F"), 0, -1)


def _left_handed(patch: Patch) -> bool:
    """Say whether det J, averaged over the middles of all spans, is negative."""
    middles = [(breaks(knots)[1:] + breaks(knots)[:-1]) / 2 for knots in patch.knots]
    grid = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 3)
    return float(np.linalg.det(evaluate(patch, grid, 1)[1]).mean()) < 0


def _boundaries(root: Element, body: str, names: dict[str, str], mirrored: set[str]) -> dict[str, tuple[Face, ...]]:
    """Read the named boundaries: pairs of the id of a geometry and the number of its side."""
    faces = defaultdict(list)
    for boundary in root.iterfind("MultiPatch/boundary[@name]"):
        numbers = [int(word) for word in (boundary.text or "").split()]
        if len(numbers) % 2:
            raise ValueError(f"{len(numbers)} numbers are no pairs of a geometry and one of its sides")
        for key, side in zip(numbers[::2], numbers[1::2], strict=True):
            if str(key) not in names:
                raise ValueError(f"there is no volume with the id {key}")
            name = names[str(key)]
            axis, end = divmod(side - 1, 2)
            turned = axis == 0 and name in mirrored
            faces[boundary.get("name", "").removeprefix(f"{body}/")].append(
                Face(name, axis, 1 - end if turned else end)
            )
    return {name: tuple(group) for name, group in faces.items()}
