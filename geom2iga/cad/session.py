"""The gmsh session: build blocks, open CAD files, read models back."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import gmsh
import numpy as np

from geom2iga.bspline import Array
from geom2iga.cad.conversion import Volume
from geom2iga.cad.script import check_script
from geom2iga.errors import CaseError, GeometryError

IGES = (".iges", ".igs")
UNITS = {"IN": "INCH"}  # what OpenCASCADE calls otherwise
FORMATS = (".step", ".stp", *IGES, ".brep", ".xao", ".geo")


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


def add_block(size: Array) -> int:
    """Build a cuboid on the origin with OpenCASCADE in the open gmsh model; return the tag of its volume.

    Its edges are neither short nor long against 1: to OpenCASCADE, all within 1e-7 is one point.
    """
    tag = gmsh.model.occ.addBox(0, 0, 0, *size)
    gmsh.model.occ.synchronize()
    return int(tag)


def check_file(path: Path, trusted: bool = False) -> None:
    """Raise GeometryError for a format that is not read, or a script that is not trusted; CaseError for no file."""
    if path.suffix.lower() not in FORMATS:
        raise GeometryError(f'"{path}": only {", ".join(FORMATS)} files are read: save it as one of them')
    if not path.is_file():
        kind = "a folder, no file" if path.is_dir() else "a pipe or device, no file"
        found = kind if path.exists() else "no such file"
        raise CaseError(f'"{path}": {found}; the path is relative to the case file')
    if path.suffix.lower() == ".geo":
        if not (path.read_bytes() or b"\n").endswith(b"\n"):
            raise GeometryError(f'"{path}": its last line does not end, gmsh would leave it out: add a newline')
        if not trusted:
            check_script(path)


def add_file(path: Path, unit: str = "MM") -> None:
    """Import a file into the open gmsh model.

    Parameters
    ----------
    path : STEP, IGES, BREP or XAO file, or a .geo script of gmsh
    unit : str
        Unit of length that the coordinates of STEP and IGES files are turned into, such as "MM" or "M".

    Raises
    ------
    GeometryError
        A file that gmsh cannot read.
    """
    if path.suffix.lower() in IGES and unit != "MM":
        raise GeometryError("IGES files are read in millimetres only: leave the unit out, or save the model as STEP")
    # said aloud: OpenCASCADE remembers the unit it was last told; of IGES it takes none before it has seen a STEP file
    gmsh.option.setString("Geometry.OCCTargetUnit", "" if path.suffix.lower() in IGES else UNITS.get(unit, unit))
    try:
        with _talk_on_standard_error():
            if path.suffix.lower() in (".geo", ".xao"):
                gmsh.merge(str(path))
            else:
                gmsh.model.occ.importShapes(str(path))
            gmsh.model.occ.synchronize()
    except Exception as error:  # gmsh raises nothing finer
        reason = str(error).strip() or "it does not say why"
        advice = "correct it" if path.suffix.lower() == ".geo" else "save it anew from the CAD program"
        raise GeometryError(f"gmsh cannot read it: {reason}; {advice}") from None


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


def boundary() -> str:
    """Write the open gmsh model as XAO text, its entities named by dimension and tag; users' names are put back."""
    entities = gmsh.model.getEntities()
    names = [gmsh.model.getEntityName(*entity) for entity in entities]
    try:
        for dimension, tag in entities:
            gmsh.model.setEntityName(dimension, tag, f"{dimension}:{tag}")
        with TemporaryDirectory() as folder:
            path = Path(folder) / "model.xao"
            gmsh.write(str(path))
            return path.read_text(encoding="utf-8")
    finally:
        for entity, name in zip(entities, names, strict=True):
            gmsh.model.setEntityName(*entity, name)


def volumes() -> dict[int, Volume]:
    """List the volumes of the open gmsh model."""
    if not gmsh.isInitialized():
        raise CaseError("no model is open in gmsh: call gmsh.initialize() and build one first")
    found = {}
    for entity in gmsh.model.getEntities(3):
        box = np.array(gmsh.model.getBoundingBox(*entity)).reshape(2, 3)
        found[entity[1]] = Volume(gmsh.model.getEntityName(*entity), box)
    return found


def groups(dimension: int) -> dict[str, tuple[int, ...]]:
    """List the physical groups of a dimension: their names and the tags in them."""
    found = {}
    for _, number in gmsh.model.getPhysicalGroups(dimension):
        name = gmsh.model.getPhysicalName(dimension, number) or str(number)
        found[name] = tuple(int(tag) for tag in gmsh.model.getEntitiesForPhysicalGroup(dimension, number))
    return found
