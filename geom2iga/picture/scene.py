"""Surfaces of bodies rendered off screen by pyvista, as images; figures written to files."""

import ctypes
import os
import sys
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from geom2iga.bspline import Array, Indices
from geom2iga.errors import UserError
from geom2iga.files import replacing

if sys.platform == "linux":
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")  # renders without a display

import pyvista

Image = NDArray[np.uint8]
DPI = 200  # of files
SHOWN = 100  # of pictures in notebooks
SETTINGS: Mapping[str, Mapping[str, Any]] = {  # of each format: quick and as small as may be, and without the date
    ".png": {"pil_kwargs": {"compress_level": 3}},
    ".svg": {"metadata": {"Date": None}},
    ".pdf": {"metadata": {"CreationDate": None}},
}
FILES: Any = {"svg.hashsalt": "geom2iga", "svg.fonttype": "none", "pdf.fonttype": 42}  # text stays text
ABOVE = (1.0, -2.0, 0.9)  # seen from the front, right and above
FINER = 2  # pixels rendered for one of the image, along each side: smooth lines with any driver
STEEP = 1e-6  # sine of the angle to z below which a direction is along z
MARGIN = 12  # white around what is aimed at [pixels]


@dataclass(frozen=True, eq=False)
class Camera:
    """A parallel projection onto an image, z upwards; seen along z, y.

    Parameters
    ----------
    direction : (3,)
        From the scene towards the viewer.
    centre : (3,)
        What is seen in the middle of the image [length].
    scale : float
        Length of one pixel [length].
    size : (2,)
        Width and height of the image [pixels].
    """

    direction: Array
    centre: Array
    scale: float
    size: tuple[int, int]

    def pixels(self, points: Array) -> Array:
        """Project points (q, 3) to pixels (q, 2) from the upper left corner: rightwards, downwards."""
        return (points - self.centre) @ screen(self.direction)[:2].T / self.scale + np.array(self.size) / 2


def aimed(points: Array, direction: Sequence[float], room: tuple[int, int]) -> Camera:
    """Choose the camera that sees points (q, 3) as large as a room of width and height [pixels] allows."""
    towards = np.array(direction) / np.abs(direction).max()
    axes = screen(towards)
    seen = points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    scale = float(((high - low)[:2] / (np.array(room) - 2 * MARGIN)).max())
    width, height = (np.ceil((high - low)[:2] / scale) + 2 * MARGIN).astype(int)
    return Camera(towards, (low + high) / 2 @ axes, scale, (int(width), int(height)))


def screen(direction: Array) -> Array:
    """Return the unit vectors (3, 3) that are seen pointing rightwards, downwards and towards the viewer."""
    along_z = np.hypot(direction[0], direction[1]) < STEEP * np.linalg.norm(direction)
    right = np.cross([0.0, 1.0, 0.0] if along_z else [0.0, 0.0, 1.0], direction)
    axes = np.stack([right, np.cross(right, direction), direction])
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


@dataclass(frozen=True, eq=False)
class Layer:
    """A mesh and how pyvista draws it."""

    mesh: pyvista.DataSet
    style: Mapping[str, Any]


def check_renderer(otherwise: str) -> None:
    """Raise UserError where the libraries that VTK needs to draw are missing: it would die without a word."""
    if sys.platform != "linux":
        return
    for library in ("libEGL.so.1", "libGL.so.1"):
        try:
            ctypes.CDLL(library)
        except OSError:
            raise UserError(
                f"pictures need {library}: on Debian or Ubuntu, apt install libegl1 libgl1 libegl-mesa0; or {otherwise}"
            ) from None


def quadrilaterals(points: Array, cells: Indices, **fields: Any) -> pyvista.PolyData:
    """Make a mesh of quadrilaterals (c, 4) between points (q, 3), with fields (q, ...) or (c, ...)."""
    mesh = pyvista.PolyData(points, np.insert(cells, 0, 4, axis=1).ravel())
    for name, values in fields.items():
        mesh[name] = values
    return mesh


def polylines(points: Sequence[Array], **fields: Any) -> pyvista.PolyData:
    """Make a mesh of polylines, each through points (q, 3), with fields (q, ...) of all points."""
    starts = np.cumsum([0, *(len(line) for line in points)])
    lines = [
        np.concatenate([[len(line)], start + np.arange(len(line))]) for line, start in zip(points, starts, strict=False)
    ]
    mesh = pyvista.PolyData(np.concatenate(points), lines=np.concatenate(lines))
    for name, values in fields.items():
        mesh[name] = values
    return mesh


def merged(meshes: Sequence[pyvista.PolyData]) -> pyvista.PolyData:
    """Make one mesh of several; points at the same place stay apart."""
    return meshes[0].append_polydata(*meshes[1:])


def dots(points: Array) -> pyvista.PolyData:
    """Make a mesh of single points (q, 3)."""
    return pyvista.PolyData(points)


def seen(layers: Sequence[Layer], camera: Camera) -> Image:
    """Render what a camera sees of several layers on white; widths of lines and sizes of points are in its pixels."""
    width, height = camera.size
    fine = replace(camera, scale=camera.scale / FINER, size=(FINER * width, FINER * height))
    plotter = _plotter(fine.size)
    for layer in layers:
        widths = {key: FINER * layer.style[key] for key in ("line_width", "point_size") if key in layer.style}
        _add(plotter, Layer(layer.mesh, {**layer.style, **widths}))
    _aim(plotter, fine)
    image = _shot(plotter)
    total = np.zeros((height, width, 3), np.uint16)
    for row, column in np.ndindex(FINER, FINER):
        total += image[row::FINER, column::FINER]
    return (total // FINER**2).astype(np.uint8)


def seen_numbers(mesh: pyvista.PolyData, numbers: Indices, camera: Camera) -> Indices:
    """Find the number (>= 0) of the cell that is seen in each pixel (height, width), -1 where there is none."""
    plotter = _plotter(camera.size)
    plotter.set_background("black")
    codes = (numbers[:, None] + 1 >> np.array([16, 8, 0])) & 255
    plain = mesh.copy()
    plain.cell_data["code"] = codes.astype(np.uint8)
    plotter.add_mesh(plain, scalars="code", rgb=True, lighting=False)
    _aim(plotter, camera)
    return _shot(plotter).astype(np.int64) @ np.array([65536, 256, 1]) - 1


class Picture(Figure):
    """A figure that notebooks show as it is, without matplotlib's way of keeping figures."""

    def _repr_png_(self) -> bytes:
        file = BytesIO()
        self.savefig(file, format="png", dpi=SHOWN)
        return file.getvalue()


def save(figure: Figure, path: Path) -> None:
    """Write a figure; the ending of the name says in which format. The same figure makes the same bytes."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)  # once; matplotlib itself would draw all images to lay it out, then draw them again
        figure.set_layout_engine(None)
    with replacing(path) as temporary, rc_context(FILES), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # names may hold any letters, fonts do not
        figure.savefig(temporary, dpi=DPI, **SETTINGS.get(path.suffix, {}))


def _plotter(size: tuple[int, int]) -> pyvista.Plotter:
    plotter = pyvista.Plotter(off_screen=True, window_size=list(size), lighting="three lights")
    plotter.set_background("white")
    plotter.disable_anti_aliasing()  # pixels are finer than those of the image instead
    plotter.render_window.SetMultiSamples(0)
    plotter.enable_parallel_projection()
    return plotter


def _add(plotter: pyvista.Plotter, layer: Layer) -> None:
    """Draw a layer; lines and points on a surface are in front of it."""
    actor = plotter.add_mesh(layer.mesh, **layer.style)
    if "Normals" in layer.mesh.point_data:
        actor.prop.interpolation = "Phong"
    if layer.mesh.get_cell(0).dimension == 2:
        actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
        actor.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(1, 32)


def _aim(plotter: pyvista.Plotter, camera: Camera) -> None:
    """Look through a camera."""
    _, down, towards = screen(camera.direction)
    far = plotter.length + float(np.linalg.norm(camera.centre - np.array(plotter.center)))  # before everything
    plotter.enable_parallel_projection()
    plotter.camera_position = [camera.centre + far * towards, camera.centre, -down]
    plotter.camera.parallel_scale = camera.scale * camera.size[1] / 2
    plotter.reset_camera_clipping_range()


def _shot(plotter: pyvista.Plotter) -> Image:
    """Take the picture and end the plotter."""
    image: Image = plotter.screenshot(return_img=True)
    plotter.close()
    return image
