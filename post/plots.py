"""Pictures, one function each; every function takes data and returns a matplotlib figure."""

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator

from geom2iga.bspline import Array
from geom2iga.patch import Face
from geom2iga.picture import scene
from post.fields import BodySamples, ContactSamples, sample_at, sample_face, sample_secondary
from solve.newton import Step
from solve.result import Result, first_passes

SAMPLES = 5  # per span and direction, on the surfaces drawn
VISIBLE = 0.08  # largest displacement drawn, in sizes of the model
UNIFORM = 1e-6  # a field whose range is below this fraction of its size is drawn as uniform
WIDTH = 8.0  # of a figure [inches]
PROFILE = 501  # points of a closed form's curve
BLUE, BROWN = "#1f4e79", "#b35806"


def draw_displacement(result: Result, unit: str = "", scale: float | None = None) -> Figure:
    """Draw the deformed bodies coloured by vertical displacement, with their knot lines: the paper's Fig. 2."""
    return _draw_bodies(result, lambda part: part.displacement, r"vertical displacement $u_z$", unit, scale)


def draw_stress(result: Result, unit: str = "", scale: float | None = None) -> Figure:
    """Draw the deformed bodies coloured by vertical stress, with their knot lines."""
    return _draw_bodies(result, lambda part: part.stress, r"vertical stress $\sigma_{zz}$", unit, scale)


def draw_pressure(result: Result, unit: str = "") -> Figure:
    """Draw the contact pressure on the secondary faces, the bodies as outlines; undeformed."""
    parts = sample_secondary(result, SAMPLES)
    secondary = {face for c in result.contacts for face in result.model.faces(c.definition.secondary)}
    lines = (line for face in secondary for line in _knot_lines(result, face, 0.0))
    borders = (line for face in _outer_faces(result) for line in _knot_lines(result, face, 0.0, borders_only=True))
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


def _outer_faces(result: Result) -> list[Face]:
    """List the faces of all patches but the glued ones, which lie inside a body."""
    glued = {face for pair in result.model.glued for face in (pair.first, pair.second)}
    faces = [Face(name, axis, side) for name in result.model.patches for axis in range(3) for side in (0, 1)]
    return [face for face in faces if face not in glued]


def _draw_bodies(
    result: Result, field: Callable[[BodySamples], Array], label: str, unit: str, scale: float | None
) -> Figure:
    """Draw all faces, deformed, coloured by the third component of a field, zz or z."""
    scale = deformation_scale(result) if scale is None else scale
    faces = _outer_faces(result)
    parts = [sample_face(result, face, SAMPLES) for face in faces]
    lines = (line for face in faces for line in _knot_lines(result, face, scale))
    size = max(float(np.abs(field(part)).max()) for part in parts)
    figure = _compose(parts, [field(part)[:, 2] for part in parts], size, scale, lines, (), label, unit)
    text = f"displacements drawn {scale:g} times" if scale != 1 else "displacements drawn to scale"
    figure.supxlabel(text, x=0.02, horizontalalignment="left", fontsize=9)
    return figure


def _compose(
    parts: Sequence[BodySamples | ContactSamples],
    fields: Sequence[Array],
    size: float,
    scale: float,
    lines: Iterable[Array],
    outlines: Iterable[Array],
    label: str,
    unit: str,
) -> Figure:
    """Render samples, coloured by fields whose size is given, at their deformed place, with a colour bar beside."""
    starts = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    points = np.concatenate([part.points + scale * part.displacement for part in parts])
    cells = np.concatenate([part.cells + start for part, start in zip(parts, starts, strict=True)])
    values = np.concatenate(fields)
    limits, remark = _limits(values, size)
    around = list(outlines)
    surface = scene.quadrilaterals(points, cells, field=values)
    image = scene.render(surface, limits, scene.polylines(list(lines)), scene.polylines(around) if around else None)
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
    low, high = float(values.min()), float(values.max())
    if high - low > UNIFORM * size:
        return (low, high), ""
    remark = f"uniform, {(low + high) / 2:.6g} ± {(high - low) / 2:.1e}"
    margin = 0.05 * size or 1.0
    return (low - margin, high + margin), remark


def _knot_lines(result: Result, face: Face, scale: float, borders_only: bool = False) -> Iterator[Array]:
    """Yield the knot lines of a face, or its borders alone, as points (q, 3) at their deformed place."""
    patch = result.model.patches[face.patch]
    for along, across in (face.axes, face.axes[::-1]):
        at = patch.breaks[across][[0, -1]] if borders_only else patch.breaks[across]
        line = np.unique(np.linspace(patch.breaks[along][:-1], patch.breaks[along][1:], SAMPLES))
        xi = np.empty((len(at), len(line), 3))
        xi[..., face.axis], xi[..., across], xi[..., along] = patch.knots[face.axis][-face.side], at[:, None], line
        part = sample_at(result, face.patch, xi.reshape(-1, 3))
        yield from (part.points + scale * part.displacement).reshape(xi.shape)
