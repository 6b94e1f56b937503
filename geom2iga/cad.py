"""The gmsh session: build blocks, open CAD files, read volumes back. The only file that imports gmsh."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import radians
from pathlib import Path

import gmsh
import numpy as np

from geom2iga.bspline import Array
from geom2iga.case import Block
from geom2iga.errors import CaseError, GeometryError


@dataclass(frozen=True)
class Curve:
    """A curve of a volume: gmsh's type name, the tags of its ends, its middle point (3,) [length]."""

    kind: str
    ends: tuple[int, ...]
    middle: Array


@dataclass(frozen=True)
class Volume:
    """The boundary of a gmsh volume, by tag."""

    tag: int
    points: dict[int, Array]
    curves: dict[int, Curve]
    faces: dict[int, tuple[str, tuple[int, ...]]]  # gmsh's type name, curves


@contextmanager
def session() -> Iterator[None]:
    """Open an empty gmsh model; a gmsh that is already running keeps its own models and its current one."""
    running = gmsh.isInitialized()
    if not running:
        gmsh.initialize(readConfigFiles=False, interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
    before = gmsh.model.getCurrent()
    unit = gmsh.option.getString("Geometry.OCCTargetUnit")
    gmsh.option.setString("Geometry.OCCTargetUnit", "MM")  # said aloud: OpenCASCADE remembers the unit it was last told
    gmsh.model.add("geom2iga")
    try:
        yield
    finally:
        gmsh.model.remove()
        gmsh.option.setString("Geometry.OCCTargetUnit", unit)
        if running:
            gmsh.model.setCurrent(before)
        else:
            gmsh.finalize()


def add_block(block: Block) -> int:
    """Build a cuboid with OpenCASCADE in the open gmsh model; return the tag of its volume.

    Raises
    ------
    GeometryError
        A cuboid too small for OpenCASCADE.
    """
    try:
        tag = gmsh.model.occ.addBox(*block.origin, *block.size)
    except Exception as error:  # gmsh raises nothing finer
        raise GeometryError(
            f"gmsh cannot build a cuboid of size {block.size} ({str(error).strip()}): it needs edges longer than 1e-7, "
            "choose a smaller unit of length"
        ) from None
    if block.rotate is not None:
        about = block.rotate.about or [o + s / 2 for o, s in zip(block.origin, block.size, strict=True)]
        gmsh.model.occ.rotate([(3, tag)], *about, *block.rotate.axis, radians(block.rotate.angle))
    gmsh.model.occ.synchronize()
    return tag


def add_file(path: Path) -> int:
    """Import the one volume of a STEP or BREP file into the open gmsh model; return its tag.

    Raises
    ------
    GeometryError
        Another format, a file that gmsh cannot read, no volume or several.
    CaseError
        No such file.
    """
    if path.suffix.lower() not in (".step", ".stp", ".brep"):
        raise GeometryError(f'"{path}": only STEP and BREP files are read so far, save it as one of them')
    if not path.is_file():
        raise CaseError(f'"{path}": no such file; the path is relative to the case file')
    try:
        with _talk_on_standard_error():
            gmsh.model.occ.importShapes(str(path))
    except Exception as error:  # gmsh raises nothing finer
        raise GeometryError(f'"{path}": gmsh cannot read it: {error}; save it anew from the CAD program') from None
    gmsh.model.occ.synchronize()
    tags = [tag for _, tag in gmsh.model.getEntities(3)]
    if len(tags) != 1:
        raise GeometryError(
            f'"{path}" holds {len(tags)} volumes, so far a file may hold one: save each body in a file of its own'
        )
    return tags[0]


@contextmanager
def _talk_on_standard_error() -> Iterator[None]:
    """Send what OpenCASCADE prints to standard error: standard output is for data."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def read_volume(tag: int) -> Volume:
    """Read the points, curves and faces of a volume from the open gmsh model."""
    faces = {}
    curves: dict[int, Curve] = {}
    points: dict[int, Array] = {}
    for _, face in gmsh.model.getBoundary([(3, tag)], oriented=False):
        around = tuple(abs(curve) for _, curve in gmsh.model.getBoundary([(2, face)], oriented=False))
        faces[face] = (gmsh.model.getType(2, face), around)
        for curve in around:
            if curve not in curves:
                curves[curve] = _read_curve(curve)
    for curve in curves.values():
        for end in curve.ends:
            points[end] = np.array(gmsh.model.getValue(0, end, []))
    return Volume(tag, points, curves, faces)


def _read_curve(tag: int) -> Curve:
    ends = tuple(point for _, point in gmsh.model.getBoundary([(1, tag)], combined=False, oriented=False))
    (low,), (high,) = gmsh.model.getParametrizationBounds(1, tag)
    middle = np.array(gmsh.model.getValue(1, tag, [(low + high) / 2]))
    return Curve(gmsh.model.getType(1, tag), ends, middle)
