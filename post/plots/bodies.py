"""Deformed bodies with their knot lines, coloured by a scalar field, whole or cut."""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from geom2iga.bspline import Array
from geom2iga.errors import CaseError, suggestion
from geom2iga.model import Model
from geom2iga.patch import Face
from geom2iga.picture import scene
from geom2iga.picture.scene import ABOVE, Layer
from geom2iga.picture.skin import outer_faces
from geom2iga.tables import Units
from post.case import Look
from post.fields import Samples
from post.plots import cut as cutting
from post.plots.deformation import deformation_scale, size_of, stress_of
from post.plots.lines import Family, knot_lines
from post.plots.page import LINE, Remarks, coloured, draw_page
from post.plots.style import NO_UNITS, Label, Scale, scale_between, scale_of
from post.quantities import QUANTITIES, Quantity
from post.wanted import nothing_behind
from solve.result import Result

ALL = Look()
FEWEST, SAMPLES = 2, 17  # per span and direction, on the surfaces drawn
FINE, FINEST = 60_000, 250_000  # quadrilaterals that look smooth, and that an image of two million pixels can show


def drawn(samples: Samples) -> Samples:
    """Choose the samples to draw: those at hand where they are fine, but not too fine, else others."""
    model = samples.result.model
    spans = 0
    for face in outer_faces(model):
        first, second = model.surface(face).breaks
        spans += (len(first) - 1) * (len(second) - 1)
    if FINE <= spans * (samples.count - 1) ** 2 <= FINEST:
        return samples
    return Samples(samples.result, int(np.clip(1 + np.ceil((FINE / spans) ** 0.5), FEWEST, SAMPLES)))


def plot(result: Result, field: str = "von_mises", units: Units = NO_UNITS, look: Look = ALL) -> Figure:
    """Draw the deformed bodies of a result coloured by a field, for a notebook.

    Parameters
    ----------
    field : str
        A key of `QUANTITIES`.
    units : Units
    look : Look
        What is shown, and from where: `Look(view=(1, 0, 0), cut=Cut(origin=(0, 0, 0), normal=(1, 0, 0)))`.
    """
    return draw_bodies(drawn(Samples(result, SAMPLES)), field, units, look=look)


def draw_bodies(
    samples: Samples,
    field: str,
    units: Units = NO_UNITS,
    scale: float | None = None,
    look: Look = ALL,
) -> Figure:
    """Draw deformed bodies coloured by a scalar field, with their knot lines.

    Parameters
    ----------
    samples : Samples
        As `drawn` chooses them.
    field : str
        A key of `QUANTITIES`.
    units : Units
    scale : float
        Factor on the displacements; left out, `deformation_scale` chooses it.
    look : Look
        Which bodies are drawn, from where, and how much of them. A cut is a plane through the undeformed bodies; what
        lies behind it is drawn, and the field inside is seen on the face cut.

    Raises
    ------
    CaseError
        There is no such field or body, or nothing lies behind the plane.
    """
    quantity, result = _quantity(field), samples.result
    scale = deformation_scale(result) if scale is None else scale
    names = _patches(result.model, look.bodies)
    if look.cut is not None:
        samples = cutting.affordable(samples, names, look.cut)
    faces = [face for face in outer_faces(result.model) if face.patch in names]
    size = size_of(result) if look.box is None else float(np.linalg.norm(np.ptp(look.box, axis=0)))
    found, width = knot_lines(samples, faces, size, look.knot_lines)
    surfaces, lines = [_surface(samples, face, quantity) for face in faces], [_polylines(family) for family in found]
    if look.cut is not None:
        cut = cutting.moved_back(look.cut, size_of(result))
        inside = cutting.cut_faces(samples, names, quantity, cut, look.knot_lines)
        surfaces, lines = ([*cutting.behind(a, cut), *b] for a, b in zip((surfaces, lines), inside, strict=True))
        if not surfaces:
            points = np.concatenate([samples.face(face).points for face in faces])
            raise CaseError(nothing_behind(look.cut, points))
    colours = _colours(look, surfaces, quantity, _size(samples, faces, quantity))
    style = {**LINE, "line_width": width}
    layers = [coloured(_moved(surfaces, scale), colours), Layer(_moved(lines, scale), style)]
    above = f"{quantity.label}: {colours.remark}" if colours.remark else ""
    below = f"displacements enlarged {scale:g} times" if scale != 1 else "displacements drawn to scale"
    label = Label(quantity.label, getattr(units, quantity.dimension))
    return draw_page(layers, _direction(look), colours, label, Remarks(above, below), _corners(look))


def _colours(look: Look, surfaces: Sequence[Any], quantity: Quantity, size: float) -> Scale:
    """Colours of the field, as wanted or as it is."""
    values = np.concatenate([mesh["field"] for mesh in surfaces])
    if look.limits is not None:
        return scale_between(look.limits, values, quantity.signed)
    return scale_of(values, size, quantity.signed)


def _direction(look: Look) -> Sequence[float]:
    """From where to look: as wanted, else from before the cut, else as usual."""
    if look.view is not None:
        return look.view
    return ABOVE if look.cut is None else cutting.view_of(look.cut.direction)


def _corners(look: Look) -> Array | None:
    """The corners (8, 3) of what fills the picture."""
    return None if look.box is None else np.array(list(product(*zip(*look.box, strict=True))))


def _quantity(field: str) -> Quantity:
    if field not in QUANTITIES:
        raise CaseError(f'no field is called "{field}"; {suggestion(field, QUANTITIES)}')
    return QUANTITIES[field]


def _patches(model: Model, bodies: Sequence[str] | None) -> list[str]:
    """Names of the patches of some bodies."""
    for body in bodies or ():
        if body not in model.bodies:
            raise CaseError(f'a picture asks for body "{body}", which there is not; {suggestion(body, model.bodies)}')
    return [name for body in (model.bodies if bodies is None else bodies) for name in model.bodies[body]]


def _surface(samples: Samples, face: Face, quantity: Quantity) -> Any:
    """A face, undeformed, with "field" and "displacement"."""
    part = samples.face(face)
    field = quantity.values(part)
    return scene.quadrilaterals(part.points, part.cells, field=field, displacement=part.displacement)


def _polylines(family: Family) -> Any:
    """Knot lines, undeformed, with "displacement"."""
    return scene.polylines(list(family[0]), displacement=family[1].reshape(-1, 3))


def _moved(meshes: Sequence[Any], scale: float) -> Any:
    """One mesh of several at their deformed places."""
    there = scene.merged(meshes)
    there.points = np.asarray(there.points) + scale * np.asarray(there["displacement"])
    return there


def _size(samples: Samples, faces: Sequence[Face], quantity: Quantity) -> float:
    """The largest component of the tensor or vector that the quantity is taken from; of stress at least rounding."""
    name = {"length": "displacement", "stress": "stress"}[quantity.dimension]
    largest = max(float(np.nanmax(np.abs(getattr(samples.face(face), name)), initial=0.0)) for face in faces)
    return largest if quantity.dimension == "length" else max(largest, stress_of(samples.result))
