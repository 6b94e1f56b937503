"""Deformed bodies with their knot lines, coloured by a scalar field, whole or cut."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from geom2iga.errors import CaseError, suggestion
from geom2iga.model import Model
from geom2iga.patch import Face
from geom2iga.picture import scene
from geom2iga.picture.scene import ABOVE, Layer
from geom2iga.picture.skin import outer_faces
from geom2iga.tables import Units
from post.case import Cut
from post.fields import Samples
from post.plots import cut as cutting
from post.plots.deformation import deformation_scale, size_of
from post.plots.lines import Family, knot_lines
from post.plots.page import LINE, Remarks, coloured, draw_page
from post.plots.style import NO_UNITS, Label, scale_of
from post.quantities import QUANTITIES, Quantity
from solve.result import Result

FEWEST, SAMPLES = 2, 9  # per span and direction, on the surfaces drawn
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


def plot(result: Result, field: str = "von_mises", units: Units = NO_UNITS, cut: Cut | None = None) -> Figure:
    """Draw the deformed bodies of a result coloured by a field, for a notebook.

    Parameters
    ----------
    field : str
        A key of `QUANTITIES`.
    units : Units
    cut : Cut
        A plane that shows the inside; left out, the outer faces are drawn.
    """
    return draw_bodies(drawn(Samples(result, SAMPLES)), field, units, cut=cut)


def draw_bodies(
    samples: Samples,
    field: str,
    units: Units = NO_UNITS,
    scale: float | None = None,
    bodies: Sequence[str] | None = None,
    cut: Cut | None = None,
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
    bodies :
        Names of those to draw; left out, all.
    cut : Cut
        Plane through the undeformed bodies; what lies behind it is drawn. The field inside is seen on the face cut.

    Raises
    ------
    CaseError
        There is no such field or body, or nothing lies behind the plane.
    """
    quantity, result = _quantity(field), samples.result
    scale = deformation_scale(result) if scale is None else scale
    names = _patches(result.model, bodies)
    faces = [face for face in outer_faces(result.model) if face.patch in names]
    found, width = knot_lines(samples, faces, size_of(result))
    surfaces, lines = [_surface(samples, face, quantity) for face in faces], [_polylines(family) for family in found]
    if cut is not None:
        cut = cutting.moved_back(cut, size_of(result))
        inside = cutting.cut_faces(result, names, quantity, cut)
        surfaces, lines = ([*cutting.behind(a, cut), *b] for a, b in zip((surfaces, lines), inside, strict=True))
        if not surfaces:
            raise CaseError(_nothing_behind(samples, faces, cut))
    values = np.concatenate([mesh["field"] for mesh in surfaces])
    colours = scale_of(values, _size(samples, faces, quantity), quantity.signed)
    style = {**LINE, "line_width": width}
    layers = [coloured(_moved(surfaces, scale), colours), Layer(_moved(lines, scale), style)]
    direction = ABOVE if cut is None else cutting.view_of(cut.normal)
    above = f"{quantity.label}: {colours.remark}" if colours.remark else ""
    below = f"displacements drawn {scale:g} times" if scale != 1 else "displacements drawn to scale"
    return draw_page(
        layers, direction, colours, Label(quantity.label, getattr(units, quantity.dimension)), Remarks(above, below)
    )


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
    """The largest component of the tensor or vector that the quantity is taken from."""
    name = {"length": "displacement", "stress": "stress"}[quantity.dimension]
    return max(float(np.nanmax(np.abs(getattr(samples.face(face), name)))) for face in faces)


def _nothing_behind(samples: Samples, faces: Sequence[Face], cut: Cut) -> str:
    """Say that a plane leaves nothing to draw."""
    points = np.concatenate([samples.face(face).points for face in faces])
    low, high = (", ".join(f"{x:.4g}" for x in end) for end in (points.min(axis=0), points.max(axis=0)))
    return (
        f"cut: nothing lies behind the plane through {cut.origin} with normal {cut.normal}, the bodies drawn reach "
        f"from ({low}) to ({high}): move its origin, or turn its normal round"
    )
