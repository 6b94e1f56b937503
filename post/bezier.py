"""Bézier VTU: the exact spline bodies, for ParaView.

With every inner knot repeated as often as the degree, each span is a rational Bézier element (Borden, Scott, Evans &
Hughes 2011), which VTK draws, cuts and probes as what it is. Its point data, too, are control values: `displacement`,
and `stress` in its L² projection. They are values of rational functions, so Warp By Vector is exact.
"""

from collections.abc import Sequence
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import (
    VTK_BEZIER_HEXAHEDRON,
    vtkCellArray,
    vtkHigherOrderHexahedron,
    vtkUnstructuredGrid,
)
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

from geom2iga.bspline import Array, Indices, applied, extraction
from geom2iga.files import replacing
from geom2iga.patch import Patch
from post.bezier_size import FIELDS, grid_shape
from post.projected import project_stress
from solve.result import Result


def extracted(patch: Patch, values: Array) -> tuple[Array, Array]:
    """Cut a field on the basis of a volume into Bézier elements.

    Parameters
    ----------
    values : (n, k)
        At the control points of the patch, in its flat numbering.

    Returns
    -------
    values : (m, k)
        At the control points of all elements, a grid of degree times spans + 1 in each direction, last fastest.
    weights : (m,)
        Of these.
    """
    weights = patch.weights[..., None]
    homogeneous = np.concatenate([values.reshape(*patch.shape, -1) * weights, weights], axis=-1)
    for axis, (knots, degree) in enumerate(zip(patch.knots, patch.degrees, strict=True)):
        homogeneous = applied(extraction(knots, degree), homogeneous, axis)
    rows = homogeneous.reshape(-1, homogeneous.shape[-1])
    return rows[:, :-1] / rows[:, -1:], rows[:, -1]


def elements(patch: Patch) -> Indices:
    """Control points (c, a) of the Bézier elements of a volume, each in VTK's sequence; the last direction fastest."""
    shape = grid_shape(patch)
    numbers = np.arange(prod(shape)).reshape(shape)
    first = numbers[tuple(slice(0, -1, p) for p in patch.degrees)].ravel()
    within = numbers[tuple(slice(p + 1) for p in patch.degrees)].ravel()
    return first[:, None] + within[vtk_sequence(patch.degrees)]


def vtk_sequence(degrees: tuple[int, ...]) -> Indices:
    """Tell which control point of an element, the last direction fastest, VTK puts at each place: (a,)."""
    grid = np.ndindex(*(p + 1 for p in degrees))
    place = [vtkHigherOrderHexahedron.PointIndexFromIJK(i, j, k, degrees) for i, j, k in grid]
    return np.argsort(place)


def write_bezier(path: Path, result: Result) -> None:
    """Write the undeformed bodies: point data displacement and stress (projected); cell data body.

    Raises
    ------
    GeometryError
        The stress cannot be projected: see `project_stress`.
    OSError
        VTK cannot write.
    """
    grid = bezier_grid(result)
    with replacing(path) as temporary:
        writer = vtkXMLUnstructuredGridWriter()
        writer.SetFileName(str(temporary))
        writer.SetInputData(grid)
        writer.SetDataModeToAppended()
        writer.EncodeAppendedDataOff()
        writer.SetCompressorTypeToNone()
        writer.SetHeaderTypeToUInt64()
        if not writer.Write():
            raise OSError(f"{path} could not be written: is the disk full?")


def bezier_grid(result: Result) -> vtkUnstructuredGrid:
    """Make VTK's grid of all bodies, as `write_bezier` writes it.

    The number of a body is its place in the case file, from 0.
    """
    bodies = result.model.body_numbers
    patches = [result.model.patches[name] for name in bodies]
    fields = _fields(result, patches)
    grid, points = vtkUnstructuredGrid(), vtkPoints()
    points.SetData(_array(fields["points"]))
    grid.SetPoints(points)
    grid.SetCells(VTK_BEZIER_HEXAHEDRON, _connected(patches))
    data, cells = grid.GetPointData(), grid.GetCellData()
    for name in ("displacement", "stress"):
        data.AddArray(_array(fields[name], name))
    data.SetRationalWeights(_array(fields["RationalWeights"].ravel(), "RationalWeights"))
    counts = [prod(len(at) - 1 for at in patch.breaks) for patch in patches]
    cells.AddArray(_array(np.repeat(np.array(list(bodies.values()), dtype=np.int32), counts), "body"))
    degrees = np.repeat(np.array([patch.degrees for patch in patches], dtype=float), counts, axis=0)
    cells.SetHigherOrderDegrees(_array(degrees, "HigherOrderDegrees"))
    return grid


def _fields(result: Result, patches: Sequence[Patch]) -> dict[str, Array]:
    """Values (m, k) at the control points of all elements."""
    stress = project_stress(result)
    ends = np.cumsum([0, *(prod(grid_shape(patch)) for patch in patches)])
    found = {name: np.empty((ends[-1], width)) for name, width in FIELDS.items()}
    for patch, rows in zip(patches, map(slice, ends[:-1], ends[1:]), strict=True):
        found["points"][rows], found["RationalWeights"][rows, 0] = extracted(patch, patch.control_points)
        found["displacement"][rows], _ = extracted(patch, result.displacement_of(patch.name))
        found["stress"][rows], _ = extracted(patch, stress[patch.name])
    return found


def _connected(patches: Sequence[Patch]) -> vtkCellArray:
    """Control points of all elements."""
    parts, first, lengths = [], 0, []
    for patch in patches:
        part = elements(patch) + first
        lengths.append(np.full(len(part), part.shape[1]))
        parts.append(part.ravel())
        first += prod(grid_shape(patch))
    offsets = np.concatenate([[0], np.cumsum(np.concatenate(lengths))])
    cells = vtkCellArray()
    cells.SetData(numpy_to_vtkIdTypeArray(offsets), numpy_to_vtkIdTypeArray(np.concatenate(parts)))
    return cells


def _array(values: ArrayLike, name: str = "") -> Any:
    """Give an array to VTK, which keeps it alive."""
    array = numpy_to_vtk(np.ascontiguousarray(values))
    array.SetName(name)
    return array
