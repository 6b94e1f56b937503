"""Pressure and gap of contacts in the parameter plane of the secondary faces."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from geom2iga.bspline import Array, Mask
from geom2iga.patch import Face, Patch
from geom2iga.picture.scene import Picture
from geom2iga.picture.sheet import plain
from geom2iga.projection import closest_points
from geom2iga.tables import Units
from post.fields import ContactSamples, Samples
from post.grid import Line, sample_grid
from post.plots.contact import CONTACT_FIELDS, EDGE, contact_scale, secondary_faces
from post.plots.deformation import size_of
from post.plots.page import draw_bar
from post.plots.style import NO_UNITS, PALE, POINTS, Scale
from solve.face import area_vectors, surface_of
from solve.result import Result

Style = dict[str, Any]
PIXELS = 400  # of the image of a face, along each side
ALONG = 401  # points of a knot line of the primary side
MOST = 6  # faces drawn: those with the largest pressures
AROUND = 0.3  # what is seen around the contact zone, in sizes of the zone
PANEL = (3.4, 3.0)  # size [inches]
OWN: Style = {"color": "black", "linewidth": 0.4}
OTHER: Style = {"color": "black", "linewidth": 0.8, "linestyle": (0, (5, 3))}
REMARK: Style = {
    "ha": "center",
    "va": "top",
    "fontsize": POINTS - 1,
    "bbox": {"color": "white", "alpha": 0.85, "pad": 2},
}
FEW, THINNEST = 60, 0.2  # knot lines that are drawn full; the least share of their width that is still drawn
RIM: Style = {"color": "#d55e00", "linewidth": 2.0}


class Window(NamedTuple):
    """The part of the parameter plane of a face that is drawn: places in each direction, fields (PIXELS, PIXELS)."""

    face: Face
    places: tuple[Array, Array]
    fields: dict[str, Array]

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """First and last place in both directions."""
        first, second = self.places
        return float(first[0]), float(first[-1]), float(second[0]), float(second[-1])


def draw_contact_plane(samples: Samples, units: Units = NO_UNITS, faces: Sequence[Face] | None = None) -> Figure:
    """Draw pressure and gap over the parameters of secondary faces, for the contact zone and what is around it.

    Full lines are the knot lines of a face, dashed ones those of the faces opposite; the thick line is the edge of
    contact, where a hundredth of the largest pressure is left.

    Parameters
    ----------
    samples : Samples
    units : Units
    faces :
        Which to draw; left out, those that bear most, at most six.
    """
    result = samples.result
    parts = dict(zip(secondary_faces(result, result.contacts), samples.secondary, strict=True))
    edge = EDGE * max(float(part.pressure.max()) for part in parts.values())
    windows = [_window(samples, face, parts[face], edge) for face in faces or _most_pressed(parts, edge)]
    figure = Picture(figsize=(2 * PANEL[0] + 1.6, 0.6 + PANEL[1] * len(windows)), layout="constrained")
    panels = figure.subplots(len(windows), 2, squeeze=False)
    for column, (name, field) in zip(panels.T, CONTACT_FIELDS.items(), strict=True):
        values = np.concatenate([window.fields[name].ravel() for window in windows])
        scale = contact_scale(values, name, size_of(result))
        for axes, window in zip(column, windows, strict=True):
            _draw_window(axes, window, name, scale)
            if scale.remark:
                axes.text(0.5, 0.94, scale.remark, transform=axes.transAxes, **REMARK)
        draw_bar(figure, scale, field.label(units), ax=column.tolist())
    styles = {"knot lines": OWN, "knot lines opposite": OTHER}
    for row, window in zip(panels, windows, strict=True):
        _draw_lines(row, result, window)
        if _draw_edge(row, window, edge):
            styles["edge of contact"] = RIM
    handles = [Line2D([], [], **style) for style in styles.values()]
    figure.legend(handles, list(styles), loc="outside lower center", ncols=3, frameon=False, fontsize=POINTS - 0.5)
    return figure


def _most_pressed(parts: dict[Face, ContactSamples], edge: float) -> list[Face]:
    """Faces with pressure, the largest first; where there is none, the first face."""
    largest = {face: float(part.pressure.max()) for face, part in parts.items()}
    found = sorted((face for face in parts if largest[face] > edge), key=lambda face: -largest[face])
    return found[:MOST] or list(parts)[:1]


def _window(samples: Samples, face: Face, part: ContactSamples, edge: float) -> Window:
    """Find the contact zone of a face, and its fields at equal distances there."""
    grid = sample_grid(samples.result.model.surface(face), samples.count)
    zone = (part.pressure > edge).reshape(grid.shape)
    pixels = [_pixels(line, np.atleast_1d(zone.any(axis=1 - axis))) for axis, line in enumerate(grid.lines)]
    fields = {name: _between(getattr(part, name).reshape(grid.shape), grid.lines, pixels) for name in CONTACT_FIELDS}
    return Window(face, (pixels[0], pixels[1]), fields)


def _pixels(line: Line, pressed: Mask) -> Array:
    """Places along one direction, in the contact zone and around it; everywhere if there is none."""
    points = line.rule.points
    inside = points[pressed] if pressed.any() else points
    around = AROUND * (inside[-1] - inside[0])
    return np.linspace(max(points[0], inside[0] - around), min(points[-1], inside[-1] + around), PIXELS)


def _between(values: Array, lines: Sequence[Line], places: Sequence[Array]) -> Array:
    """Interpolate values on a grid of sample points bilinearly; spans have their own points at breaks."""
    for axis, (line, at) in enumerate(zip(lines, places, strict=True)):
        points = line.rule.points
        below = np.clip(np.searchsorted(points, at, "right") - 1, 0, len(points) - 2)
        width = points[below + 1] - points[below]
        share = np.divide(at - points[below], width, out=np.zeros(len(at)), where=width > 0)
        share = np.expand_dims(share, 1 - axis)
        values = (1 - share) * values.take(below, axis) + share * values.take(below + 1, axis)
    return values


def _draw_window(axes: Axes, window: Window, name: str, scale: Scale) -> None:
    """Draw a field, grey where it is no number."""
    axes.imshow(
        window.fields[name].T,
        cmap=scale.colours.with_extremes(bad=PALE),
        clim=scale.limits,
        extent=window.extent,
        origin="lower",
        aspect="auto",
        interpolation="bilinear",
    )


def _draw_edge(row: Sequence[Axes], window: Window, edge: float) -> bool:
    """Draw the edge of contact; tell whether there is any."""
    pressure = window.fields["pressure"]
    if not pressure.min() < edge < pressure.max():
        return False
    for axes in row:
        axes.contour(*window.places, pressure.T, levels=[edge], colors=RIM["color"], linewidths=RIM["linewidth"])
    return True


def _draw_lines(row: Sequence[Axes], result: Result, window: Window) -> None:
    """Draw the knot lines of both sides, and name the axes."""
    surface = surface_of(result.model, window.face)
    others = list(_opposite(result, window))
    grey = np.isnan(window.fields["gap"]).any()
    own, other = (
        _thinned(style, count) for style, count in ((OWN, _lines_seen(window, surface.patch)), (OTHER, len(others)))
    )
    for axes in row:
        for at, draw in zip(surface.patch.breaks, (axes.axvline, axes.axhline), strict=True):
            for place in at:
                draw(place, **own)
        for line in others:
            axes.plot(*line.T, **other)
        axes.set(xlim=window.extent[:2], ylim=window.extent[2:])
        first, second = (f"$\\xi_{axis + 1}$" for axis in window.face.axes)
        axes.set_xlabel(first, fontsize=POINTS)
        axes.set_ylabel(second, fontsize=POINTS)
        axes.tick_params(labelsize=POINTS - 0.5)
        name = plain(_name_of(result, window.face))
        axes.set_title(f"{name}; grey: nothing opposite" if grey else name, fontsize=POINTS)


def _lines_seen(window: Window, patch: Patch) -> int:
    """Number of knot lines of a surface inside the window."""
    return sum(
        int(((at >= place[0]) & (at <= place[-1])).sum()) for at, place in zip(patch.breaks, window.places, strict=True)
    )


def _thinned(style: Style, lines: int) -> Style:
    """Draw lines thinner where they are many, and not at all where they would hide the colours."""
    share = FEW / max(lines, FEW)
    return {**style, "linewidth": style["linewidth"] * share if share > THINNEST else 0.0}


def _name_of(result: Result, face: Face) -> str:
    """Name a secondary face as the case does, and where that are several, which of them it is."""
    groups = result.model.groups
    names = (contact.definition.secondary for contact in result.contacts)
    name = next(name for name in names if face in groups[name])
    if groups[name] == (face,):
        return name
    own = (group for group, faces in groups.items() if faces == (face,))
    return f"{name}: {next(own, result.model.surface(face).name)}"


def _opposite(result: Result, window: Window) -> Iterator[Array]:
    """Yield the knot lines of the primary faces as parameters (q, 2) of the secondary face, with gaps outside it."""
    surface = surface_of(result.model, window.face)
    for contact in result.contacts:
        if window.face not in result.model.faces(contact.definition.secondary):
            continue
        for other in (surface_of(result.model, face) for face in result.model.faces(contact.definition.primary)):
            xi = _on_knot_lines(other.patch)
            points, normal, _ = area_vectors(other, xi.reshape(-1, 2))
            feet = closest_points(surface.patch, points)
            facing = np.einsum("qk,qk->q", normal, area_vectors(surface, feet.xi)[1]) < 0
            yield from np.where((feet.inside & facing)[:, None], feet.xi, np.nan).reshape(xi.shape)


def _on_knot_lines(patch: Patch) -> Array:
    """Parameters (lines, ALONG, 2) of points on all knot lines of a surface."""
    lines = []
    for axis, (at, other) in enumerate(zip(patch.breaks, patch.breaks[::-1], strict=True)):
        along = np.linspace(other[0], other[-1], ALONG)
        pair = np.broadcast_arrays(at[:, None], along)
        lines.append(np.stack(pair if axis == 0 else pair[::-1], axis=-1))
    return np.concatenate(lines)
