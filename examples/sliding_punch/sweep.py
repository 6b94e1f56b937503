"""Contact force of a punch that slides along a cylinder, over its position, for degrees 1, 2 and 3.

python examples/sliding_punch/sweep.py             prints the oscillations
python examples/sliding_punch/sweep.py force.png   and draws the forces
"""

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import geom2iga
import solve
from geom2iga.bspline import Array

CASE = geom2iga.read_case(Path(__file__).with_name("case.toml"))
SPANS = {100.0: 24, 1.0: 48}  # Young's modulus of the base over that of the punch: spans of the base around its axis
DEGREES = (1, 2, 3)
DPI = 110
COLOURS = ("#b35806", "#1f4e79", "#2c7a4b")
MARKERS = ("o", "s", "^")


def contact_force(degree: int, ratio: float, spans: int, slide: float) -> float:
    """Solve for one position [spans] and return the force between the bodies.

    Degree 1 has facets, as finite elements have, in place of the cylinders that NURBS hold exactly.
    """
    case = CASE.changed(
        {
            "geometry.degree": [max(degree, 2), max(degree, 2), 1],
            "geometry.pipe.0.spans": [6, spans, 1],
            "geometry.pipe.0.rotate.angle": 60.0 + slide * 60.0 / spans,
            "solve.material.1.young": 1000.0 * ratio,
        }
    )
    model = geom2iga.build(case)
    result = solve.solve(geom2iga.faceted(model) if degree == 1 else model, case)
    result.check_converged()
    return float(np.linalg.norm(result.pairs[0].force))


def oscillation(forces: Array) -> float:
    """Peak to peak over the mean."""
    return float(np.ptp(forces) / forces.mean())


def draw(slides: Array, forces: dict[float, dict[int, Array]]) -> Figure:
    """Draw the forces over position: all degrees, and below without degree 1 so that the others can be seen."""
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    panels = figure.subplots(2, len(forces), sharex=True, squeeze=False)
    for column, (ratio, found) in zip(panels.T, forces.items(), strict=True):
        column[0].set_title(
            "base as stiff as the punch" if ratio == 1 else f"base {ratio:g} times as stiff as the punch"
        )
        column[1].set_xlabel("position [spans of the base]")
        for axes, least in zip(column, (1, 2), strict=True):
            for degree in (degree for degree in found if degree >= least):
                relative = found[degree] / found[degree].mean() - 1
                style = {"color": COLOURS[degree - 1], "marker": MARKERS[degree - 1], "markersize": 3, "linewidth": 1}
                axes.plot(slides, 100 * relative, label=f"degree {degree}", **style)
            axes.legend(frameon=False, fontsize=8, ncols=3, loc="upper right")
            axes.set_ylim(axes.get_ylim()[0], axes.get_ylim()[1] + 0.25 * np.ptp(axes.get_ylim()))
            axes.grid(alpha=0.3)
    for axes in panels[:, 0]:
        axes.set_ylabel("contact force off its mean [%]")
    return figure


def main(
    picture: str | None = None, meshes: Mapping[float, int] = SPANS, periods: int = 2, positions: int = 16
) -> dict[float, dict[int, float]]:
    """Return the oscillation by ratio and degree, over so many spans of the base with so many positions in each."""
    slides = np.arange(periods * positions + 1) / positions
    print("| base over punch | spans of the base | degree | mean force | oscillation | degree 1 over this |")
    print("| --- | --- | --- | --- | --- | --- |")
    forces: dict[float, dict[int, Array]] = {}
    for ratio, spans in meshes.items():
        forces[ratio] = {}
        for degree in DEGREES:
            found = forces[ratio][degree] = np.array([contact_force(degree, ratio, spans, at) for at in slides])
            size, less = oscillation(found), oscillation(forces[ratio][1]) / oscillation(found)
            print(f"| {ratio:g} | {spans} | {degree} | {found.mean():.4f} | {size:.1e} | {less:.1f} |", flush=True)
    if picture:
        draw(slides, forces).savefig(picture, dpi=DPI)
    return {ratio: {degree: oscillation(found) for degree, found in each.items()} for ratio, each in forces.items()}


if __name__ == "__main__":
    main(*sys.argv[1:])
