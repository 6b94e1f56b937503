"""CAD models that become blocks: volumes of six faces with four edges each, without seams and poles."""

from math import cos, pi, radians, sin

import numpy as np

from tests.geom2iga.cad.free_forms import FREE_FORMS
from tests.geom2iga.cad.registry import Registry
from tests.geom2iga.cad.shapes import (
    SQUARE,
    cap_block,
    cut_above,
    cut_height,
    fused,
    hexahedron_volume,
    integral,
    level,
    lifted,
    loft,
    ogrid_plates,
    on_circle,
    pipe_quarter,
    plate,
    polyhedron,
    rectangle,
    sector_integral,
    surface_within,
    turned_about_z,
)

MODELS = Registry()
ORIGIN = (0, 0, 0)
TURN = np.array([[cos(0.5), sin(0.5)], [-sin(0.5), cos(0.5)]])  # corners @ TURN: by 0.5 about z


# Straight edges


@MODELS.entry(1, 6.0)
def box(occ):
    occ.addBox(0, 0, 0, 1, 2, 3)


@MODELS.entry(1, 6.0)
def turned_box(occ):
    occ.rotate([(3, occ.addBox(-1, -1, 0, 1, 2, 3))], 0.2, 0, 1, 1, 2, -1, 0.7)


@MODELS.entry(1, 4.0)
def box_turned_by_45_degrees(occ):
    occ.rotate([(3, occ.addBox(0, 0, 0, 2, 2, 1))], 1, 1, 0, 0, 0, 1, pi / 4)


MODELS.enter("tiny_box", lambda occ: occ.addBox(0, 0, 0, 1e-3, 2e-3, 3e-3), 1, 6e-9)
MODELS.enter("huge_box", lambda occ: occ.addBox(-500, 0, 0, 1e3, 2e3, 3e3), 1, 6e9)
MODELS.enter("box_far_away", lambda occ: occ.addBox(1000, -2000, 3000, 1, 2, 3), 1, 6.0)
MODELS.enter("slender_box", lambda occ: occ.addBox(0, 0, 0, 1e-2, 1e-2, 10), 1, 1e-3)

TRAPEZIUM = [[0, 0], [4, 0], [3, 2], [1, 2]]
HEXAHEDRA = {
    "wedge": np.concatenate([level(SQUARE, 0), [[-1, -1, 1], [1, -1, 2], [1, 1, 2], [-1, 1, 1]]]),
    "sheared_prism": np.concatenate([level(SQUARE, 0), level(np.add(SQUARE, [1.5, 0.5]), 2)]),
    "tapered_prism": np.concatenate([level(SQUARE, 0), level(SQUARE * [0.4, 0.4], 3)]),
    "trapezoidal_prism": np.concatenate([level(TRAPEZIUM, 0), level(TRAPEZIUM, 1)]),
    "hexahedron_with_ruled_faces": np.concatenate(
        [level(SQUARE, 0), np.add(level(SQUARE, 2), [[0, 0, 0.5], [0.3, 0, 0], [0, 0.4, 0.6], [0, 0, 0]])]
    ),
    "hexahedron_twisted_by_200_degrees": np.concatenate(
        [level(SQUARE, 0), level(SQUARE @ np.linalg.matrix_power(TURN, 7), 2)]
    ),
}
for shape, places in HEXAHEDRA.items():
    MODELS.enter(shape, lambda occ, places=places: polyhedron(occ, places), 1, hexahedron_volume(places))


@MODELS.entry(1, hexahedron_volume([*level(SQUARE, 0), *level(0.6 * SQUARE, 2)]))
def frustum_by_loft(occ):
    loft(occ, level(SQUARE, 0), level(0.6 * SQUARE, 2))


@MODELS.entry(1, hexahedron_volume([*level(SQUARE, 0), *level(0.8 * SQUARE @ TURN, 2)]))
def twisted_loft(occ):
    loft(occ, level(SQUARE, 0), level(0.8 * SQUARE @ TURN, 2))


@MODELS.entry(1, None)
def smooth_loft(occ):
    loft(occ, level(SQUARE, 0), level(0.7 * SQUARE, 1), level(1.1 * SQUARE, 2), ruled=False)


@MODELS.entry(1, None)
def smooth_twisted_loft(occ):
    loft(occ, *(level((1 - k / 8) * SQUARE @ np.linalg.matrix_power(TURN, k), k) for k in range(4)), ruled=False)


@MODELS.entry(2, 4 / 3 * (1 + 0.7 + 0.49) + 4 / 3 * (1.21 + 0.77 + 0.49), glued=1)
def two_lofts_on_each_other(occ):
    middle = level(0.7 * SQUARE, 1)
    fused(occ, 3, [loft(occ, level(SQUARE, 0), middle), loft(occ, middle, level(1.1 * SQUARE, 2))])


@MODELS.entry(1, 16.0)
def box_cut_obliquely(occ):
    cut_above(occ, occ.addBox(-1, -1, -1, 2, 2, 8))


@MODELS.entry(2, 2 * (4 - 0.125), glued=1)
def chamfered_box_in_two(occ):
    block = occ.addBox(0, 0, 0, 2, 2, 2)
    corner = lifted(occ, [plate(occ, [(2, 1.5, 0), (2, 2, 0), (1.5, 2, 0)])], 2)[0]
    occ.cut([(3, block)], [(3, corner)])
    divider = plate(occ, [(1, 0, 0), (1.5, 2, 0), (1.5, 2, 2), (1, 0, 2)])
    occ.fragment([(3, block)], [(2, divider)])


@MODELS.entry(2, 6.0, bodies=2)
def two_boxes_that_touch(occ):
    occ.addBox(0, 0, 0, 1, 1, 3)
    occ.addBox(1, 0, 0, 1, 1, 3)


@MODELS.entry(2, 6.0 + 0.125, bodies=2)
def small_box_on_a_box(occ):
    occ.addBox(0, 0, 0, 1, 2, 3)
    occ.addBox(0.25, 0.5, 3, 0.5, 0.5, 0.5)


@MODELS.entry(8, 8.0, glued=12)
def eight_boxes(occ):
    fused(occ, 3, [occ.addBox(x, y, z, 1, 1, 1) for x in (0, 1) for y in (0, 1) for z in (0, 1)])


@MODELS.entry(3, 6.0, glued=2)
def l_of_three_boxes(occ):
    fused(occ, 3, [occ.addBox(x, y, 0, 1, 2, 1) for x, y in ((0, 0), (1, 0), (0, 2))])


def fan(occ, count):
    """Hexahedra around one edge."""
    plates = []
    for k in range(count):
        rim = [on_circle(radius, (k + part) * 360 / count) for radius, part in ((1, 0), (1.2, 0.5), (1, 1))]
        plates.append(plate(occ, [ORIGIN, *rim]))
    lifted(occ, fused(occ, 2, plates), 1)


for spokes in (3, 5, 6):
    MODELS.enter(
        f"fan_of_{spokes}", lambda occ, k=spokes: fan(occ, k), spokes, spokes * 1.2 * sin(pi / spokes), glued=spokes
    )


# Arcs, extruded and revolved


@MODELS.entry(1, 3 * pi / 4)
def quarter_annulus_extruded(occ):
    corners = [(1, 0, 0), (2, 0, 0), (0, 2, 0), (0, 1, 0)]
    lifted(occ, [plate(occ, corners, {1: ORIGIN, 3: ORIGIN})], 1)


for angle in (90, 120, 200, 340):
    MODELS.enter(
        f"rectangle_revolved_by_{angle}_degrees",
        lambda occ, angle=angle: turned_about_z(occ, rectangle(occ, (1, 2), (0, 2)), angle),
        1,
        3 * radians(angle),  # its area is 2, its centre lies 1.5 off the axis
    )


@MODELS.entry(1, 6 * radians(70))
def ring_sector_of_a_tilted_square(occ):
    turned_about_z(occ, plate(occ, [(3, 0, 0), (4, 0, 1), (3, 0, 2), (2, 0, 1)]), 70)


@MODELS.entry(1, 3 * (2 + pi) * radians(100))
def torus_sector_with_bulged_sides(occ):
    turned_about_z(occ, plate(occ, [(2, 0, -1), (4, 0, -1), (4, 0, 1), (2, 0, 1)], {0: (3, 0, 0), 2: (3, 0, 0)}), 100)


@MODELS.entry(1, 8 * pi / 3)
def conical_sector(occ):
    turned_about_z(occ, plate(occ, [(1, 0, 0), (3, 0, 0), (2, 0, 2), (1, 0, 2)]), 90)


@MODELS.entry(1, integral(lambda z, _: ((2 + np.sqrt(2 - z**2)) ** 2 - 1) / 2, (-1, 1), (0, pi / 3)))
def block_with_toroidal_side(occ):
    turned_about_z(occ, plate(occ, [(1, 0, -1), (3, 0, -1), (3, 0, 1), (1, 0, 1)], {1: (2, 0, 0)}), 60)


@MODELS.entry(4, 1.5 * pi, glued=4)
def pipe_cut_through_its_seam(occ):
    """The seam of each cylinder is an edge of two blocks."""
    pipe = occ.cut([(3, occ.addCylinder(0, 0, 0, 0, 0, 2, 1))], [(3, occ.addCylinder(0, 0, 0, 0, 0, 2, 0.5))])[0]
    planes = [(2, occ.addRectangle(-3, -3, 1, 6, 6)) for _ in range(2)]
    occ.rotate(planes, 0, 0, 1, 1, 0, 0, pi / 2)
    occ.rotate(planes[1:], 0, 0, 1, 0, 0, 1, pi / 2)
    pieces = occ.fragment(pipe, planes)[0]
    occ.remove([entity for entity in pieces if entity[0] == 2], recursive=True)


@MODELS.entry(4, 6 * pi, glued=4)
def pipe_in_four(occ):
    fused(occ, 3, [pipe_quarter(occ, 2, 90 * k) for k in range(4)])


@MODELS.entry(5, 2 * pi, glued=8)
def cylinder_in_five(occ):
    lifted(occ, ogrid_plates(occ), 2)


@MODELS.entry(5, 2 * pi * (1 + 0.6 + 0.36) / 3, glued=8)
def cone_in_five(occ):
    core = [*level(0.5 * SQUARE, 0), *level(0.3 * SQUARE, 2)]
    blocks = [polyhedron(occ, core)]
    for k in range(4):
        quarter = occ.addCone(0, 0, 0, 0, 0, 2, 1, 0.6, angle=pi / 2)
        occ.rotate([(3, quarter)], 0, 0, 0, 0, 0, 1, pi / 4 + k * pi / 2)
        blocks.append(occ.cut([(3, quarter)], [(3, polyhedron(occ, core))])[0][0][1])
    fused(occ, 3, blocks)


@MODELS.entry(1, 2 * integral(lambda x, _: 3 - 8 + np.sqrt(64 - x**2), (-1, 1), (0, 1)))
def block_with_cylindrical_bottom(occ):
    roll = occ.addCylinder(0, -5, 8, 0, 10, 0, 8)
    occ.intersect([(3, occ.addBox(-1, -1, -1, 2, 2, 4))], [(3, roll)])


@MODELS.entry(1, integral(lambda x, y: 3 - 8 + np.sqrt(64 - x**2 - y**2), (-1, 1), (-1, 1)))
def block_with_spherical_bottom(occ):
    ball = occ.addSphere(0, 0, 8, 8)
    occ.rotate([(3, ball)], 0, 0, 8, 1, 0, 0, pi / 2)
    occ.intersect([(3, occ.addBox(-1, -1, -1, 2, 2, 4))], [(3, ball)])


@MODELS.entry(1, 2.5 * pi)
def elliptic_annulus_sector(occ):
    centre = occ.addPoint(0, 0, 0)
    ends = [occ.addPoint(*at) for at in ((2, 0, 0), (4, 0, 0), (0, 3, 0), (0, 1, 0))]
    sides = [
        occ.addLine(ends[0], ends[1]),
        occ.addEllipseArc(ends[1], centre, ends[1], ends[2]),
        occ.addLine(ends[2], ends[3]),
        occ.addEllipseArc(ends[3], centre, ends[0], ends[0]),
    ]
    lifted(occ, [surface_within(occ, sides, plane=True)], 1)


@MODELS.entry(1, sector_integral(cut_height, (1, 2), (0, 90)))
def pipe_quarter_cut_obliquely(occ):
    cut_above(occ, pipe_quarter(occ, 8))


@MODELS.entry(1, sector_integral(lambda x, y: np.sqrt(64 - x**2 - y**2), (1, 2), (0, 90)))
def pipe_quarter_with_spherical_end(occ):
    ball = occ.addSphere(0, 0, 0, 8)
    occ.rotate([(3, ball)], 0, 0, 0, 1, 0, 0, 2.2)
    occ.intersect([(3, pipe_quarter(occ, 9))], [(3, ball)])


def plate_with_a_hole(occ, count):
    """A square with sides of 4 and a round hole of radius 1, in 4 or 8 blocks."""
    plates = []
    for k in range(count):
        start, end = (45 + k * 360 / count, 45 + (k + 1) * 360 / count)
        inner = [on_circle(1, at) for at in (start, end)]
        outer = [2 * np.array(at) / np.abs(at).max() for at in inner]
        plates.append(plate(occ, [inner[0], outer[0], outer[1], inner[1]], {3: ORIGIN}))
    lifted(occ, fused(occ, 2, plates), 0.5)


for number in (4, 8):
    MODELS.enter(
        f"plate_with_a_hole_in_{number}",
        lambda occ, number=number: plate_with_a_hole(occ, number),
        number,
        0.5 * (16 - pi),
        glued=number,
    )


# Spheres


def cube_quads(half):
    """The six faces of the cube about the origin, as corners (4, 3) in a row around each."""
    for axis in range(3):
        for side in (-1, 1):
            yield half * np.insert(SQUARE, axis, side, axis=1)


@MODELS.entry(7, 4 * pi / 3, glued=18)
def ball_in_seven(occ):
    core = occ.addBox(-0.4, -0.4, -0.4, 0.8, 0.8, 0.8)
    fused(occ, 3, [core, *(cap_block(occ, quad, 1.0) for quad in cube_quads(0.4))])


@MODELS.entry(4, pi / 6, glued=6)
def ball_octant_in_four(occ):
    core = occ.addBox(0, 0, 0, 0.4, 0.4, 0.4)
    quads = [np.maximum(quad, 0) for quad in cube_quads(0.4) if quad.mean() > 0]
    fused(occ, 3, [core, *(cap_block(occ, quad, 1.0) for quad in quads)])


@MODELS.entry(11, 2 * pi / 3 + 1.5 * pi, glued=26)
def hemispherical_punch(occ):
    core = occ.addBox(-0.4, -0.4, -0.4, 0.8, 0.8, 0.4)
    quads = [np.minimum(quad, [1, 1, 0]) for quad in cube_quads(0.4) if quad[:, 2].min() < 0]
    shank = lifted(occ, ogrid_plates(occ, half=0.4), 1.5)
    fused(occ, 3, [core, *(cap_block(occ, quad, 1.0) for quad in quads), *shank])


# By file

MODELS.update(FREE_FORMS)
for shape, suffix in (
    ("turned_box", ".step"),
    ("two_boxes_that_touch", ".step"),
    ("two_boxes_that_touch", ".brep"),
    ("eight_boxes", ".step"),
    ("eight_boxes", ".xao"),
    ("fan_of_5", ".step"),
    ("twisted_loft", ".step"),
    ("pipe_in_four", ".xao"),
    ("pipe_quarter_cut_obliquely", ".brep"),
    ("elliptic_annulus_sector", ".step"),
    ("cylinder_in_five", ".step"),
    ("cylinder_in_five", ".brep"),
    ("cone_in_five", ".step"),
    ("ball_in_seven", ".step"),
    ("ball_in_seven", ".brep"),
    ("hemispherical_punch", ".step"),
    ("six_curved_faces", ".step"),
    ("extruded_rational_surface_with_uneven_corners", ".step"),
    ("revolved_spline_profile", ".step"),
    ("stretched_pipe_quarter", ".brep"),
):
    MODELS.by_file(shape, suffix)

SCRIPT = """SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 1, 1, 1};
Box(2) = {1, 0, 0, 1, 1, 2};
Rotate {{0, 0, 1}, {0, 0, 0}, Pi / 6} { Volume{1, 2}; }
Physical Volume("left") = {1};
Physical Volume("right") = {2};
"""
MODELS.enter("script", lambda occ: None, 2, 3.0, bodies=2, suffix=".geo", write=lambda path: path.write_text(SCRIPT))
