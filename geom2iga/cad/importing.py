"""CAD files through gmsh, in a process of its own; the model that is open in gmsh, as it is."""

import os
from pathlib import Path

from geom2iga.cad import session as cad
from geom2iga.cad.brep import read_brep
from geom2iga.cad.case import Cad, CadModel
from geom2iga.cad.conversion import CadSource, find_bodies
from geom2iga.cad.isolated import isolated
from geom2iga.cad.mesh_route import fit_volumes
from geom2iga.cad.script import inputs
from geom2iga.cad.topology import split_xao
from geom2iga.errors import GeometryError
from geom2iga.progress import progress

PATIENCE = 300.0  # seconds that gmsh may take for a file, however short
PER_MEGABYTE = 60.0  # seconds more, of the file and those that it includes


def read_cad(path: Path, table: Cad) -> CadSource:
    """Let gmsh read a file in a process of its own.

    Raises
    ------
    CaseError
        No such file.
    GeometryError
        Another format, a file that gmsh cannot read or that makes it crash or hang, a script that is not trusted.
    """
    cad.check_file(path, table.trusted)
    _check_text(path)
    try:
        with progress(f"gmsh reads {path.name}"):
            source = isolated(_load, path.resolve(), table, seconds=_patience(path))
    except GeometryError as error:
        raise GeometryError(f'"{path}": {error}') from None
    if not source.volumes and path.suffix.lower() in cad.IGES:
        raise GeometryError(f'"{path}": the IGES file holds no solids, only surfaces: save the model as STEP')
    return source


def read_gmsh(table: CadModel) -> CadSource:
    """Take the model that is open in gmsh; it stays as it is, but for its mesh on the mesh route."""
    volumes = cad.volumes()
    source = CadSource("", volumes, cad.groups(3), cad.groups(2))
    if not volumes:
        return source
    if table.route == "exact":
        return source._replace(xao=cad.boundary())
    tags = [tag for _, members in find_bodies(source, table) for tag in members]
    fitted = fit_volumes({tag: str(tag) for tag in tags}, table.fit_spans)
    return source._replace(fitted=dict(zip(tags, fitted, strict=True)))


def _patience(path: Path) -> float:
    """Seconds that gmsh may take for a file: five minutes, and one more per megabyte of it and what it includes."""
    size = sum(os.path.getsize(file) for file in inputs(path) if os.path.isfile(file))
    return PATIENCE + PER_MEGABYTE * size / 1e6


def _load(path: Path, table: Cad) -> CadSource:
    """Open a file in an empty model: what the other process does."""
    with cad.session():
        cad.add_file(path, table.unit)
        return read_gmsh(table)


def _check_text(path: Path) -> None:
    """Read a boundary representation ourselves before gmsh does: cut off, it makes OpenCASCADE hang."""
    if path.suffix.lower() not in (".brep", ".xao"):
        return
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
        read_brep(split_xao(text)[0] if path.suffix.lower() == ".xao" else text)
    except GeometryError as error:
        raise GeometryError(f'"{path}": {error}; save it anew from the CAD program') from None
