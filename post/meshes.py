"""Sampled bodies as a mesh of meshio, which writes the formats of many other programs."""

import meshio
import numpy as np

from post.fields import sample_patch
from post.grid import USUAL
from post.vtu import BODY_FIELDS
from solve.result import Result


def as_mesh(result: Result, samples: int = USUAL) -> meshio.Mesh:
    """Sample the undeformed bodies as hexahedra with the fields of bodies.vtu.

    `as_mesh(result).write("bodies.xdmf")` writes XDMF with all fields; which other formats hold fields is up to meshio.

    Parameters
    ----------
    result : Result
        Converged.
    samples : int
        Points per span and direction, at least 2.

    Returns
    -------
    meshio.Mesh
        A block of hexahedra per patch; point data displacement (q, 3) [length], stress (q, 6) as xx yy zz xy yz xz,
        von_mises, principal_stress (q, 3), hydrostatic_pressure; cell data body, its place in the case from 0.

    Raises
    ------
    CaseError
        The result has not converged.
    """
    result.check_converged()
    numbers = result.model.body_numbers
    parts = [sample_patch(result, name, samples) for name in numbers]
    starts = np.cumsum([0, *(len(part.points) for part in parts)])
    return meshio.Mesh(
        np.concatenate([part.points for part in parts]),
        [("hexahedron", part.cells + start) for part, start in zip(parts, starts, strict=False)],
        point_data={name: np.concatenate([getattr(part, name) for part in parts]) for name in BODY_FIELDS},
        cell_data={"body": [np.full(len(p.cells), n) for p, n in zip(parts, numbers.values(), strict=True)]},
    )
