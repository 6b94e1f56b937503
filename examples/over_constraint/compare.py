"""KTS against mortar-KTS: the patch test, and Hertz with growing penalty.

python examples/over_constraint/compare.py                prints the two tables
python examples/over_constraint/compare.py pressure.png   and draws the pressures
"""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

import geom2iga
import post
import solve
from post.exact import HertzCylinders
from post.profile import Profile, pressure_profile

HERE = Path(__file__).parent
HERTZ = geom2iga.read_case(HERE / "case.toml")
EXACT = HertzCylinders(force=10.0, radii=(8.0, 8.0), young=(200.0, 200.0), poisson=(0.3, 0.3))
PATCH_TEST = geom2iga.read_case(HERE.parent / "contact_patch_test" / "case.toml")
MESHES = {
    "matching": {},
    "non-matching": {"geometry.block.0.spans": [5, 4, 3], "geometry.block.1.spans": [3, 5, 2]},
}
METHODS = {"mortar": "mortar-KTS", "kts": "KTS"}
PENALTIES = (10.0, 100.0, 1e4, 1e6)  # in units of E/h
INSIDE = 0.9  # how much of the half width is looked at: at the edge the closed form is infinitely steep
DPI = 110
BLUE, BROWN = "#1f4e79", "#b35806"


class Found(NamedTuple):
    """Pressure over distance, how far it is from Hertz inside, over its largest pressure, and the Newton steps."""

    profile: Profile
    deviation: float
    newton_steps: int


def patch_test(method: str, integration: str, mesh: str) -> float:
    """Return the largest error of any stress component; the pressure is 1."""
    changes = {"solve.contact.0.method": method, "solve.contact.0.integration": integration, **MESHES[mesh]}
    case = PATCH_TEST.changed(changes)
    return post.verify(solve.solve(geom2iga.build(case), case), case)[0].difference


def unit_of_penalty() -> float:
    """E/h of the Hertz strip [stress/length]: a tenth of the automatic penalty."""
    case = HERTZ.changed({"solve.contact.0.penalty": "auto"})
    return solve.solve(geom2iga.build(case), case).pairs[0].penalty / 10


def hertz(method: str, penalty: float) -> Found:
    """Solve the Hertz strip; of KTS the pressures are those of the quadrature points."""
    case = HERTZ.changed({"solve.contact.0.method": method, "solve.contact.0.penalty": penalty})
    result = solve.solve(geom2iga.build(case), case)
    contact = result.pairs[0]
    if method == "kts":
        profile = Profile(contact.centres[:, 0], contact.pressure)
    else:
        profile = pressure_profile(result, lambda points: points[:, 0])
    near = profile.within(INSIDE * EXACT.reach)
    deviation = float(np.abs(near.pressure - EXACT.pressure(near.distance)).max() / EXACT.largest_pressure)
    along = np.argsort(profile.distance)
    return Found(Profile(*np.array(profile)[:, along]), deviation, result.statistics["newton_iterations"])


def draw(found: Mapping[tuple[str, float], Found]) -> Figure:
    """Draw pressure over distance on the curve of the closed form, one column per penalty."""
    penalties = sorted({penalty for _, penalty in found})
    figure = Figure(figsize=(2.6 * len(penalties), 5.2), layout="constrained")
    panels = figure.subplots(len(METHODS), len(penalties), sharex=True, squeeze=False)
    line = np.linspace(0, 1.3 * EXACT.reach, 501)
    for row, (method, label) in zip(panels, METHODS.items(), strict=True):
        for axes, penalty in zip(row, penalties, strict=True):
            near = found[method, penalty].profile.within(line[-1])
            axes.plot(line, EXACT.pressure(line), color=BROWN, linewidth=1.2)
            axes.plot(*near, color=BLUE, marker=".", markersize=3, linewidth=0.5)
            axes.grid(alpha=0.3)
            axes.set_ylim(-1.0, max(12.0, 1.1 * near.pressure.max()))
        row[0].set_ylabel(f"{label}\ncontact pressure [N/mm²]")
    for axes, penalty in zip(panels[0], penalties, strict=True):
        axes.set_title(f"penalty {_power(penalty)} E/h", fontsize=10)
    for axes in panels[-1]:
        axes.set_xlabel("distance [mm]")
    return figure


def _power(number: float) -> str:
    return f"{number:g}" if number < 1000 else f"$10^{{{np.log10(number):g}}}$"


def compare_patch_tests() -> dict[tuple[str, str, str], float]:
    """Print a table and return the stress errors by method, integration and meshes."""
    print("| patch test, integration | meshes | mortar-KTS | KTS |")
    print("| --- | --- | --- | --- |")
    errors = {}
    for integration in ("segment", "element"):
        for mesh in MESHES:
            each = [patch_test(method, integration, mesh) for method in METHODS]
            errors |= {(method, integration, mesh): error for method, error in zip(METHODS, each, strict=True)}
            print(f"| {integration} | {mesh} | {each[0]:.0e} | {each[1]:.0e} |", flush=True)
    return errors


def compare_hertz(
    picture: str | None = None, penalties: tuple[float, ...] = PENALTIES
) -> dict[tuple[str, float], float]:
    """Print a table and return the deviations from Hertz by method and penalty in E/h."""
    print("| Hertz, penalty | mortar-KTS | Newton steps | KTS | Newton steps |")
    print("| --- | --- | --- | --- | --- |")
    unit = unit_of_penalty()
    found = {}
    for penalty in penalties:
        found |= {(method, penalty): hertz(method, penalty * unit) for method in METHODS}
        cells = [f"{100 * each.deviation:.1f} % | {each.newton_steps}" for each in (found[m, penalty] for m in METHODS)]
        print(f"| {penalty:g} E/h | {' | '.join(cells)} |", flush=True)
    if picture:
        draw(found).savefig(picture, dpi=DPI)
    return {key: each.deviation for key, each in found.items()}


def main(picture: str | None = None) -> tuple[dict[tuple[str, str, str], float], dict[tuple[str, float], float]]:
    """Do both."""
    errors = compare_patch_tests()
    print()
    return errors, compare_hertz(picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
