"""From a CAD model, as gmsh hands it over, to bodies of coarse patches."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from pydantic import ValidationError

from geom2iga.body_case import Mesh
from geom2iga.bspline import Array
from geom2iga.cad.blocks import block_spline, check_block
from geom2iga.cad.case import CadModel
from geom2iga.cad.case import Part as PartTable
from geom2iga.cad.faces import convert_faces, distance_from
from geom2iga.cad.mesh_route import Fitted
from geom2iga.cad.topology import Topology, merged, read_topology
from geom2iga.errors import CaseError, GeometryError, suggestion
from geom2iga.model import Face, Part, side_faces
from geom2iga.progress import tracked

SMALLEST = 1e-6  # of a box around a volume [length]: gmsh leaves 1e-7 on each side

log = logging.getLogger("geom2iga")


class Volume(NamedTuple):
    """A volume as gmsh lists it: its label, as STEP files give it, and its bounding box (2, 3) [length]."""

    label: str
    box: Array


class CadSource(NamedTuple):
    """What gmsh knows of a model.

    Parameters
    ----------
    xao : str
        XAO text, its entities named by dimension and tag; empty where nothing in it was made by OpenCASCADE.
    volumes : tag to Volume
    volume_groups, face_groups : physical group to tags
    fitted : volume tag to Fitted
        What the mesh route made of the volumes, empty for the exact route.
    """

    xao: str
    volumes: Mapping[int, Volume]
    volume_groups: Mapping[str, tuple[int, ...]]
    face_groups: Mapping[str, tuple[int, ...]]
    fitted: Mapping[int, Fitted] = {}


@dataclass(frozen=True, eq=False)
class Built:
    """A body of coarse patches.

    Parameters
    ----------
    name : str
    part : Part
    mesh : Mesh
        What the case says of its degree and spans.
    ways : patch name to (word, distance)
        As in a `Certificate`.
    tags : Face to tag of the CAD face
    knots : three knot vectors, or None
        Of a single patch, where the case gives them in full.
    """

    name: str
    part: Part
    mesh: Mesh
    ways: Mapping[str, tuple[str, float | None]]
    tags: Mapping[Face, int]
    knots: tuple[Array, ...] | None = None


def convert(source: CadSource, table: CadModel) -> list[Built]:
    """Turn the volumes of a CAD model into patches, body by body; these point along x, y and z as nearly as may be.

    Raises
    ------
    CaseError
        A body without volumes, or one volume in two bodies.
    GeometryError
        A volume that cannot become a patch; the message names the entity and the remedy.
    """
    if not source.volumes:
        raise GeometryError("there is no volume, only surfaces or less: make solids of them in the CAD program")
    if (size := max(float(np.ptp(volume.box, axis=0).max()) for volume in source.volumes.values())) < SMALLEST:
        raise GeometryError(
            f"the volumes are at most {size:.2g} long, and to OpenCASCADE all within 1e-7 is one point: choose a "
            'smaller unit of length, as unit = "UM"'
        )
    if table.route == "mesh":
        return [_from_mesh(source, part, tags, table) for part, tags in find_bodies(source, table)]
    topology = read_topology(source.xao)
    lacking = set(source.volumes) - set(topology.solids)
    if lacking:
        raise GeometryError(
            f"volume {min(lacking)} was made by gmsh's built-in kernel, which has no exact shapes: begin the script "
            'with SetFactory("OpenCASCADE"), or use route = "mesh"'
        )
    return [_exact(topology, part, tags, table) for part, tags in find_bodies(source, table)]


def find_bodies(source: CadSource, table: CadModel) -> list[tuple[PartTable, list[int]]]:
    """List the bodies of a model and the volumes of each; those in no body are left out, which is logged.

    Raises
    ------
    CaseError
        A body without volumes, one volume in two bodies, or no body at all.
    """
    if table.name is not None:
        return [(PartTable(name=table.name), list(source.volumes))]
    parts = table.bodies or tuple(map(_part_of, source.volume_groups))
    if not parts:
        raise CaseError("give the bodies names: name for one, bodies for several, or physical groups of volumes")
    found = [(part, _volumes_of(part, source)) for part in parts]
    holder: dict[int, str] = {}
    for part, tags in found:
        for tag in tags:
            if tag in holder:
                raise CaseError(f'volume {tag} is in two bodies, "{holder[tag]}" and "{part.name}"')
            holder[tag] = part.name
    if left := [str(tag) for tag in source.volumes if tag not in holder]:
        log.info("volumes in no body: %s", ", ".join(left))
    return found


def _part_of(group: str) -> PartTable:
    """Make a body of a physical group, by its name."""
    try:
        return PartTable(name=group, group=group)
    except ValidationError:
        raise CaseError(
            f'the physical group "{group}" cannot name a body, whose name consists of letters, digits, "_" and "-": '
            "name its body under bodies"
        ) from None


def _volumes_of(part: PartTable, source: CadSource) -> list[int]:
    """Choose the volumes that a body consists of; where several keys are given, all of them hold."""
    where = f'body "{part.name}"'
    left = list(source.volumes)
    if part.group is not None:
        if part.group not in source.volume_groups:
            known = suggestion(part.group, source.volume_groups)
            raise CaseError(f'{where}: there is no physical group "{part.group}" of volumes; {known}')
        left = [tag for tag in left if tag in source.volume_groups[part.group]]
    if part.label is not None:
        labels = {tag: source.volumes[tag].label for tag in left}
        left = [tag for tag in left if part.label in (labels[tag], labels[tag].rpartition("/")[2])]
    if part.tags is not None:
        left = [tag for tag in left if tag in part.tags]
    if not left:
        offered = {tag: volume.label for tag, volume in source.volumes.items()}
        listed = ", ".join(f'{tag} "{label}"' if label else str(tag) for tag, label in offered.items())
        raise CaseError(f"{where}: no volume is like that; there are: {listed}")
    if part.near is not None:
        point = np.array(part.near)
        left = [min(left, key=lambda tag: _apart(source.volumes[tag].box, point))]
    return left


def _apart(box: Array, point: Array) -> tuple[float, float]:
    """Distance of a point from a box, then from its middle."""
    outside = np.maximum(0, np.maximum(box[0] - point, point - box[1]))
    return float(np.linalg.norm(outside)), float(np.linalg.norm(point - box.mean(axis=0)))


def _exact(topology: Topology, part: PartTable, tags: Sequence[int], table: CadModel) -> Built:
    """Convert the volumes of one body; they share faces, those of other bodies do not."""
    own = merged(topology, {tag: topology.solids[tag] for tag in tags})
    for solid in own.solids.values():
        check_block(own, solid)
    _check_apart(own)
    faces = convert_faces(own, table.accuracy, table.exact)
    patches, ways = [], {}
    places: dict[Face, int] = {}
    solids = zip(_names(part.name, len(tags)), own.solids.values(), strict=True)
    for name, solid in tracked(solids, "volumes", len(tags)):
        spline, around = block_spline(own, solid, faces, np.eye(3))
        if max(spline.degrees) > table.max_degree:
            raise GeometryError(
                f"volume {solid.tag} needs the degrees {spline.degrees}, above max_degree = "
                f'{table.max_degree}: raise that, or use route = "mesh"'
            )
        try:
            patches.append(spline.patch(name))
        except ValueError as error:
            raise GeometryError(f"volume {solid.tag}: {error}: split it into more regular blocks") from None
        sides = {Face(name, *place): int(tag) for place, tag in np.ndenumerate(around)}
        fitted = any(faces[tag].fitted for tag in sides.values())
        distance = max(distance_from(own.faces[tag], spline.end(face.axis, face.side)) for face, tag in sides.items())
        ways[name] = ("fitted" if fitted else "exact", distance)
        places |= sides
    return Built(part.name, Part(tuple(patches), _named(part.name, places)), _mesh(part, table), ways, places)


def _from_mesh(source: CadSource, part: PartTable, tags: Sequence[int], table: CadModel) -> Built:
    """Take the volumes of one body from the mesh route."""
    patches, ways = [], {}
    places: dict[Face, int] = {}
    for name, tag in zip(_names(part.name, len(tags)), tags, strict=True):
        fitted = source.fitted[tag]
        patches.append(replace(fitted.patch, name=name))
        places |= {Face(name, face.axis, face.side): number for number, face in fitted.faces.items()}
        ways[name] = ("fitted", fitted.boundary_error)
    return Built(part.name, Part(tuple(patches), _named(part.name, places)), _mesh(part, table), ways, places)


def _check_apart(topology: Topology) -> None:
    """Raise GeometryError where two volumes of a body have the same faces."""
    holder: dict[frozenset[int], int] = {}
    for tag, solid in topology.solids.items():
        other = holder.setdefault(frozenset(solid.faces), tag)
        if other != tag:
            raise GeometryError(f"volumes {other} and {tag} are in the same place: delete one")


def _names(body: str, count: int) -> list[str]:
    """Name the patches of a body."""
    return [body] if count == 1 else [f"{body}/{number}" for number in range(1, count + 1)]


def _named(body: str, places: Mapping[Face, int]) -> dict[str, tuple[Face, ...]]:
    """Name the faces of a single patch by their sides, those of several by their numbers in gmsh."""
    if len(places) == 6:
        return side_faces(body)
    tags = list(places.values())
    return {f"face{tag}": (face,) for face, tag in places.items() if tags.count(tag) == 1}


def _mesh(part: PartTable, table: CadModel) -> Mesh:
    """Merge what a body and its model say of the mesh; the body goes first."""
    keys = ("spans", "span_size")
    source = part if any(getattr(part, key) is not None for key in keys) else table
    return Mesh(
        degree=part.degree or table.degree,
        grading=part.grading or table.grading,
        **{key: getattr(source, key) for key in keys},
    )
