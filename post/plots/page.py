"""A picture in space on a page: the rendered image at its full resolution, colour bar, directions, remarks."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from geom2iga.bspline import Array
from geom2iga.picture import scene
from geom2iga.picture.scene import Layer
from geom2iga.picture.sheet import draw_axes, place, sheet
from post.plots.style import POINTS, Label, Scale

ROOM = (1270, 1300)  # of the image [pixels]
EDGE = 40  # free around everything [pixels]
TEXT = 50  # height of a line of text with the space around it [pixels]
GAP, BAR, NUMBERS = 60, 40, 190  # before, of and right of the colour bar [pixels]
DIRECTIONS = 250  # height of the arrows along x, y and z below the colour bar [pixels]
LOWEST = 560  # the least height of colour bar and arrows [pixels]
LIGHT = {"ambient": 0.85, "diffuse": 0.15, "specular": 0.0}  # near the colours of the bar, yet edges show
LINE, OUTLINE = {"color": "black"}, {"color": "#666666", "line_width": 1.2}
FRAME: dict[str, Any] = {"fill": False, "edgecolor": "#999999", "linewidth": 0.8}


class Remarks(NamedTuple):
    """What is written above and below a picture."""

    above: str = ""
    below: str = ""


def coloured(mesh: Any, scale: Scale) -> Layer:
    """A mesh in the colours of its "field"; grey where that is no number."""
    colours = {"scalars": "field", "cmap": scale.colours, "clim": scale.limits, "show_scalar_bar": False}
    return Layer(mesh, {**colours, **LIGHT, "nan_color": "#c8c8c8"})


def draw_page(
    layers: Sequence[Layer],
    direction: Sequence[float],
    scale: Scale,
    label: Label,
    remarks: Remarks,
    shown: Array | None = None,
) -> Figure:
    """Render layers as seen from a direction beside a colour bar.

    Parameters
    ----------
    shown : (q, 3)
        What fills the picture, which has a frame then [length]; left out, all.
    """
    points = np.concatenate([np.asarray(layer.mesh.points) for layer in layers]) if shown is None else shown
    camera = scene.aimed(points, direction, ROOM)
    width, height = camera.size
    top, body = EDGE + (TEXT if remarks.above else 0), max(height, LOWEST)
    full = EDGE + width + GAP + BAR + NUMBERS, top + body + (TEXT if remarks.below else 0) + EDGE // 2
    figure, axes = sheet(*full)
    corner = EDGE, top + (body - height) // 2
    place(axes, scene.seen(layers, camera), np.array(corner))
    if shown is not None:
        axes.add_patch(Rectangle(corner, width, height, **FRAME))
    left = EDGE + width + GAP
    draw_axes(axes, camera, left + 60, top + body - 85)
    for text, y in ((remarks.above, EDGE / 2 + TEXT / 2), (remarks.below, top + body + TEXT / 2)):
        axes.text(EDGE, y, text, size=POINTS, verticalalignment="center_baseline")
    _draw_bar(figure, np.array([left, top + 20, BAR, body - DIRECTIONS]), np.array(full), scale, label)
    return figure


def _draw_bar(figure: Figure, box: Array, page: Array, scale: Scale, label: Label) -> None:
    """Draw the colour bar in a box, left, top, width and height, on a page [pixels]."""
    left, top, width, height = box / np.tile(page, 2)
    draw_bar(figure, scale, label, cax=figure.add_axes((left, 1 - top - height, width, height)))


def draw_bar(figure: Figure, scale: Scale, label: Label, **where: Any) -> None:
    """Draw a colour bar; a power of ten of very large or very small numbers goes into the unit."""
    power = scale.power
    low, high = (limit / 10.0**power for limit in scale.limits)
    norm = Normalize(low, high)
    bar = figure.colorbar(ScalarMappable(norm, scale.colours), **where)
    bar.set_label(label.text(power), fontsize=POINTS)
    bar.ax.tick_params(labelsize=POINTS - 0.5)
    bar.ax.ticklabel_format(useOffset=False, style="plain")
