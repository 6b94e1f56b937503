"""Surfaces of bodies rendered off screen by pyvista, as images."""

import ctypes
import os
import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geom2iga.bspline import Array, Indices
from geom2iga.errors import UserError

if sys.platform == "linux":
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")  # renders without a display

import pyvista

Image = NDArray[np.uint8]
SIZE = (1600, 1300)
COLOURS = "viridis"
VIEW = [(1.0, -2.0, 0.9), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]  # from the front, right and above


def check_renderer() -> None:
    """Raise UserError where the libraries that VTK needs to draw are missing: it would die without a word."""
    if sys.platform != "linux":
        return
    for library in ("libEGL.so.1", "libGL.so.1"):
        try:
            ctypes.CDLL(library)
        except OSError:
            raise UserError(
                f"pictures need {library}: on Debian or Ubuntu, apt install libegl1 libgl1 libegl-mesa0; "
                "or set pictures = false in [post]"
            ) from None


def coloured(points: Array, cells: Indices, values: Array) -> pyvista.PolyData:
    """Make a mesh of quadrilaterals (c, 4) between points (q, 3), with a field (q,)."""
    mesh = pyvista.PolyData(points, np.insert(cells, 0, 4, axis=1).ravel())
    mesh["field"] = values
    return mesh


def polylines(points: Sequence[Array]) -> pyvista.PolyData:
    """Make a mesh of polylines, each through points (q, 3)."""
    starts = np.cumsum([0, *(len(line) for line in points)])
    lines = [
        np.concatenate([[len(line)], start + np.arange(len(line))]) for line, start in zip(points, starts, strict=False)
    ]
    return pyvista.PolyData(np.concatenate(points), lines=np.concatenate(lines))


def render(
    surface: pyvista.PolyData, limits: tuple[float, float], lines: pyvista.PolyData, outline: pyvista.PolyData | None
) -> Image:
    """Render a coloured surface with black lines on it, and grey outlines around it; white margins are cut off."""
    plotter = pyvista.Plotter(off_screen=True, window_size=list(SIZE), lighting="three lights")
    plotter.set_background("white")
    plotter.enable_anti_aliasing("msaa", multi_samples=8)
    light = {"ambient": 0.85, "diffuse": 0.15, "specular": 0.0}  # near the colours of the bar, yet edges show
    actor = plotter.add_mesh(surface, scalars="field", cmap=COLOURS, clim=limits, show_scalar_bar=False, **light)
    actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()  # lines on the surface are in front of it
    actor.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(1, 1)
    plotter.add_mesh(lines, color="black", line_width=2.5)
    if outline is not None:
        plotter.add_mesh(outline, color="#666666", line_width=2)
    plotter.add_axes(line_width=5, color="black")
    plotter.enable_parallel_projection()
    plotter.camera_position = VIEW
    plotter.reset_camera()
    image = plotter.screenshot(return_img=True)
    plotter.close()
    used = np.argwhere((image < 255).any(axis=2))
    (top, left), (bottom, right) = used.min(axis=0), used.max(axis=0) + 1
    return image[top:bottom, left:right]
