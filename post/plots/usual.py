"""The pictures of a run."""

from collections.abc import Callable
from functools import partial

from matplotlib.figure import Figure

from geom2iga.bspline import Array
from post.case import PostCase
from post.fields import Samples
from post.plots.bodies import draw_bodies, drawn
from post.plots.contact import draw_contact, pairs_apart
from post.plots.curves import draw_line, draw_point
from post.plots.deformation import deformation_scale
from post.plots.history import draw_load_steps, draw_newton, what_is_active
from post.plots.plane import draw_contact_plane
from post.probes import Probes
from post.quantities import QUANTITIES

BODIES = {"displacement": "uz", "stress": "stress_zz"}  # fields of the usual pictures of bodies


Pictures = dict[str, Callable[[], Figure]]


def pictures_of(samples: Samples, case: PostCase, probes: Probes) -> Pictures:
    """Tell how each picture of a run is drawn, by the name of its file without ending.

    Parameters
    ----------
    samples : Samples
    case : PostCase
    probes : Probes
        Fields along the lines and at the points of the case.
    """
    result, units, fine = samples.result, case.units, drawn(samples)
    scale = case.post.deformation or deformation_scale(result)
    pictures: Pictures = {name: partial(draw_bodies, fine, field, units, scale) for name, field in BODIES.items()}
    if result.contacts:
        pictures |= _pictures_of_pressure(fine, case)
        pictures["contact_plane"] = partial(draw_contact_plane, fine, units)
    if result.contacts and len(result.states) > 1:
        pictures["load_steps"] = partial(draw_load_steps, result, units)
    if result.history:
        pictures["newton"] = partial(draw_newton, result.history, what_is_active(result))
    for wanted in case.post.picture:
        pictures[f"picture_{wanted.name}"] = partial(draw_bodies, fine, wanted.field, units, scale, wanted)
    return pictures | _pictures_of_probes(case, probes)


def _pictures_of_pressure(samples: Samples, case: PostCase) -> Pictures:
    """One picture of all contacts, or where each is a detail of its own, one of each that bears something."""
    apart = pairs_apart(samples)
    if not apart:
        return {"contact_pressure": partial(draw_contact, samples, "pressure", case.units)}
    return {
        f"contact_pressure_{number}": partial(draw_contact, samples, "pressure", case.units, pair)
        for number, pair in apart.items()
    }


def _pictures_of_probes(case: PostCase, probes: Probes) -> Pictures:
    """Fields along lines, and over load steps where there are several."""
    pictures: Pictures = {}
    for line in case.post.line:
        along = probes.lines[line.name]
        values: dict[str, Array] = {line.field: QUANTITIES[line.field].values(along.samples)}
        pictures[f"line_{line.name}"] = partial(draw_line, along.distance, values, case.units, along.body)
    for point in case.post.point:
        steps = probes.points[point.name]
        values = {point.field: QUANTITIES[point.field].values(steps.samples)}
        if len(steps.load_factor) > 1:
            pictures[f"point_{point.name}"] = partial(draw_point, steps.load_factor, values, case.units)
    return pictures
