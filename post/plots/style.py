"""What all pictures have in common: colours that the colour-blind tell apart, axes, scales of colours, curves."""

from collections.abc import Iterator, Sequence
from itertools import count
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LinearSegmentedColormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

from geom2iga.bspline import Array
from geom2iga.picture.scene import Picture
from geom2iga.picture.sheet import plain
from geom2iga.tables import Units

NO_UNITS = Units()

# Okabe and Ito, Color Universal Design, 2008, the darker ones first; lines differ in style and marker, too
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DASHES = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)), (0, (8, 3)), (0, (3, 1, 1, 1)), (0, (2, 4)))
BLACK, GREY, PALE = "#000000", "#666666", "#d9d9d9"

SIZE = (5.0, 3.4)  # of a figure of one panel, which a column of a journal shows at two thirds [inches]
POINTS = 9.5  # size of text

# blue, white, brown: ends light enough for black lines on them; the brown end is the lighter one, also without colours
DIVERGING = LinearSegmentedColormap.from_list(
    "diverging", ["#1f5a94", "#5b9bc9", "#b5d3e7", "#f7f7f7", "#fbd3a2", "#eaa04f", "#cf7a1c"]
)
DARKEST = 0.12  # where on matplotlib's viridis colours begin: black lines are lost on darker ones
SEQUENTIAL = ListedColormap(colormaps["viridis"](np.linspace(DARKEST, 1, 256)), "sequential")
UNIFORM = 1e-6  # a field whose range is below this fraction of its size is drawn as uniform
BALANCED = 0.1  # a field whose smaller side of zero is this fraction of the larger one is drawn in diverging colours


class Curve(NamedTuple):
    """A line or a row of points of a picture, x and y both (q,), and what the legend says of it."""

    label: str
    x: Array
    y: Array


class Scale(NamedTuple):
    """Range of a field, its colours, and a remark on a field that is uniform or goes beyond."""

    limits: tuple[float, float]
    colours: Colormap
    remark: str = ""

    @property
    def power(self) -> int:
        """The power of ten, a multiple of three, that keeps numbers on the colour bar short; mostly 0."""
        exponent = int(np.floor(np.log10(max(map(abs, self.limits)))))
        return 0 if -2 <= exponent < 4 else exponent // 3 * 3


class Label(NamedTuple):
    """What is drawn, and in which unit, which may be empty."""

    title: str
    unit: str = ""

    def text(self, power: int = 0) -> str:
        """Title and unit, of a power of ten."""
        unit = " ".join(part for part in (f"$10^{{{power}}}$" if power else "", plain(self.unit)) if part)
        return f"{self.title} [{unit}]" if unit else self.title


def scale_of(values: Array, size: float, signed: bool) -> Scale:
    """Choose the colours of a field.

    Parameters
    ----------
    values : (q,)
        Some may be no numbers.
    size :
        Against which a range counts as uniform, such as the largest component of the stress.
    signed :
        Whether zero is a value amid others: with values on both sides of it, colours diverge from white at zero and
        are as strong on both sides, which the range cuts off.
    """
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if high - low <= UNIFORM * size or high == low:
        margin = 0.05 * size or 1.0
        remark = f"uniform, {(low + high) / 2:.6g} ± {(high - low) / 2:.1e}".replace("-", "−")
        return Scale((low - margin, high + margin), SEQUENTIAL, remark)
    if not signed or min(-low, high) < BALANCED * max(-low, high):
        return Scale((low, high), SEQUENTIAL)
    largest = max(-low, high)
    used = 0.5 + 0.5 * np.linspace(low / largest, high / largest, 256)
    return Scale((low, high), ListedColormap(DIVERGING(used), "diverging"))


def scale_between(limits: tuple[float, float], values: Array, signed: bool) -> Scale:
    """Choose the colours of a field between limits that are given, and remark on values beyond; see `scale_of`."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    inside = limits[0] <= low and high <= limits[1]
    remark = "" if inside else f"values from {low:.4g} to {high:.4g}".replace("-", "−")
    return scale_of(np.array(limits), 0.0, signed)._replace(remark=remark)


def panels(rows: int = 1, columns: int = 1, size: tuple[float, float] = SIZE) -> tuple[Figure, list[Axes]]:
    """Make a figure of panels, whose size is that of one; those below each other share their horizontal axis."""
    figure = Picture(figsize=(columns * size[0], size[1] * (0.4 + 0.6 * rows)), layout="constrained")
    every = figure.subplots(rows, columns, sharex="col", squeeze=False).ravel().tolist()
    for axes in every:
        axes.grid(alpha=0.3, linewidth=0.6)
        axes.tick_params(labelsize=POINTS - 0.5)
        axes.set_axisbelow(True)
    return figure, every


def write_labels(axes: Axes, x: Label | None = None, y: Label | None = None, outside: bool = False) -> None:
    """Name the axes, and explain the curves where there are several, above the panel if `outside`."""
    if x:
        axes.set_xlabel(x.text(), fontsize=POINTS)
    if y:
        axes.set_ylabel(y.text(), fontsize=POINTS)
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "linear":
            axis.set_major_formatter(_numbers())
            axis.get_offset_text().set_fontsize(POINTS - 0.5)
    if outside:
        axes.legend(frameon=False, fontsize=POINTS - 1, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)
    elif len(axes.get_legend_handles_labels()[1]) > 1:
        axes.legend(frameon=False, fontsize=POINTS - 1)


def _numbers() -> ScalarFormatter:
    """Numbers whose power of ten, if it is large, stands at the end of the axis."""
    formatter = ScalarFormatter(useOffset=False, useMathText=True)
    formatter.set_powerlimits((-3, 4))
    return formatter


def line_styles(markers: bool = True) -> Iterator[dict[str, Any]]:
    """Yield, without end, keywords that make each line differ from the others in colour, dashes and marker."""
    for number in count():
        style: dict[str, Any] = {
            "color": PALETTE[number % len(PALETTE)],
            "linestyle": DASHES[number % len(DASHES)],
            "linewidth": 1.4,
        }
        if markers:
            style |= {"marker": MARKERS[number % len(MARKERS)], "markersize": 4.5}
        yield style


def draw_curves(axes: Axes, curves: Sequence[Curve], markers: bool = True) -> None:
    """Draw curves, each in a style of its own."""
    for curve, style in zip(curves, line_styles(markers), strict=False):
        label = f" {curve.label}" if curve.label.startswith("_") else curve.label  # which matplotlib would leave out
        axes.plot(curve.x, curve.y, label=label, **style)
