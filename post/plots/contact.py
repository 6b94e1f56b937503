"""Pressure and gap of contacts, on the surface in space."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from geom2iga.bspline import Array
from geom2iga.patch import Face
from geom2iga.picture import scene
from geom2iga.picture.scene import ABOVE, Layer
from geom2iga.picture.skin import outer_faces
from geom2iga.tables import Units
from post.fields import ContactSamples, Samples
from post.plots.cut import view_of
from post.plots.deformation import size_of
from post.plots.lines import borders, families, knot_lines
from post.plots.page import LINE, OUTLINE, Remarks, coloured, draw_page
from post.plots.style import NO_UNITS, SEQUENTIAL, Label, Scale, scale_of
from solve.result import Result

EDGE = 0.01  # contact ends where less than this part of the largest pressure is left
CLOSE = 0.3  # contact smaller than this, in sizes of the model, is drawn alone
AROUND = 1.5  # what is seen then, in sizes of the contact
ROUNDING = 1e-6  # size against which gaps are looked at that are all closed, in sizes of the model
FLAT = 0.2  # cosine of the angle to the normal below which a surface is seen too obliquely


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


def draw_contact(samples: Samples, field: Literal["pressure", "gap"] = "pressure", units: Units = NO_UNITS) -> Figure:
    """Draw contact pressure or gap on the secondary faces, the bodies as outlines; undeformed.

    Where the primary side is not opposite, the gap is no number, and grey.
    """
    result, parts, faces = samples.result, samples.secondary, secondary_faces(samples.result)
    outer = [borders(family) for face in outer_faces(result.model) for family in families(samples, face)]
    points, is_detail = _framed(result, np.concatenate([_looked_at(part, field) for part in parts]))
    inner, width = knot_lines(samples, faces, float(np.linalg.norm(np.ptp(points, axis=0))))
    colours = contact_scale(np.concatenate([getattr(part, field) for part in parts]), field, size_of(result))
    surface = scene.merged(
        [scene.quadrilaterals(part.points, part.cells, field=getattr(part, field)) for part in parts]
    )
    layers = [
        coloured(surface, colours),
        Layer(scene.polylines([line for points, _ in inner for line in points]), {**LINE, "line_width": width}),
        Layer(scene.polylines([line for points, _ in outer for line in points]), OUTLINE),
    ]
    found = CONTACT_FIELDS[field]
    above = f"{found.title}: {colours.remark}" if colours.remark else ""
    remarks = Remarks(above, "detail around the contact" if is_detail else "")
    return draw_page(layers, _direction(parts), colours, found.label(units), remarks, points)


def secondary_faces(result: Result) -> list[Face]:
    """List the secondary faces of all contacts, each once."""
    each = (result.model.faces(contact.definition.secondary) for contact in result.contacts)
    return list(dict.fromkeys(face for faces in each for face in faces))


def contact_scale(values: Array, field: str, size: float) -> Scale:
    """Choose the colours of pressure or gap, some of which may be no numbers, in a model of a size [length]."""
    if np.isnan(values).all():
        return Scale((0.0, 1.0), SEQUENTIAL, "nowhere is the other side opposite")
    largest = float(np.nanmax(np.abs(values)))
    if field == "gap":
        return scale_of(values, max(largest, ROUNDING * size), True)
    scale = scale_of(values, largest, False)
    return scale if scale.remark else scale._replace(limits=(0.0, scale.limits[1]))


def _looked_at(part: ContactSamples, field: str) -> Array:
    """Points (q, 3) with pressure; of the gap, or where there is no pressure, all."""
    pressed = part.points[part.pressure > EDGE * part.pressure.max()]
    return part.points if field == "gap" or not len(pressed) else pressed


def _framed(result: Result, contact: Array) -> tuple[Array, bool]:
    """Points (q, 3) that the picture shows: all, or where this is a detail, contact and what is near."""
    if np.linalg.norm(np.ptp(contact, axis=0)) > CLOSE * size_of(result):
        return result.space.control_points, False
    middle = (contact.min(axis=0) + contact.max(axis=0)) / 2
    return np.concatenate([middle + AROUND * (contact - middle), contact]), True


def _direction(parts: Sequence[ContactSamples]) -> Sequence[float]:
    """From where to look at contact surfaces: from above as usual, unless they are seen edgeways from there."""
    normals: Array = np.concatenate([part.normal for part in parts])
    across = normals @ np.array(ABOVE) / np.linalg.norm(ABOVE)
    if np.mean(np.abs(across)) > FLAT:
        return ABOVE
    mean = normals.mean(axis=0)
    return view_of(-mean if np.dot(ABOVE, mean) < 0 else mean)
