"""From the [geometry] table to a Model."""

from math import radians
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from geom2iga import cad
from geom2iga.blocks import trilinear_patch
from geom2iga.bspline import Array
from geom2iga.case import Block, Cad, GeometryCase
from geom2iga.errors import GeometryError
from geom2iga.model import Model, block_groups
from geom2iga.patch import Patch, elevated, refined
from geom2iga.tables import Case, Source, as_case, checked


def build(source: Source) -> Model:
    """Build the bodies of a case in gmsh and turn them into NURBS patches.

    Parameters
    ----------
    source : path, dict, Case or GeometryCase
        With a path, CAD files are looked for relative to it, else relative to the working folder.

    Returns
    -------
    Model
        One body of one patch per block, its faces named "body/left" ... "body/top".

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
    patches = {}
    for body in geometry.bodies:
        patches[body.name] = _meshed(_read_body(body, folder), body, geometry.degrees(body))
    groups = {group: faces for name in patches for group, faces in block_groups(name).items()}
    return Model(patches, {name: (name,) for name in patches}, groups)


def _read_body(body: Block | Cad, folder: Path) -> Patch:
    """Build a body in gmsh and read it back as a trilinear patch."""
    try:
        with cad.session():
            if isinstance(body, Cad):
                return trilinear_patch(cad.read_volume(cad.add_file(folder / body.file)), body.name)
            return trilinear_patch(cad.read_volume(cad.add_block(body)), body.name, _axes(body))
    except GeometryError as error:
        raise GeometryError(f'body "{body.name}": {error}') from None


def _axes(block: Block) -> Array:
    """Where the edges of a block point after its rotation, (3, 3) by rows."""
    if block.rotate is None:
        return np.eye(3)
    axis = np.array(block.rotate.axis) / np.linalg.norm(block.rotate.axis)
    return Rotation.from_rotvec(axis * radians(block.rotate.angle)).as_matrix().T


def _meshed(patch: Patch, body: Block | Cad, degrees: tuple[int, int, int]) -> Patch:
    """Raise a trilinear patch to the asked degrees and knot vectors."""
    wanted = body.knot_vectors(degrees)
    ends = tuple(np.repeat(knots[[0, -1]], 2) for knots in wanted)
    coarse = elevated(Patch(patch.name, patch.degrees, ends, patch.control_points), degrees)
    inner = [knots[degree + 1 : -degree - 1] for knots, degree in zip(wanted, degrees, strict=True)]
    return refined(coarse, knots=inner)
