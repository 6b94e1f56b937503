"""Curves: pressure against a closed form, fields along lines and over load steps, sweeps."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from geom2iga.bspline import Array
from geom2iga.picture.sheet import plain
from geom2iga.tables import Units
from post.plots.style import NO_UNITS, Curve, Label, draw_curves, line_styles, panels, write_labels
from post.quantities import QUANTITIES

CLOSED_FORM = 501  # points of its curve
DIMENSIONS = {"length": "displacement", "stress": "stress"}


def draw_profile(
    curves: Sequence[Curve],
    exact: Callable[[Array], Array],
    units: Units = NO_UNITS,
    errors: bool = False,
    along: str = "distance from the middle of contact",
) -> Figure:
    """Draw contact pressure over distance as points, on the curve of a closed form.

    Parameters
    ----------
    curves :
        Distances [length], in any sequence, and pressures of sample points.
    exact :
        Pressure at distances.
    units : Units
    errors :
        Whether a second panel shows how far the pressures are from the closed form, over its largest value.
    along : str
        What the distances are.
    """
    figure, (axes, *others) = panels(2 if errors else 1)
    every = np.concatenate([curve.x for curve in curves])
    line = np.linspace(min(0.0, every.min()), every.max(), CLOSED_FORM)
    axes.plot(line, exact(line), color="black", linewidth=1.2, zorder=3, label="closed form")
    for curve, style in zip(curves, line_styles(), strict=False):
        points = {**style, "linestyle": "none", "markersize": 2.5, "markeredgewidth": 0}
        axes.plot(curve.x, curve.y, label=curve.label, **points)
        for panel in others:
            panel.plot(curve.x, 100 * (curve.y - exact(curve.x)) / np.max(exact(line)), **points)
    below = (others or [axes])[-1]
    write_labels(axes, y=Label("contact pressure $p$", units.stress))
    write_labels(below, Label(along, units.length), Label("error over\nlargest pressure", "%") if errors else None)
    return figure


def draw_line(
    distance: Array, fields: Mapping[str, Array], units: Units = NO_UNITS, bodies: Sequence[str] = ()
) -> Figure:
    """Draw fields along a line, displacements above stresses; a curve for each body, with gaps outside it.

    Parameters
    ----------
    distance : (q,)
        From the first point [length].
    fields : of (q,)
        Values by keys of `QUANTITIES`; not a number where there is no body.
    units : Units
    bodies : (q,)
        Names of the bodies that hold the points, empty outside; left out, there is one body.
    """
    return _draw_fields(distance, fields, Label("distance along the line", units.length), units, bodies)


def draw_point(load_factors: Array, fields: Mapping[str, Array], units: Units = NO_UNITS) -> Figure:
    """Draw fields at a point over the share of the loads (s,); see `draw_line`."""
    return _draw_fields(load_factors, fields, Label("share of the loads"), units, markers=True)


def draw_sweep(curves: Sequence[Curve], parameter: Label, quantity: Label, log: str = "") -> Figure:
    """Draw a quantity over a parameter; unless it is logarithmic, with the mean and the range of each curve.

    Parameters
    ----------
    curves :
        Values of the parameter and of the quantity.
    parameter, quantity : Label
    log : str
        Which axes are logarithmic: any of the letters x and y.
    """
    figure, (axes,) = panels()
    axes.set_xscale("log" if "x" in log else "linear")
    axes.set_yscale("log" if "y" in log else "linear")
    if "y" not in log:
        for curve, style in zip(curves, line_styles(), strict=False):
            axes.axhline(float(np.nanmean(curve.y)), color=style["color"], linewidth=0.6, alpha=0.7)
        curves = [curve._replace(label=f"{curve.label}: {_spread(curve.y)}") for curve in curves]
    draw_curves(axes, curves)
    write_labels(axes, parameter, quantity, outside=True)
    return figure


def _spread(values: Array) -> str:
    """Mean and range, and this in percent of the mean."""
    mean, extent = float(np.nanmean(values)), float(np.nanmax(values) - np.nanmin(values))
    share = f" ({100 * extent / abs(mean):.2g} %)" if mean else ""
    return f"mean {mean:.4g}, range {extent:.2g}{share}"


def _draw_fields(
    x: Array, fields: Mapping[str, Array], along: Label, units: Units, bodies: Sequence[str] = (), markers: bool = False
) -> Figure:
    """Draw fields over x, in one panel for each dimension, and a curve for each body if there are several."""
    found = {name: [key for key in fields if QUANTITIES[key].dimension == name] for name in DIMENSIONS}
    found = {name: keys for name, keys in found.items() if keys}
    figure, every = panels(len(found))
    for axes, (dimension, keys) in zip(every, found.items(), strict=True):
        curves = [Curve(QUANTITIES[key].label, x, fields[key]) for key in keys]
        draw_curves(axes, [part for curve in curves for part in _split(curve, bodies, len(keys) > 1)], markers)
        title = QUANTITIES[keys[0]].label if len(keys) == 1 else DIMENSIONS[dimension]
        write_labels(axes, along if axes is every[-1] else None, Label(title, getattr(units, dimension)))
    return figure


def _split(curve: Curve, bodies: Sequence[str], titled: bool) -> list[Curve]:
    """Make one curve for each body, if there are several, with its name and, if `titled`, that of the field."""
    names = [name for name in dict.fromkeys(bodies) if name]
    if len(names) < 2:
        return [curve]
    prefix = f"{curve.label}, " if titled else ""
    owners = np.array(bodies)
    return [Curve(prefix + plain(name), curve.x, np.where(owners == name, curve.y, np.nan)) for name in names]
