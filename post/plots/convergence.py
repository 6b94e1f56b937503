"""Errors over the size of meshes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from post.plots.style import GREY, POINTS, Curve, Label, draw_curves, panels, write_labels

MESH_SIZE, ERROR = Label("mesh size $h$"), Label("relative error")
WIDTH = 0.6  # of a triangle, in distances between the last two meshes
BELOW = 0.75  # where it lies, as a factor on the errors


def draw_convergence(
    curves: Sequence[Curve],
    size: Label = MESH_SIZE,
    error: Label = ERROR,
    expected: Sequence[float] | None = None,
) -> Figure:
    """Draw errors over mesh sizes or numbers of unknowns, both logarithmic, with triangles that show the slopes.

    Parameters
    ----------
    curves :
        One per degree: mesh sizes or numbers of unknowns, and errors.
    size, error : Label
    expected :
        Slope of the triangle of each curve, negative over unknowns; left out, the observed one.
    """
    figure, (axes,) = panels()
    axes.set_xscale("log")
    axes.set_yscale("log")
    slopes = [observed_slope(curve) for curve in curves]
    explained = [
        curve._replace(label=f"{curve.label}, observed slope {slope:.2f}".replace("-", "−"))
        for curve, slope in zip(curves, slopes, strict=True)
    ]
    draw_curves(axes, explained)
    for curve, slope in zip(curves, slopes if expected is None else expected, strict=True):
        _draw_triangle(axes, curve, slope)
    axes.margins(0.08)
    low, high = axes.get_xlim()
    if high < 1000 * low:
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    write_labels(axes, size, error)
    return figure


def observed_slope(curve: Curve) -> float:
    """Slope of the straight line through all points, both axes logarithmic: the order, over mesh sizes."""
    return float(np.polyfit(np.log(curve.x), np.log(curve.y), 1)[0])


def _draw_triangle(axes: Axes, curve: Curve, slope: float) -> None:
    """Draw a triangle below the finest two meshes, with its slope."""
    finest = np.argsort(curve.y)[:2]
    start, end = np.sort(np.log(curve.x[finest]))
    middle, half = (start + end) / 2, WIDTH * (end - start) / 2
    left, right = np.exp([middle - half, middle + half])
    height = BELOW * np.exp(np.mean(np.log(curve.y[finest])))
    low, high = (height * (x / np.exp(middle)) ** slope for x in (left, right))
    corner = (right, low) if slope > 0 else (left, high)
    axes.fill(*np.transpose([(left, low), (right, high), corner]), facecolor="none", edgecolor=GREY, linewidth=0.8)
    text, side = f"{slope:.3g}".replace("-", "−"), 4 if slope > 0 else -4
    place = corner[0], np.sqrt(low * high)
    style: dict[str, Any] = {"fontsize": POINTS - 1.5, "color": GREY, "verticalalignment": "center"}
    alignment = "left" if slope > 0 else "right"
    axes.annotate(text, place, (side, 0), textcoords="offset points", horizontalalignment=alignment, **style)
