"""From the [geometry] table, or the model that is open in gmsh, to a Model."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from geom2iga.assembly import Joined, assembled, face_groups, joined, with_mesh
from geom2iga.body_case import Body
from geom2iga.cad import session as cad
from geom2iga.cad.case import Cad, CadModel, Import
from geom2iga.cad.conversion import Built, convert
from geom2iga.cad.importing import read_cad, read_gmsh
from geom2iga.case import Block, GeometryCase
from geom2iga.errors import CaseError, GeometryError, UserError
from geom2iga.exchange.gismo import read_gismo
from geom2iga.model import Face, Model, Part, side_faces
from geom2iga.patch import Patch
from geom2iga.progress import progress, tracked
from geom2iga.shapes.case import Primitive
from geom2iga.shapes.primitives import placed
from geom2iga.tables import Case, Source, Table, as_case, checked

SMALLEST, LARGEST = 1e-50, 1e50  # of a patch [length]: products of several volumes remain numbers

Tags = Mapping[str, tuple[int, ...]]


@progress("geometry")
def build(source: Source) -> Model:
    """Build the bodies of a case and turn them into NURBS patches.

    Parameters
    ----------
    source : path, dict, Case or GeometryCase
        With a path, files are looked for relative to it, else relative to the working folder.

    Returns
    -------
    Model
        A cuboid is a body of one patch, its faces named "body/left" ... "body/top"; other bodies have faces of other
        names, and groups under the names that the case gives them.

    Raises
    ------
    CaseError
        The case is wrong.
    GeometryError
        A volume that cannot become a patch.
    """
    source = source if isinstance(source, GeometryCase) else as_case(source)  # type: ignore[arg-type]
    geometry = checked(source, GeometryCase).geometry
    folder = source.folder if isinstance(source, Case) else Path()
    bodies: list[Joined] = []
    patches: list[tuple[Patch, ...]] = []
    groups: list[Mapping[str, tuple[Face, ...]]] = []
    for where, table in tracked(list(geometry.tables), "bodies"):
        with _told(where, getattr(table, "name", None)):
            built, physical = _built(table, folder, geometry.degree)
            _check_sizes(built)
            found = [joined(each) for each in built]
        named = face_groups(table, where, found, physical)
        with _told(where, getattr(table, "name", None)):
            patches += [with_mesh(body, named, geometry.degree) for body in found]
        bodies += found
        groups.append(named)
    return assembled(bodies, patches, groups)


def _check_sizes(bodies: Sequence[Built]) -> None:
    """Raise GeometryError where a volume could be too small or too large a number."""
    for patch in [patch for body in bodies for patch in body.part.patches]:
        size = float(np.ptp(patch.control_points, axis=(0, 1, 2)).max())
        if not SMALLEST <= size <= LARGEST:
            raise GeometryError(
                f'patch "{patch.name}" is {size:.3g} long, from {SMALLEST:g} to {LARGEST:g} can be computed with: '
                "choose another unit of length"
            )


@contextmanager
def _told(where: str, name: str | None) -> Iterator[None]:
    """Say of errors in which table, of which body they are."""
    try:
        yield
    except UserError as error:
        body = "" if name is None else f', body "{name}"'
        raise type(error)(f"{where}{body}: {error}") from None


def build_from_gmsh(**keys: Any) -> Model:
    """Turn the model that is open in gmsh into NURBS patches; gmsh stays open and its model as it is.

    Parameters
    ----------
    keys
        Those of a table [[geometry.cad]] but for its file, such as name, bodies, faces, degree, spans.

    Examples
    --------
    >>> import gmsh
    >>> gmsh.initialize(readConfigFiles=False, interruptible=False)
    >>> gmsh.option.setNumber("General.Terminal", 0)
    >>> tag = gmsh.model.occ.addBox(0, 0, 0, 1, 2, 3)
    >>> gmsh.model.occ.synchronize()
    >>> build_from_gmsh(name="block", degree=2, spans=4, faces=[{"name": "base", "z": 0.0}]).faces("base")
    (Face(patch='block', axis=2, side=0),)
    >>> gmsh.finalize()
    """
    table = checked({"geometry": keys}, OpenModel).geometry
    source = read_gmsh(table)
    bodies = [joined(built) for built in convert(source, table)]
    groups = face_groups(table, "keys", bodies, source.face_groups)
    return assembled(bodies, [with_mesh(body, groups, (1, 1, 1)) for body in bodies], [groups])


class OpenModel(Table):
    """The keys of `build_from_gmsh`, checked as those of a case are."""

    geometry: CadModel


def _built(table: Body, folder: Path, degrees: tuple[int, int, int]) -> tuple[list[Built], Tags]:
    """Build the bodies of one table; return the physical groups of faces, too."""
    if isinstance(table, Cad):
        source = read_cad(folder / table.file, table)
        return convert(source, table), source.face_groups
    if isinstance(table, Block):
        return [_built_block(table, degrees)], {}
    assert isinstance(table, Primitive | Import)
    name = table.name
    part = table.part() if isinstance(table, Primitive) else _chosen(read_gismo(folder / table.file, name), table)
    if not part.faces and len(part.patches) == 1:
        part = Part(part.patches, side_faces(name))
    way = "exact" if isinstance(table, Primitive) else "given"
    return [Built(name, part, table, {patch.name: (way, None) for patch in part.patches}, {})], {}


def _chosen(part: Part, table: Import) -> Part:
    """Keep the patches of a file that a table asks for."""
    if table.patches is None:
        return part
    numbers = range(1, len(part.patches) + 1)
    for number in table.patches:
        if number not in numbers:
            raise CaseError(
                f"patches = {list(table.patches)}: the file holds {len(part.patches)}, there is no {number}"
            )
    kept = tuple(patch for number, patch in zip(numbers, part.patches, strict=True) if number in table.patches)
    names = {patch.name for patch in kept}
    faces = {name: tuple(face for face in group if face.patch in names) for name, group in part.faces.items()}
    return Part(kept, {name: group for name, group in faces.items() if group})


def _built_block(block: Block, degrees: tuple[int, int, int]) -> Built:
    """Build a cuboid in gmsh with edges from 1/2 to 1, read it back, and bring it to its size and place."""
    size, powers = np.frexp(block.size)
    table = CadModel(name=block.name)
    with cad.session():
        cad.add_block(size)
        source = read_gmsh(table)
    (built,) = convert(source, table)
    (patch,) = built.part.patches
    part = replace(built.part, patches=(replace(patch, control_points=np.ldexp(patch.control_points, powers)),))
    (way, distance), largest = built.ways[block.name], int(powers.max())
    return replace(
        built,
        part=placed(part, block.origin, *_rotation(block)),
        mesh=block,
        ways={block.name: (way, None if distance is None else float(np.ldexp(distance, largest)))},
        knots=block.knot_vectors(block.degree or degrees),
    )


def _rotation(block: Block) -> tuple[Any, ...]:
    """Axis, angle and a point of the axis, for `placed`; nothing where a block is not rotated."""
    if block.rotate is None:
        return ()
    centre = tuple(start + size / 2 for start, size in zip(block.origin, block.size, strict=True))
    return block.rotate.axis, block.rotate.angle, block.rotate.about or centre
