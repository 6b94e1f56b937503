"""How a solution was found: Newton steps, load steps."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator

from geom2iga.bspline import Indices
from geom2iga.picture.sheet import plain
from geom2iga.tables import Units
from post.plots.style import GREY, NO_UNITS, PALETTE, POINTS, Curve, Label, draw_curves, panels, write_labels
from solve.newton import Step
from solve.result import ContactResult, Result, first_passes

SMALLEST = 1e-18  # residual drawn, in place of zero
MANY = 60  # Newton steps, of which none has a marker any more
LOAD_STEPS = 12  # are numbered; of more, some


def draw_newton(history: Sequence[Step], counted: str = "control points") -> Figure:
    """Draw the residual and, below it, how many points are active over the Newton steps; load steps are set apart.

    Parameters
    ----------
    history :
        At least one step.
    counted : str
        What is active, see `what_is_active`.
    """
    figure, (above, below) = panels(2)
    numbers = np.array([step.number for step in history])
    residuals = np.maximum([step.residual for step in history], SMALLEST)
    active = np.array([step.active for step in history])
    owners = np.array([step.load_step for step in history])
    above.set_yscale("log")
    marker = "" if len(history) > MANY else "o"
    for owner in np.unique(owners):
        own = owners == owner
        above.plot(numbers[own], residuals[own], marker=marker, markersize=4, linewidth=1.3, color=PALETTE[0])
        below.plot(numbers[own], active[own], marker=marker and "s", markersize=4, linewidth=1.3, color=PALETTE[1])
    above.set_ylim(min(1e-16, residuals.min() / 3), max(10.0, residuals.max() * 3))
    below.set_ylim(0, 1.1 * max(1, active.max()))
    for axes in (above, below):
        axes.xaxis.set_major_locator(MaxNLocator(10, integer=True, min_n_ticks=1))
    above.yaxis.set_major_locator(LogLocator(numticks=7))
    below.yaxis.set_major_locator(MaxNLocator(6, integer=True, min_n_ticks=1))
    below.set_xlim(numbers[0] - 0.5, numbers[-1] + 0.5)
    _separate(above, below, numbers, owners)
    write_labels(above, y=Label("largest residual\nover largest force"))
    write_labels(below, Label("Newton step"), Label(f"active\n{counted}"))
    figure.align_ylabels()
    return figure


def what_is_active(result: Result) -> str:
    """Name what a result counts as active: control points, or with KTS the quadrature points themselves."""
    methods = {contact.definition.method for contact in result.contacts}
    if methods == {"kts"}:
        return "points"
    return "points and control points" if "kts" in methods else "control points"


def draw_load_steps(result: Result, units: Units = NO_UNITS) -> Figure:
    """Draw force and area of each contact over the share of the loads."""
    shares = np.array([state.load_factor for state in result.states])
    states = [first_passes(state.contacts) for state in result.states]
    area = f"{units.length}²" if units.length else ""
    drawn = (
        (Label("contact force", units.force), lambda contact: float(np.linalg.norm(contact.force))),
        (Label("contact area", area), lambda contact: contact.area),
    )
    figure, every = panels(1, len(drawn), (4.2, 3.4))
    for axes, (label, value) in zip(every, drawn, strict=True):
        curves = [
            Curve(_named(contact), shares, np.array([value(state[number]) for state in states]))
            for number, contact in enumerate(result.pairs)
        ]
        draw_curves(axes, curves)
        axes.set_ylim(bottom=0)
        write_labels(axes, Label("share of the loads"), label)
    return figure


def _named(contact: ContactResult) -> str:
    return plain(f"{contact.definition.secondary} on {contact.definition.primary}")


def _separate(above: Axes, below: Axes, numbers: Indices, owners: Indices) -> None:
    """Draw lines between load steps and number them, if there are several."""
    starts = np.flatnonzero(np.diff(owners, prepend=owners[0] - 1))
    if len(starts) == 1:
        return
    above.text(0, 1.09, "load step", transform=above.transAxes, fontsize=POINTS - 1.5, color=GREY)
    for start in starts[:: -(-len(starts) // LOAD_STEPS)]:
        for axes in (above, below):
            axes.axvline(numbers[start] - 0.5, color=GREY, linewidth=0.6, linestyle=(0, (2, 2)))
        style: dict[str, Any] = {"fontsize": POINTS - 1.5, "color": GREY}
        above.text(numbers[start] - 0.5, 1.02, str(owners[start]), transform=above.get_xaxis_transform(), **style)
