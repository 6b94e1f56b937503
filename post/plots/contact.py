"""Pressure and gap of contacts, on the surface in space."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from geom2iga.bspline import Array
from geom2iga.patch import Face
from geom2iga.picture import scene
from geom2iga.picture.scene import ABOVE, Layer
from geom2iga.picture.sheet import plain
from geom2iga.picture.skin import outer_faces
from geom2iga.tables import Units
from post.fields import ContactSamples, Samples
from post.plots.cut import view_of
from post.plots.deformation import size_of
from post.plots.lines import borders, families, knot_lines
from post.plots.page import LINE, OUTLINE, Remarks, coloured, draw_page
from post.plots.style import NO_UNITS, SEQUENTIAL, Label, Scale, scale_of
from solve.result import ContactResult, Result

EDGE = 0.01  # contact ends where less than this part of the largest pressure is left
CLOSE = 0.3  # contact smaller than this, in sizes of the model, is drawn alone
AROUND = 1.5  # what is seen then, in sizes of the contact
ROUNDING = 1e-6  # size against which gaps are looked at that are all closed, in sizes of the model
FLAT = 0.2  # cosine of the angle to the normal below which a surface is seen too obliquely


Pair = tuple[ContactResult, ...]  # the passes of one contact


class ContactField(NamedTuple):
    """A field of contact surfaces: title, symbol, and what its unit is made of."""

    title: str
    symbol: str
    dimension: Literal["length", "stress"]

    def label(self, units: Units) -> Label:
        """What stands beside the colour bar."""
        return Label(f"{self.title} ${self.symbol}$", getattr(units, self.dimension))


CONTACT_FIELDS = {
    "pressure": ContactField("contact pressure", "p", "stress"),
    "gap": ContactField("gap", "g", "length"),
}


def draw_contact(
    samples: Samples,
    field: Literal["pressure", "gap"] = "pressure",
    units: Units = NO_UNITS,
    pair: Pair | None = None,
) -> Figure:
    """Draw contact pressure or gap on the secondary faces, undeformed, with outlines of the bodies where all is shown.

    Where the primary side is not opposite, the gap is no number, and grey.

    Parameters
    ----------
    samples : Samples
    field : str
    units : Units
    pair : tuple of ContactResult
        The passes of one contact; left out, all contacts are drawn.
    """
    result = samples.result
    parts = samples.secondary if pair is None else _parts(samples, pair)
    faces = secondary_faces(result, result.contacts if pair is None else pair)
    points = _detail(result, parts, field)
    size = size_of(result) if points is None else float(np.linalg.norm(np.ptp(points, axis=0)))
    inner, width = knot_lines(samples, faces, size)
    colours = contact_scale(np.concatenate([getattr(part, field) for part in parts]), field, size_of(result))
    surface = scene.merged(
        [scene.quadrilaterals(part.points, part.cells, field=getattr(part, field)) for part in parts]
    )
    layers = [
        coloured(surface, colours),
        Layer(scene.polylines([line for lines, _ in inner for line in lines]), {**LINE, "line_width": width}),
    ]
    if points is None:
        layers.append(Layer(scene.polylines(_outlines(samples)), OUTLINE))
    found = CONTACT_FIELDS[field]
    above = f"{found.title}: {colours.remark}" if colours.remark else ""
    remarks = Remarks(above, _below(pair, points is not None))
    return draw_page(layers, _direction(parts), colours, found.label(units), remarks, points)


def pairs_apart(samples: Samples) -> dict[int, Pair]:
    """Find the contacts that bear something, by their number in the case from 1, where each is a detail of its own.

    None, where a single picture shows them all as well.
    """
    passes = iter(samples.result.contacts)
    pairs: list[Pair] = [(one, next(passes)) if one.definition.two_pass else (one,) for one in passes]
    pressed = {
        number: pair
        for number, pair in enumerate(pairs, 1)
        if any(part.pressure.max() > 0 for part in _parts(samples, pair))
    }
    if len(pressed) < 2 or _detail(samples.result, samples.secondary, "pressure") is not None:
        return {}
    details = (_detail(samples.result, _parts(samples, pair), "pressure") for pair in pressed.values())
    return pressed if all(detail is not None for detail in details) else {}


def secondary_faces(result: Result, contacts: Sequence[ContactResult]) -> list[Face]:
    """List the secondary faces of contacts, each once."""
    each = (result.model.faces(contact.definition.secondary) for contact in contacts)
    return list(dict.fromkeys(face for faces in each for face in faces))


def contact_scale(values: Array, field: str, size: float) -> Scale:
    """Choose the colours of pressure or gap, some of which may be no numbers, in a model of a size [length]."""
    if np.isnan(values).all():
        return Scale((0.0, 1.0), SEQUENTIAL, "nowhere is the other side opposite")
    largest = float(np.nanmax(np.abs(values)))
    if field == "pressure" and largest == 0:
        return Scale((0.0, 1.0), SEQUENTIAL, "no contact")
    if field == "gap":
        return scale_of(values, max(largest, ROUNDING * size), True)
    scale = scale_of(values, largest, False)
    return scale if scale.remark else scale._replace(limits=(0.0, scale.limits[1]))


def _parts(samples: Samples, pair: Pair) -> tuple[ContactSamples, ...]:
    """Samples of the secondary faces of the passes of one contact."""
    return tuple(part for contact in pair for part in samples.contacts[contact])


def _outlines(samples: Samples) -> list[Array]:
    """The borders of all outer faces."""
    faces = outer_faces(samples.result.model)
    return [line for face in faces for family in families(samples, face) for line in borders(family)[0]]


def _below(pair: Pair | None, is_detail: bool) -> str:
    """Say what a picture shows where that is not all."""
    if pair is None:
        return "detail around the contact" if is_detail else ""
    name = plain(f"{pair[0].definition.secondary} on {pair[0].definition.primary}")
    return f"detail around {name}" if is_detail else name


def _detail(result: Result, parts: Sequence[ContactSamples], field: str) -> Array | None:
    """Points (q, 3) of a detail around the pressure, or all the gaps; None where it is large, or a single point."""
    points, pressure = (np.concatenate([getattr(part, key) for part in parts]) for key in ("points", "pressure"))
    pressed = pressure > EDGE * pressure.max()
    contact = points[pressed] if field == "pressure" and pressed.any() else points
    if not 0 < np.linalg.norm(np.ptp(contact, axis=0)) <= CLOSE * size_of(result):
        return None
    middle = (contact.min(axis=0) + contact.max(axis=0)) / 2
    around: Array = middle + AROUND * (contact - middle)
    return around


def _direction(parts: Sequence[ContactSamples]) -> Sequence[float]:
    """From where to look at contact surfaces: from above as usual, unless they are seen edgeways from there."""
    normals: Array = np.concatenate([part.normal for part in parts])
    across = normals @ np.array(ABOVE) / np.linalg.norm(ABOVE)
    if np.mean(np.abs(across)) > FLAT:
        return ABOVE
    mean = normals.mean(axis=0)
    return view_of(-mean if np.dot(ABOVE, mean) < 0 else mean)
