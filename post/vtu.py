"""VTU files of sampled fields, for ParaView."""

from pathlib import Path

import meshio
import numpy as np

from geom2iga.files import replacing
from post.fields import sample_patch, sample_secondary
from solve.result import Result


def write_bodies(path: Path, result: Result, samples: int) -> None:
    """Write the undeformed bodies: point data displacement, stress (xx yy zz xy yz xz), von_mises; cell data body.

    The number of a body is its place in the case file, from 0.
    """
    names = [name for patches in result.model.bodies.values() for name in patches]
    parts = [sample_patch(result, name, samples) for name in names]
    bodies = [list(result.model.bodies).index(result.model.body_of(name)) for name in names]
    _write(
        path,
        "hexahedron",
        [part.points for part in parts],
        [part.cells for part in parts],
        {
            "displacement": [part.displacement for part in parts],
            "stress": [part.stress for part in parts],
            "von_mises": [part.von_mises for part in parts],
        },
        {"body": bodies},
    )


def write_contact(path: Path, result: Result, samples: int) -> None:
    """Write the undeformed secondary faces: point data pressure, gap, normal, displacement; cell data face."""
    parts = sample_secondary(result, samples)
    fields = ("pressure", "gap", "normal", "displacement")
    _write(
        path,
        "quad",
        [part.points for part in parts],
        [part.cells for part in parts],
        {name: [getattr(part, name) for part in parts] for name in fields},
        {"face": list(range(len(parts)))},
    )


def _write(
    path: Path,
    kind: str,
    points: list[np.ndarray],
    cells: list[np.ndarray],
    point_data: dict[str, list[np.ndarray]],
    cell_data: dict[str, list[int]],
) -> None:
    """Put parts below each other in one file."""
    starts = np.cumsum([0, *(len(part) for part in points[:-1])])
    joined = np.concatenate([part + start for part, start in zip(cells, starts, strict=True)])
    mesh = meshio.Mesh(
        np.concatenate(points),
        [(kind, joined)],
        {name: np.concatenate(values) for name, values in point_data.items()},
        {name: [np.repeat(values, [len(part) for part in cells])] for name, values in cell_data.items()},
    )
    with replacing(path) as temporary:
        meshio.write(temporary, mesh, file_format="vtu")
