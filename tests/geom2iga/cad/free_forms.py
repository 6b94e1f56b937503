"""CAD models of splines that become blocks, and models some face of which can only be fitted."""

from math import pi, radians

import numpy as np

from tests.geom2iga.cad.registry import Registry
from tests.geom2iga.cad.shapes import (
    HEX_FACES,
    SQUARE,
    cut_above,
    level,
    lifted,
    on_circle,
    pipe_quarter,
    plate,
    rectangle,
    sector_integral,
    solid,
    surface_within,
    turned_about_z,
)

FREE_FORMS = Registry()

BOW = [0.0, 0.3, -0.2, 0.4]  # control values of a cubic Bézier curve: their mean is its integral over 0..1


def bow_profile(occ, add_curve, axis):
    """A strip below a curve over 0..3, the curve 2 to 3 high, in the plane y = 0 or z = 0."""
    places = [np.insert([x, 2 + rise], axis, 0) for x, rise in zip(range(4), BOW, strict=True)]
    tags = [occ.addPoint(*place) for place in places]
    foot = [occ.addPoint(0, 0, 0), occ.addPoint(3, 0, 0)]
    sides = [
        occ.addLine(*foot),
        occ.addLine(foot[1], tags[-1]),
        add_curve(tags),
        occ.addLine(tags[0], foot[0]),
    ]
    return surface_within(occ, sides, plane=True)


@FREE_FORMS.entry(1, 3 * (2 + np.mean(BOW)))
def extruded_bezier_profile(occ):
    lifted(occ, [bow_profile(occ, occ.addBezier, 2)], 1)


@FREE_FORMS.entry(1, None)
def extruded_spline_profile(occ):
    lifted(occ, [bow_profile(occ, occ.addSpline, 2)], 1)


@FREE_FORMS.entry(1, None)
def extruded_rational_spline_profile(occ):
    weights, knots, counts = [1, 0.6, 1.4, 1], [0, 0.4, 1], [3, 1, 3]
    lifted(occ, [bow_profile(occ, lambda tags: occ.addBSpline(tags, -1, 2, weights, knots, counts), 2)], 1)


def revolved_bow(add_curve):
    """A strip under a curve, turned by 80 degrees about an axis beside it."""

    def make(occ):
        strip = bow_profile(occ, add_curve(occ), 1)
        occ.translate([(2, strip)], 1, 0, 0)
        turned_about_z(occ, strip, 80)

    return make


RING_OF_BOW = radians(80) * 3 * sum((2 + rise) * (3 * (k + 1) / 20 + 1 / 4) for k, rise in enumerate(BOW))
FREE_FORMS.enter("revolved_bezier_profile", revolved_bow(lambda occ: occ.addBezier), 1, RING_OF_BOW)
FREE_FORMS.enter("revolved_spline_profile", revolved_bow(lambda occ: occ.addSpline), 1, None)


def wavy_hexahedron(occ, add_curve, fill):
    """A cube with twelve curved edges and six curved faces."""
    random = np.random.default_rng(5)
    corners = np.array([*level(SQUARE, -1), *level(SQUARE, 1)]) + random.uniform(-0.1, 0.1, (8, 3))
    tags = [occ.addPoint(*corner) for corner in corners]
    curves = {}
    for face in HEX_FACES:
        for side in map(frozenset, zip(face, (*face[1:], face[0]), strict=True)):
            if side not in curves:
                start, end = side
                inner = corners[start] + np.array([[0.3], [0.7]]) * (corners[end] - corners[start])
                inner += random.uniform(-0.2, 0.2, inner.shape)
                curves[side] = add_curve([tags[start], *(occ.addPoint(*at) for at in inner), tags[end]])
    faces = [[curves[side] for side in map(frozenset, zip(f, (*f[1:], f[0]), strict=True))] for f in HEX_FACES]
    return solid(occ, [fill(occ.addWire(face)) for face in faces])


@FREE_FORMS.entry(1, None)
def six_curved_faces(occ):
    wavy_hexahedron(
        occ, lambda tags: occ.addBSpline(tags, degree=3), lambda w: occ.addBSplineFilling(w, type="Stretch")
    )


@FREE_FORMS.entry(1, None)
def six_rounded_faces(occ):
    wavy_hexahedron(occ, lambda tags: occ.addBSpline(tags, degree=2), lambda w: occ.addBSplineFilling(w, type="Curved"))


@FREE_FORMS.entry(1, None)
def six_bezier_faces(occ):
    wavy_hexahedron(occ, occ.addBezier, lambda w: occ.addBezierFilling(w, type="Stretch"))


def hilly_surface(occ, weights=()):
    """A bi-quadratic surface over the square 0..3, of 2 by 1 spans."""
    random = np.random.default_rng(3)
    places = [(x, y, random.uniform(2, 3)) for y in (0, 1.5, 3) for x in (0, 0.75, 2.25, 3)]
    tags = [occ.addPoint(*at) for at in places]
    return occ.addBSplineSurface(tags, 4, -1, 2, 2, weights, [0, 0.5, 1], [0, 1], [3, 1, 3], [3, 3])


@FREE_FORMS.entry(1, 18.0)
def extruded_spline_surface(occ):
    lifted(occ, [hilly_surface(occ)], -2)


@FREE_FORMS.entry(1, 18.0)
def extruded_rational_surface_with_uneven_corners(occ):
    lifted(occ, [hilly_surface(occ, [1, 0.8, 1.2, 0.7, 1, 1.3, 0.9, 1, 1.2, 1, 1, 0.8])], 2)


@FREE_FORMS.entry(1, None)
def revolved_spline_surface(occ):
    hill = hilly_surface(occ)
    occ.revolve([(2, hill)], 0, -1, 0, 1, 0, 0, -0.6)


@FREE_FORMS.entry(1, 0.75 * pi)
def rectangle_swept_along_an_arc(occ):
    section = rectangle(occ, (1, 2), (0, 1))
    arc = occ.addCircleArc(occ.addPoint(1.5, 0, 0.5), occ.addPoint(0, 0, 0.5), occ.addPoint(0, 1.5, 0.5))
    occ.addPipe([(2, section)], occ.addWire([arc]))
    occ.remove([(2, section)], recursive=True)
    occ.remove([(1, arc)], recursive=True)


@FREE_FORMS.entry(1, None)
def rectangle_swept_along_a_spline(occ):
    section = rectangle(occ, (-0.5, 0.5), (-0.5, 0.5))
    way = occ.addBSpline([occ.addPoint(*at) for at in ((0, 0, 0), (0, 2, 0), (1, 4, 1), (1, 6, 1))])
    occ.addPipe([(2, section)], occ.addWire([way]))
    occ.remove([(2, section)], recursive=True)
    occ.remove([(1, way)], recursive=True)


@FREE_FORMS.entry(1, 3 * pi / 2)
def mirrored_pipe_quarter(occ):
    occ.mirror([(3, pipe_quarter(occ, 2))], 1, 2, 0.5, 0.3)


@FREE_FORMS.entry(1, 8 * 3 * pi / 2)
def dilated_pipe_quarter(occ):
    occ.dilate([(3, pipe_quarter(occ, 2))], 0, 0, 1, 2, 2, 2)


@FREE_FORMS.entry(1, 3 * pi / 2 * 0.75)
def stretched_pipe_quarter(occ):
    occ.dilate([(3, pipe_quarter(occ, 2))], 0, 0, 1, 2, 0.75, 0.5)


@FREE_FORMS.entry(1, 3 * pi / 2 * 2)
def sheared_pipe_quarter(occ):
    occ.affineTransform([(3, pipe_quarter(occ, 2))], [1, 0.2, 0.3, 0, 0, 2, 0.1, 1, 0, 0, 1, 0])


# Faces that no exact rule fits


def fitted(kind):
    """What the message under `exact = true` says of a face."""
    return rf"face \d+\b.*{kind}.*fitted"


@FREE_FORMS.entry(1, sector_integral(lambda x, y: np.sqrt(36 - x**2) - 1, (1, 2), (0, 90)), message=fitted("cylinder"))
def pipe_quarter_cut_by_a_cylinder(occ):
    roll = occ.addCylinder(0, -5, -1, 0, 10, 0, 6)
    occ.intersect([(3, pipe_quarter(occ, 8))], [(3, roll)])


@FREE_FORMS.entry(1, None, message=fitted("cone"))
def conical_sector_cut_obliquely(occ):
    cut_above(occ, turned_about_z(occ, plate(occ, [(1, 0, 0), (3, 0, 0), (2, 0, 6), (1, 0, 6)]), 90))


@FREE_FORMS.entry(1, None, message="hyperbola|" + fitted("cone"))
def block_with_conical_bottom(occ):
    cone = occ.addCone(-6, 0, 8, 12, 0, 0, 7.5, 8.5)
    occ.intersect([(3, occ.addBox(-1, -1, -1, 2, 2, 4))], [(3, cone)])


@FREE_FORMS.entry(1, None, message=fitted("torus"))
def block_with_toroidal_bottom(occ):
    ring = occ.addTorus(0, 0, 0, 20, 8)
    occ.rotate([(3, ring)], 0, 0, 0, 0, 0, 1, 1)
    occ.intersect([(3, occ.addBox(-1, 19, -9, 2, 2, 4))], [(3, ring)])


@FREE_FORMS.entry(1, None, message=fitted(""))
def block_under_a_trimmed_spline_surface(occ):
    hill = lifted(occ, [hilly_surface(occ)], -4)[0]
    block = occ.addBox(0.8, 0.7, 1.5, 1.2, 1.4, 3)
    occ.rotate([(3, block)], 1.5, 1.5, 0, 0, 0, 1, 0.4)
    occ.intersect([(3, block)], [(3, hill)])


@FREE_FORMS.entry(1, None, message=fitted("B-spline"))
def rectangle_swept_along_a_helix(occ):
    """OpenCASCADE's own edges lie 2e-5 off its surfaces."""
    section = rectangle(occ, (1, 2), (0, 1))
    places = [on_circle(1.5, 10 * k, 0.1 * k) for k in range(10)]
    way = occ.addSpline([occ.addPoint(*at) for at in places])
    occ.addPipe([(2, section)], occ.addWire([way]), "Frenet")
    occ.remove([(2, section)], recursive=True)
    occ.remove([(1, way)], recursive=True)
