"""Pairs of bodies whose faces are curved, for the tests of the contact integration."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from geom2iga.bspline import Array, Indices, open_knots
from geom2iga.model import Model
from geom2iga.patch import Face, Patch, basis, elevated, refined
from geom2iga.sphere import spherical_patch
from solve.contact.cells import Cells, segment_cells
from solve.face import Surface, surface_of
from tests.cases import block_patch, hollow_cylinder, model_of, turned

CUBE = 3**-0.5  # half the edge of a cube whose corners lie on the unit sphere


def rings(degrees: tuple[int, int], spans: tuple[int, int], gap: float = 0.0) -> Model:
    """A quarter ring "inner" in another one "outer"."""
    rings = (hollow_cylinder(1.0, 2.0, 3.0, name="inner"), hollow_cylinder(2.0 + gap, 3.0, 3.0, name="outer"))
    return model_of(*(refined(elevated(r, (p,) * 3), spans=s) for r, p, s in zip(rings, degrees, spans, strict=True)))


def shell(name: str, radii: tuple[float, float], spans: int, width: float = 0.5, turn: Rotation | None = None) -> Patch:
    """A piece of a hollow sphere about z between great circles through the corners (±width, ±width, z)."""
    corners = np.array([[x, y, np.sqrt(1 - 2 * width**2)] for x in (-width, width) for y in (-width, width)])
    surface = spherical_patch([_arc(*corners[pair]) for pair in ([0, 2], [1, 3], [0, 1], [2, 3])], (0, 0, 0), 1.0)
    points = np.stack([radius * surface.control_points for radius in radii], axis=2)
    knots = (*surface.knots, open_knots([0, 1], 1))
    whole = Patch(name, (*surface.degrees, 1), knots, points, np.stack([surface.weights] * 2, axis=2))
    inner = np.arange(1, spans) / spans
    return turned(refined(whole, knots=[inner, inner, []]), turn)


def _arc(start: Array, end: Array) -> Patch:
    """The great circle between two points of the unit sphere."""
    middle = (start + end) / np.linalg.norm(start + end)
    cosine = float(start @ middle)
    return Patch("arc", (2,), (open_knots([0, 1], 2),), np.stack([start, middle / cosine, end]), [1, cosine, 1])


def shells(
    spans: tuple[int, int], gap: float = 0.0, turn: Rotation | None = None, widths: tuple[float, float] = (0.5, 0.5)
) -> Model:
    """A piece of a hollow sphere "inner", turned, in another one "outer"."""
    inner = shell("inner", (0.5, 1.0), spans[0], widths[0], turn)
    return model_of(inner, shell("outer", (1.0 + gap, 1.5), spans[1], widths[1]))


def whole_spheres(spans: tuple[int, int], gap: float, turn: Rotation) -> Model:
    """A hollow sphere of six patches, turned, in another one, which meet at the groups "inner" and "outer"."""
    sides = [Rotation.from_euler("x", angle, degrees=True) for angle in (0, 180)]
    upright = Rotation.from_euler("x", 90, degrees=True)
    sides += [Rotation.from_euler("z", angle, degrees=True) * upright for angle in (0, 90, 180, 270)]
    inner = [shell(f"inner{n}", (0.5, 1.0), spans[0], CUBE, turn * side) for n, side in enumerate(sides)]
    outer = [shell(f"outer{n}", (1.0 + gap, 1.5), spans[1], CUBE, side) for n, side in enumerate(sides)]
    groups = {
        name: tuple(Face(patch.name, 2, side) for patch in patches)
        for name, patches, side in (("inner", inner, 1), ("outer", outer, 0))
    }
    bodies = {name: tuple(face.patch for face in faces) for name, faces in groups.items()}
    groups["one of six"] = groups["inner"][:1]
    return Model({patch.name: patch for patch in (*inner, *outer)}, bodies, groups)


def waves(degree: int, spans: Sequence[tuple[int, int]], angle: float, size: float, gap: float = 0.3) -> Model:
    """A turned block "upper" above a block "lower" of 2 x 2, their faces wavy B-spline sheets."""
    lower = _wavy("lower", 2.0, degree, spans[0], 0.0, 0.0, True)
    upper = _wavy("upper", size, degree, spans[1], 1.0, gap, False)
    return model_of(lower, turned(upper, Rotation.from_euler("z", angle, degrees=True)))


def _wavy(name: str, size: float, degree: int, spans: tuple[int, int], phase: float, z: float, top: bool) -> Patch:
    block = block_patch(name, (-size / 2, -size / 2, z - top), (size, size, 1), (degree, degree, 1), (*spans, 1))
    points = block.control_points.copy()
    x, y = points[:, :, int(top), :2].transpose(2, 0, 1)
    points[:, :, int(top), 2] += 0.1 * np.sin(2.5 * x + phase) * np.cos(2 * y - phase)
    return replace(block, control_points=points)


def sides(model: Model, secondary: str, primary: str) -> tuple[Surface, Surface]:
    """The two faces of a contact as oriented surfaces."""
    return (surface_of(model, model.faces(secondary)[0]), surface_of(model, model.faces(primary)[0]))


def segments(secondary: Surface, primary: Surface, points: int | None = None) -> Cells:
    """Cells of one pair of faces."""
    (cells,) = segment_cells(secondary, [primary], points)
    return cells


def dense(patch: Patch, xi: Array, spans: Indices | None = None) -> Array:
    """All basis functions of a surface at points, (q, n)."""
    functions = basis(patch, xi, spans=spans)
    values = np.zeros((len(xi), patch.weights.size))
    np.put_along_axis(values, functions.indices, functions.values, axis=1)
    return values


def products(cells: Cells, secondary: Surface, primary: Surface) -> Array:
    """Integrals of every secondary times every primary basis function."""
    values = dense(secondary.patch, cells.secondary_xi, cells.secondary_spans)
    return (values * cells.area[:, None]).T @ dense(primary.patch, cells.primary_xi, cells.primary_spans)


def averages(cells: Cells, secondary: Surface) -> Array:
    """Integrals of every secondary basis function, and of its product with the gap, (n, 2)."""
    values = dense(secondary.patch, cells.secondary_xi, cells.secondary_spans)
    return values.T @ np.stack([cells.area, cells.area * cells.gap], axis=1)
