"""The gallery: a picture by every plot function, and a page that shows how each is made.

python examples/gallery.py                         into examples/guide/docs/gallery
python examples/gallery.py out --formats png pdf   elsewhere, in several formats
"""

import argparse
import runpy
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import geom2iga
import solve
from geom2iga.picture import scene
from geom2iga.tables import Units
from post import plots
from post.case import Cut, LineProbe, Look, PointProbe
from post.exact import HertzSpheres
from post.fields import Samples
from post.plots import Curve, Label
from post.probes import sample_line, sample_point
from post.profile import pressure_profile, radius
from post.quantities import QUANTITIES

HERE = Path(__file__).parent
FOLDER = HERE / "guide" / "docs" / "gallery"
WIDEST = 1050  # of a picture on the page; others are halved [pixels]
UNITS = Units(length="mm", force="N")
HERTZ = HertzSpheres(force=0.6, radii=(10.0, np.inf), young=(1000.0, 1000.0), poisson=(0.3, 0.3))
INTRODUCTION = """One function per picture, in `post.plots`; each takes data and returns a matplotlib figure, which
`geom2iga.picture.scene.save(figure, path)` writes as PNG, SVG or PDF. `samples` is
`plots.drawn(Samples(result, 4))`, and `units` are the labels, `Units(length="mm", force="N")`; `Look` and `Cut` are in
`post.case`. This page is made by `python examples/gallery.py`."""
MIDDLE = Look(cut=Cut(origin=(0.0, 0.0, 0.0), normal=(0.0, -1.0, 0.0)))
BLOCK = MIDDLE.model_copy(update={"bodies": ("block",)})


class Entry(NamedTuple):
    """A picture of the gallery: name and title, what it shows, the command that draws it, and the figure."""

    name: str
    title: str
    caption: str
    command: str
    draw: Callable[[], Figure]


def entries() -> Iterator[Entry]:
    """Yield all pictures."""
    yield from _bodies()
    yield from _contact()
    yield from _curves()
    yield from _history()


def _bodies() -> Iterator[Entry]:
    yield Entry(
        "displacement",
        "Displacement",
        "Contact patch test: vertical displacement on the deformed blocks with their knot lines.",
        'plots.draw_bodies(samples, "uz", units)',
        lambda: plots.draw_bodies(sampled("contact_patch_test"), "uz", Units(length="UL", force="F")),
    )
    yield Entry(
        "von_mises_cut",
        "Von Mises stress on a cut",
        "Hertz contact of a hemisphere: von Mises stress where a plane cuts both bodies. It is largest below contact.",
        'plots.draw_bodies(samples, "von_mises", units, look=Look(cut=Cut(origin=(0, 0, 0), normal=(0, -1, 0))))',
        lambda: plots.draw_bodies(sampled("hertz_hemisphere"), "von_mises", UNITS, look=MIDDLE),
    )
    yield Entry(
        "shear_stress_cut",
        "Shear stress on a cut",
        "A field with both signs is white at zero: shear stress in the block, cut as above.",
        'plots.draw_bodies(samples, "stress_xz", units, look=Look(bodies=["block"], cut=cut))',
        lambda: plots.draw_bodies(sampled("hertz_hemisphere"), "stress_xz", UNITS, look=BLOCK),
    )


def _contact() -> Iterator[Entry]:
    yield Entry(
        "contact_pressure",
        "Contact pressure",
        "Contact pressure on the secondary face.",
        'plots.draw_contact(samples, "pressure", units)',
        lambda: plots.draw_contact(sampled("hertz_sphere"), "pressure", UNITS),
    )
    yield Entry(
        "contact_gap",
        "Contact gap",
        "Gap between the deformed bodies.",
        'plots.draw_contact(samples, "gap", units)',
        lambda: plots.draw_contact(sampled("hertz_hemisphere"), "gap", UNITS),
    )
    yield Entry(
        "contact_plane",
        "Contact in the parameter plane",
        "Pressure and gap over the parameters of the secondary face, with the knot lines of both sides.",
        "plots.draw_contact_plane(samples, units)",
        lambda: plots.draw_contact_plane(sampled("hertz_sphere"), UNITS),
    )


def _curves() -> Iterator[Entry]:
    yield Entry(
        "profile",
        "Contact pressure against a closed form",
        "Contact pressure over the distance from the middle, against Hertz.",
        'plots.draw_profile([Curve("computed", distance, pressure)], exact.pressure, units, errors=True)',
        _draw_profile,
    )
    yield Entry(
        "line",
        "Fields along a line",
        "Fields along the axis of symmetry, which runs through both bodies.",
        'plots.draw_line(distance, {"uz": uz, "stress_zz": stress_zz}, units, bodies)',
        _draw_line,
    )
    yield Entry(
        "convergence",
        "Convergence",
        "Two rings in contact: relative error of the stress in L², degrees 1 to 3.",
        'plots.draw_convergence([Curve("degree 1", sizes, errors), ...], expected=[1, 2, 3])',
        _draw_convergence,
    )
    yield Entry(
        "sweep",
        "Sweep",
        "A punch slides along a cylinder: contact force over its position.",
        'plots.draw_sweep([Curve("degree 1", positions, forces), ...], Label("position"), Label("force", "N"))',
        _draw_sweep,
    )


def _history() -> Iterator[Entry]:
    yield Entry(
        "newton",
        "Newton steps",
        "Newton's method in four load steps: residual, and how many control points are active.",
        "plots.draw_newton(result.history, plots.what_is_active(result))",
        lambda: plots.draw_newton(stepped().history, plots.what_is_active(stepped())),
    )
    yield Entry(
        "load_steps",
        "Load steps",
        "Contact force and contact area over the share of the loads.",
        "plots.draw_load_steps(result, units)",
        lambda: plots.draw_load_steps(stepped(), UNITS),
    )
    yield Entry(
        "point",
        "Fields at a point",
        "Fields at a point over the share of the loads: below the middle of contact.",
        'plots.draw_point(load_factors, {"uz": uz, "von_mises": von_mises}, units)',
        _draw_point,
    )


@cache
def solved(example: str) -> solve.Result:
    """Solve an example."""
    case = geom2iga.read_case(HERE / example / "case.toml")
    return solve.solve(geom2iga.build(case), case)


@cache
def stepped() -> solve.Result:
    """Solve the Hertz sphere in load steps."""
    case = geom2iga.read_case(HERE / "hertz_sphere" / "case.toml").changed(
        {"solve.steps": {"factors": [0.25, 0.5, 0.75, 1.0]}}
    )
    return solve.solve(geom2iga.build(case), case)


@cache
def sampled(example: str) -> Samples:
    """Sample an example for pictures."""
    return plots.drawn(Samples(solved(example), 4))


def _draw_profile() -> Figure:
    profile = pressure_profile(solved("hertz_sphere"), radius).within(1.4 * HERTZ.reach)
    return plots.draw_profile([Curve("computed", *profile)], HERTZ.pressure, UNITS, errors=True)


def _draw_line() -> Figure:
    line = sample_line(solved("hertz_sphere"), LineProbe(name="axis", start=(0, 0, -1), end=(0, 0, 1), points=401))
    fields = {key: QUANTITIES[key].values(line.samples) for key in ("uz", "stress_zz")}
    return plots.draw_line(line.distance, fields, UNITS, line.body)


def _draw_point() -> Figure:
    point = sample_point(stepped(), PointProbe(name="below", at=(0.0, 0.0, -0.1)))
    fields = {key: QUANTITIES[key].values(point.samples) for key in ("uz", "stress_zz", "von_mises")}
    return plots.draw_point(point.load_factor, fields, UNITS)


def _draw_convergence() -> Figure:
    errors = script("lame_rings/orders.py")["errors"]
    spans = np.array([4, 8, 16])
    curves = [
        Curve(f"degree {degree}", 1 / spans, np.array([errors(degree, int(count)).stress for count in spans]))
        for degree in (1, 2, 3)
    ]
    error = Label("relative error of the stress in $L^2$")
    return plots.draw_convergence(curves, Label("mesh size over length of the arc"), error, expected=[1, 2, 3])


def _draw_sweep() -> Figure:
    contact_force = script("sliding_punch/sweep.py")["contact_force"]
    slides = np.arange(17) / 8
    curves = [
        Curve(f"degree {degree}", slides, np.array([contact_force(degree, 100.0, 24, slide) for slide in slides]))
        for degree in (1, 2, 3)
    ]
    return plots.draw_sweep(curves, Label("position of the punch", "spans of the base"), Label("contact force", "N"))


def script(name: str) -> dict[str, Any]:
    """What a script of the examples defines."""
    return runpy.run_path(str(HERE / name))


def write_gallery(folder: Path, formats: tuple[str, ...] = ("png",)) -> list[str]:
    """Draw all pictures into a folder, with the page gallery.md; return the names of the pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    page = [f"# Gallery\n\n{INTRODUCTION}\n"]
    names = []
    for entry in entries():
        figure = entry.draw()
        for ending in formats:
            path = folder / f"{entry.name}.{ending}"
            scene.save(figure, path)
            if ending == "png":
                _shrink(path)
            print(f"{path}: {path.stat().st_size / 1000:.0f} kB", flush=True)
        image = f"![{entry.caption}]({entry.name}.png)"
        page.append(f"## {entry.title}\n\n{entry.caption}\n\n{image}\n\n`{entry.command}`\n")
        names.append(entry.name)
    (folder / "gallery.md").write_text("\n".join(page), encoding="utf-8")
    return names


def _shrink(path: Path) -> None:
    """Make a picture no larger than a page shows it."""
    image = Image.open(path).convert("RGB")
    if image.width > WIDEST:
        image = image.reduce(2)
    image.save(path, optimize=True)


def main() -> None:
    """Write the gallery where the command line says."""
    parser = argparse.ArgumentParser(description="Draw a picture by every plot function, and a page of them.")
    parser.add_argument("folder", type=Path, nargs="?", default=FOLDER)
    parser.add_argument("--formats", nargs="+", choices=("png", "svg", "pdf"), default=["png"])
    arguments = parser.parse_args()
    formats = dict.fromkeys(("png", *arguments.formats))  # the page shows these
    write_gallery(arguments.folder, tuple(formats))


if __name__ == "__main__":
    main()
