"""A page for pictures: images at their full resolution, with title, labels, legend and axes in pixels."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.textpath import TextPath

from geom2iga.bspline import Array
from geom2iga.picture.labels import arranged
from geom2iga.picture.scene import DPI, Camera, Image, Picture, screen

NARROWEST = 1600.0  # page [pixels]
POINTS = 9.5  # size of text
LINE = 34.0  # height of a line of text [pixels]
EDGE = 40.0  # free around everything [pixels]
SWATCH = 22.0  # side of the coloured square before an entry of a legend [pixels]
LETTERS = 24  # in a line of a label, unless a word is longer
AXES = (("x", "#c0392b"), ("y", "#2e8b3d"), ("z", "#1f4e9e"))
HALO = [withStroke(linewidth=3.0, foreground="white")]

HEADER = 100.0  # height of the title [pixels]
FOOTER = 170.0  # height of the axes and of the caption below a view [pixels]
LEADER = 80.0  # between a view and its labels [pixels]

Style = dict[str, Any]  # what matplotlib takes as keywords
Entry = tuple[Any, str]  # colour and text of a line of a legend


@dataclass(frozen=True, eq=False)
class Label:
    """A text beside a view that points to a place in space [length]; `seen` is False where that is hidden."""

    text: str
    colour: Any
    point: Array
    seen: bool


@dataclass(frozen=True, eq=False)
class View:
    """What a camera saw, what to say of it, and the labels of what it shows."""

    image: Image
    camera: Camera
    caption: str = ""
    labels: Sequence[Label] = ()


def draw_page(views: Sequence[View], title: str, entries: Sequence[Entry], remark: str) -> Figure:
    """Draw views side by side with their labels, below a title, above a legend and a remark."""
    panels = [_panel_width(view) for view in views]
    width = max(sum(panels), NARROWEST)
    height = max(max(view.camera.size[1], *map(_column_height, _sides(view))) for view in views)
    legend = legend_height(entries, width - 2 * EDGE)
    below = HEADER + height + FOOTER
    figure, axes = sheet(width, below + legend + LINE + EDGE)
    write(axes, width / 2, HEADER / 2, title, size=1.3 * POINTS, horizontalalignment="center")
    spare = (width - sum(panels)) / len(views)
    for number, view in enumerate(views):
        left = sum(panels[:number]) + number * spare
        middle = left + spare / 2 + _column_width(_sides(view)[0]) + view.camera.size[0] / 2
        _draw_view(axes, view, middle, height)
        draw_axes(axes, view.camera, left + EDGE + 80, below - 80)
        write(axes, middle, HEADER + height + LINE, view.caption, horizontalalignment="center", color="#444444")
    draw_legend(axes, entries, EDGE, below, width - 2 * EDGE)
    write(axes, EDGE, below + legend + LINE, remark, color="#444444")
    return figure


def _draw_view(axes: Axes, view: View, middle: float, height: float) -> None:
    """Draw an image and its labels in a panel of this height below the title."""
    size = np.array(view.camera.size)
    corner = np.round([middle - size[0] / 2, HEADER + (height - size[1]) / 2])
    place(axes, view.image, corner)
    for side, labels in zip((-1, 1), _sides(view), strict=True):
        edge = middle + side * (size[0] / 2 + LEADER)
        points = view.camera.pixels(np.array([label.point for label in labels]).reshape(-1, 3)) + corner
        heights = np.array([text_height(label.text) for label in labels])
        for number, y in zip(*arranged(points, heights, edge, HEADER, height), strict=True):
            draw_label(axes, labels[number], (edge, y), side, points[number])


def _sides(view: View) -> tuple[list[Label], list[Label]]:
    """Split the labels into those that point into the left and into the right half of a view."""
    half = view.camera.size[0] / 2
    left = [label for label in view.labels if view.camera.pixels(label.point)[0] < half]
    return left, [label for label in view.labels if label not in left]


def _panel_width(view: View) -> float:
    return view.camera.size[0] + sum(map(_column_width, _sides(view)))


def _column_width(labels: Sequence[Label]) -> float:
    return max((text_width(label.text) + LEADER for label in labels), default=0.0) + EDGE


def _column_height(labels: Sequence[Label]) -> float:
    return sum(text_height(label.text) for label in labels)


def sheet(width: float, height: float) -> tuple[Figure, Axes]:
    """Make a figure whose axes count pixels from its upper left corner."""
    figure = Picture(figsize=(width / DPI, height / DPI), dpi=DPI)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    axes.set_autoscale_on(False)
    return figure, axes


def place(axes: Axes, image: Image, corner: Array) -> None:
    """Put an image where its upper left corner is given, pixel by pixel."""
    x, y = np.round(corner)
    extent = (x, x + image.shape[1], y + image.shape[0], y)
    axes.imshow(image, extent=extent, aspect="auto", interpolation="none")


def write(axes: Axes, x: float, y: float, text: str, **style: Any) -> None:
    """Write text whose middle is at a height; names are no formulas."""
    axes.text(x, y, plain(text), **{"size": POINTS, "verticalalignment": "center_baseline", **style})


def text_width(text: str) -> float:
    """Width of the longest line of a text [pixels]."""
    lines = [line for line in plain(text).splitlines() if line.strip()]
    return max((TextPath((0, 0), line, size=POINTS).get_extents().width for line in lines), default=0.0) * DPI / 72


def wrapped(text: str) -> str:
    r"""Break a long label into lines, after spaces and slashes.

    >>> wrapped("lower/top, contact surface of the punch")
    'lower/top, contact\nsurface of the punch'
    """
    lines = [""]
    for piece in re.split(r"(?<=[/ ])", text):
        if lines[-1] and len((lines[-1] + piece).rstrip()) > LETTERS:
            lines.append("")
        lines[-1] += piece
    return "\n".join(line.rstrip() for line in lines)


def text_height(text: str) -> float:
    """Height of a text with the space around it [pixels]."""
    return (text.count("\n") + 1) * LINE + 14


def draw_axes(axes: Axes, camera: Camera, x: float, y: float, length: float = 80.0) -> None:
    """Draw how x, y and z are seen, from one point [pixels]."""
    for (name, colour), (right, down) in zip(AXES, screen(camera.direction)[:2].T * length, strict=True):
        arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.8, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (x + right, y + down), (x, y), arrowprops=arrow)
        stretch = 1 + 24 / max(np.hypot(right, down), 1)
        write(axes, x + right * stretch, y + down * stretch, name, color=colour, horizontalalignment="center")


def legend_height(entries: Sequence[Entry], width: float) -> float:
    """Height that a legend of this width takes up [pixels]."""
    return -(-len(entries) // _columns(entries, width)) * LINE


def draw_legend(axes: Axes, entries: Sequence[Entry], x: float, y: float, width: float) -> None:
    """Draw a legend below a height, in as many columns as fit."""
    columns = _columns(entries, width)
    rows = -(-len(entries) // columns)
    for number, (colour, text) in enumerate(entries):
        left, middle = x + number // rows * width / columns, y + (number % rows + 0.5) * LINE
        box = (left, middle - SWATCH / 2)
        axes.add_patch(Rectangle(box, SWATCH, SWATCH, facecolor=colour, edgecolor="#444444", linewidth=0.6))
        write(axes, left + SWATCH + 14, middle, text)


def draw_label(axes: Axes, label: Label, at: tuple[float, float], side: int, point: Array) -> None:
    """Draw a label to the left (side -1) or right (1) of a place, and a line from there to a point [pixels]."""
    line: Style = {"color": "black", "linewidth": 0.9, "linestyle": "-" if label.seen else (0, (4, 3))}
    axes.plot([at[0], point[0]], [at[1], point[1]], zorder=3, path_effects=HALO, **line)
    dot: Style = {"markersize": 4, "markeredgecolor": "black", "markerfacecolor": "black" if label.seen else "white"}
    axes.plot(*point, "o", zorder=4, **dot)
    box = {"boxstyle": "round,pad=0.25", "facecolor": label.colour, "edgecolor": "black", "linewidth": 0.7}
    style = {"horizontalalignment": "left" if side > 0 else "right", "verticalalignment": "center"}
    write(axes, at[0] + side * 6, at[1], label.text, zorder=5, bbox=box, linespacing=1.1, **style)


def _columns(entries: Sequence[Entry], width: float) -> int:
    widest = max(text_width(text) for _, text in entries) + SWATCH + 14 + EDGE
    return max(1, min(len(entries), int(width // widest)))


def plain(text: str) -> str:
    """Write a name so that matplotlib reads no formulas in it."""
    return text.replace("$", r"\$")
