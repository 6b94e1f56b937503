"""Pictures, one function each; every function takes data and returns a matplotlib figure."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator

from geom2iga.bspline import Array
from geom2iga.patch import Face
from geom2iga.picture import scene
from geom2iga.picture.skin import outer_faces
from post.fields import BodySamples, ContactSamples, Samples
from post.grid import face_grid
from solve.newton import Step
from solve.result import Result, first_passes

SAMPLES = 5  # per span and direction, on the surfaces drawn
FINE, FINEST = 25_000, 250_000  # quadrilaterals that look smooth, and that an image of two million pixels can show
VISIBLE = 0.08  # largest displacement drawn, in sizes of the model
UNIFORM = 1e-6  # a field whose range is below this fraction of its size is drawn as uniform
WIDTH = 8.0  # of a figure [inches]
WIDEST, THINNEST = 2.5, 0.5  # of knot lines [pixels]
DENSITY = 0.1 * scene.SIZE[0]  # that width of knot lines over their distance in sizes of the model: a tenth is black
PROFILE = 501  # points of a closed form's curve
BLUE, BROWN = "#1f4e79", "#b35806"


def drawn(samples: Samples) -> Samples:
    """Choose the samples to draw: those at hand where they are fine, but not too fine, else others."""
    model = samples.result.model
    spans = 0
    for face in outer_faces(model):
        first, second = model.surface(face).breaks
        spans += (len(first) - 1) * (len(second) - 1)
    if FINE <= spans * (samples.count - 1) ** 2 <= FINEST:
        return samples
    return Samples(samples.result, int(np.clip(1 + (FINEST / spans) ** 0.5, 2, SAMPLES)))


def draw_displacement(samples: Samples, unit: str = "", scale: float | None = None) -> Figure:
    """Draw the deformed bodies coloured by vertical displacement, with their knot lines: the paper's Fig. 2."""
    return _draw_bodies(samples, lambda part: part.displacement, r"vertical displacement $u_z$", unit, scale)


def draw_stress(samples: Samples, unit: str = "", scale: float | None = None) -> Figure:
    """Draw the deformed bodies coloured by vertical stress, with their knot lines."""
    return _draw_bodies(samples, lambda part: part.stress, r"vertical stress $\sigma_{zz}$", unit, scale)


def draw_pressure(samples: Samples, unit: str = "") -> Figure:
    """Draw the contact pressure on the secondary faces, the bodies as outlines; undeformed."""
    result, parts = samples.result, samples.secondary
    secondary = {face for c in result.contacts for face in result.model.faces(c.definition.secondary)}
    outer = outer_faces(result.model)
    borders = [line for face in outer for line in _knot_lines(samples, face, 0.0, borders=True)]
    lines = _visible_lines(samples, list(secondary), 0.0)
    pressures = [part.pressure for part in parts]
    size = max(float(np.abs(pressure).max()) for pressure in pressures)
    return _compose(parts, pressures, size, 0.0, lines, borders, "contact pressure", unit)


def draw_newton(history: Sequence[Step]) -> Figure:
    """Draw residual and number of active control points over the Newton steps."""
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.add_subplot()
    steps = [step.number for step in history]
    residuals = [max(step.residual, 1e-18) for step in history]
    axes.semilogy(steps, residuals, "o-", color=BLUE)
    axes.set_xlabel("Newton step")
    axes.set_ylabel("largest residual / largest force", color=BLUE)
    axes.xaxis.set_major_locator(FixedLocator(steps) if len(steps) < 12 else MaxNLocator(integer=True))
    axes.set_xlim(0.5, len(steps) + 0.5)
    axes.set_ylim(min(1e-16, *residuals), max(10.0, *residuals))
    axes.grid(alpha=0.3)
    other = axes.twinx()
    other.plot(steps, [step.active for step in history], "s--", color=BROWN)
    other.set_ylabel("active control points", color=BROWN)
    other.set_ylim(0, 1.1 * max(1, *(step.active for step in history)))
    return figure


def draw_profile(
    distance: Array, pressure: Array, exact: Callable[[Array], Array], length: str = "", stress: str = ""
) -> Figure:
    """Draw contact pressure over distance as points, on the curve of a closed form.

    Parameters
    ----------
    distance, pressure : (q,)
        Of sample points, in any sequence.
    exact :
        Pressure at distances.
    length, stress :
        Units.
    """
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.add_subplot()
    line = np.linspace(min(0.0, distance.min()), distance.max(), PROFILE)
    axes.plot(line, exact(line), color=BROWN, label="closed form")
    axes.plot(distance, pressure, ".", color=BLUE, markersize=3, label="computed")
    axes.set_xlabel(f"distance [{length}]" if length else "distance")
    axes.set_ylabel(f"contact pressure [{stress}]" if stress else "contact pressure")
    axes.legend(frameon=False)
    axes.grid(alpha=0.3)
    return figure


def draw_load_steps(result: Result, unit: str = "") -> Figure:
    """Draw the force of each contact over the share of the loads."""
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.add_subplot()
    shares = [state.load_factor for state in result.states]
    forces = [[np.linalg.norm(c.force) for c in first_passes(state.contacts)] for state in result.states]
    for contact, values in zip(result.pairs, np.transpose(forces), strict=True):
        label = f"{contact.definition.secondary} on {contact.definition.primary}"
        axes.plot(shares, values, "o-", label=label)
    axes.set_xlabel("share of the loads")
    axes.set_ylabel(f"contact force [{unit}]" if unit else "contact force")
    axes.legend()
    axes.grid(alpha=0.3)
    return figure


def deformation_scale(result: Result) -> float:
    """Choose a factor of 1, 2 or 5 times a power of ten that makes the displacement visible, at least 1."""
    largest = np.linalg.norm(result.state.displacement, axis=1).max()
    if largest == 0:
        return 1.0
    wanted = VISIBLE * np.linalg.norm(np.ptp(result.space.control_points, axis=0)) / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(1.0, *(step * power for step in (1, 2, 5) if step * power <= wanted)))


def _draw_bodies(
    samples: Samples, field: Callable[[BodySamples], Array], label: str, unit: str, scale: float | None
) -> Figure:
    """Draw all faces, deformed, coloured by the third component of a field, zz or z."""
    scale = deformation_scale(samples.result) if scale is None else scale
    faces = outer_faces(samples.result.model)
    parts = [samples.face(face) for face in faces]
    lines = _visible_lines(samples, faces, scale)
    size = max(float(np.nanmax(np.abs(field(part)))) for part in parts)
    figure = _compose(parts, [field(part)[:, 2] for part in parts], size, scale, lines, (), label, unit)
    text = f"displacements drawn {scale:g} times" if scale != 1 else "displacements drawn to scale"
    figure.supxlabel(text, x=0.02, horizontalalignment="left", fontsize=9)
    return figure


def _compose(
    parts: Sequence[BodySamples | ContactSamples],
    fields: Sequence[Array],
    size: float,
    scale: float,
    lines: tuple[Sequence[Array], float],
    outlines: Sequence[Array],
    label: str,
    unit: str,
) -> Figure:
    """Render samples, coloured by fields whose size is given, at their deformed place, with a colour bar beside."""
    starts = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    points = np.concatenate([part.points + scale * part.displacement for part in parts])
    cells = np.concatenate([part.cells + start for part, start in zip(parts, starts, strict=True)])
    values = np.concatenate(fields)
    limits, remark = _limits(values, size)
    surface, (drawn_lines, width) = scene.quadrilaterals(points, cells, field=values), lines
    outline = scene.polylines(outlines) if outlines else None
    image = scene.render(surface, limits, scene.polylines(drawn_lines), outline, width)
    height = np.clip(WIDTH * 0.82 * image.shape[0] / image.shape[1] + 0.6, 2.8, 1.2 * WIDTH)
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = figure.add_subplot()
    axes.imshow(image, interpolation="antialiased")
    axes.set_axis_off()
    bar = figure.colorbar(ScalarMappable(Normalize(*limits), scene.COLOURS), ax=axes, shrink=0.8, pad=0.02)
    bar.set_label(f"{label} [{unit}]" if unit else label)
    bar.ax.ticklabel_format(useOffset=False, scilimits=(-2, 4))
    if remark:
        figure.suptitle(f"{label}: {remark}", fontsize=11)
    return figure


def _limits(values: Array, size: float) -> tuple[tuple[float, float], str]:
    """Range of colours; a field that is uniform against its size gets a range around its value and a remark."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if high - low > UNIFORM * size:
        return (low, high), ""
    remark = f"uniform, {(low + high) / 2:.6g} ± {(high - low) / 2:.1e}"
    margin = 0.05 * size or 1.0
    return (low - margin, high + margin), remark


def _visible_lines(samples: Samples, faces: Sequence[Face], scale: float) -> tuple[list[Array], float]:
    """The knot lines of faces and their width [pixels], thinner where they are dense, borders alone where too dense."""
    families = [family for face in faces for family in _families(samples, face, scale)]
    between = np.median(np.concatenate([np.linalg.norm(np.diff(f, axis=0), axis=2).ravel() for f in families]))
    width = min(WIDEST, DENSITY * between / np.linalg.norm(np.ptp(samples.result.space.control_points, axis=0)))
    if width < THINNEST:
        return [line for family in families for line in family[[0, -1]]], WIDEST
    return [line for family in families for line in family], width


def _knot_lines(samples: Samples, face: Face, scale: float, borders: bool = False) -> Iterator[Array]:
    """Yield the knot lines of a face, or its borders alone, as points (q, 3) at their deformed place."""
    for family in _families(samples, face, scale):
        yield from family[[0, -1]] if borders else family


def _families(samples: Samples, face: Face, scale: float) -> tuple[Array, Array]:
    """The knot lines of a face across its first and its second direction, each (lines, q, 3)."""
    part = samples.face(face)
    lines = face_grid(samples.result.model.patches[face.patch], face, samples.count).lines
    first, second = (lines[axis] for axis in face.axes)
    places = (part.points + scale * part.displacement).reshape(len(first.rule.points), -1, 3)
    return places[first.knots], places.swapaxes(0, 1)[second.knots]
