"""CAD models that cannot become blocks, and what the message must say: the entity, its number, the remedy.

A message may name the volume or one of its faces where both are at fault; the patterns leave the choice.
"""

from dataclasses import replace
from math import pi
from pathlib import Path

import gmsh
import numpy as np

from tests.geom2iga.cad.models import MODELS
from tests.geom2iga.cad.registry import Registry, written
from tests.geom2iga.cad.shapes import SQUARE, level, lifted, on_circle, plate, polyhedron, rectangle, turned_about_z

UNCONVERTIBLE = Registry()


def faces(count: int) -> str:
    """A volume has too many or too few faces."""
    return rf"volume \d+ has {count} faces?, a block has 6.*(split|mesh)"


def edges(count: int) -> str:
    """A face has too many or too few edges."""
    return rf"face \d+ has {count} edges?, a block face has 4.*(merge|split)"


SEAM = r"face \d+ meets itself along a seam.*(rotate|turn|split|remove)"
POLE = r"face \d+ .*pole.*(rotate|turn|split)"
HOLE = r"face \d+ has 2 loops \(a hole\)"
FOLDED = r"(?i:folded|Jacobian|positiv)"
NO_SOLID = r"(?i:no|0) (?:solid|volume)s?"
UNREADABLE = r"(?i:cannot (?:be )?read|holds no|is empty|is no|is not a|broken|incomplete|does not end)"


def either(*patterns: str) -> str:
    """Any of several patterns."""
    return "|".join(f"(?:{pattern})" for pattern in patterns)


def enter(message, suffix=""):
    """Enter a function under its own name, with the pattern of its message."""

    def decorate(make):
        UNCONVERTIBLE.enter(make.__name__, make, 0, None, message=message, suffix=suffix)
        return make

    return decorate


# Seams and poles


@enter(either(SEAM, faces(3)))
def whole_cylinder(occ):
    occ.addCylinder(0, 0, 0, 0, 0, 2, 1)


@enter(either(SEAM, faces(3)), suffix=".step")
def whole_cylinder_by_step(occ):
    occ.addCylinder(0, 0, 0, 0, 0, 2, 1)


@enter(either(SEAM, POLE, faces(1)))
def whole_sphere(occ):
    occ.addSphere(0, 0, 0, 1)


@enter(either(SEAM, POLE, faces(2)))
def cone_with_apex(occ):
    occ.addCone(0, 0, 0, 0, 0, 2, 1, 0)


@enter(either(SEAM, faces(1)))
def torus(occ):
    occ.addTorus(0, 0, 0, 3, 1)


@enter(either(SEAM, HOLE, faces(4)))
def whole_pipe(occ):
    occ.cut([(3, occ.addCylinder(0, 0, 0, 0, 0, 2, 2))], [(3, occ.addCylinder(0, 0, 0, 0, 0, 2, 1))])


@enter(either(SEAM, faces(2)))
def hemisphere(occ):
    occ.addSphere(0, 0, 0, 1, angle1=0)


@enter(r"face \d+ is a triangle with a pole.*split.*octant.*4 blocks")
def octant_of_a_sphere(occ):
    occ.addSphere(0, 0, 0, 1, angle1=0, angle3=pi / 2)


@enter(either(SEAM, POLE))
def block_whose_spherical_bottom_holds_the_pole(occ):
    occ.intersect([(3, occ.addBox(-1, -1, -1, 2, 2, 4))], [(3, occ.addSphere(0, 0, 8, 8))])


@enter(faces(7) + r".*faces \d+ and \d+ lie on one cylinder.*seam")
def block_whose_cylindrical_bottom_holds_the_seam(occ):
    roll = occ.addCylinder(0, -5, 8, 0, 10, 0, 8)
    occ.rotate([(3, roll)], 0, 0, 8, 0, 1, 0, pi)
    occ.intersect([(3, occ.addBox(-1, -1, -1, 2, 2, 4))], [(3, roll)])


@enter(either(faces(5), edges(3)))
def quarter_of_a_cylinder(occ):
    turned_about_z(occ, rectangle(occ, (0, 1), (0, 2)), 90)


@enter(faces(4))
def half_a_cylinder(occ):
    corners = [(1, 0, 0), (-1, 0, 0)]
    lifted(occ, [plate(occ, corners, {0: (0, 0, 0)})], 2)


@enter(either(SEAM, POLE, faces(2)))
def lens_of_two_spheres(occ):
    occ.intersect([(3, occ.addSphere(0, 0, 0, 1))], [(3, occ.addSphere(0, 0, 1, 1))])


# Too many faces, loops, shells or edges


@enter(either(HOLE, SEAM, faces(7)))
def box_with_a_hole(occ):
    occ.cut([(3, occ.addBox(-1, -1, 0, 2, 2, 1))], [(3, occ.addCylinder(0, 0, 0, 0, 0, 1, 0.5))])


@enter(either(HOLE, SEAM, edges(3)))
def triangular_prism_with_a_hole(occ):
    prism = lifted(occ, [plate(occ, [on_circle(3, at) for at in (90, 210, 330)])], 1)
    occ.cut([(3, prism[0])], [(3, occ.addCylinder(0, 0, 0, 0, 0, 1, 0.5))])


@enter(either(HOLE, faces(11)))
def box_with_a_pocket(occ):
    occ.cut([(3, occ.addBox(-1, -1, 0, 2, 2, 2))], [(3, occ.addBox(-0.5, -0.5, 1, 1, 1, 1))])


@enter(r"volume \d+ has 2 shells \(an inner cavity\)")
def box_with_a_cavity(occ):
    occ.cut([(3, occ.addBox(-1, -1, -1, 2, 2, 2))], [(3, occ.addBox(-0.5, -0.5, -0.5, 1, 1, 1))])


@enter(faces(7))
def box_with_a_fillet(occ):
    occ.fillet([occ.addBox(0, 0, 0, 1, 1, 1)], [1], [0.2])


@enter(faces(7))
def box_with_a_chamfer(occ):
    corner = lifted(occ, [plate(occ, [(2, 1.5, 0), (2, 2, 0), (1.5, 2, 0)])], 2)
    occ.cut([(3, occ.addBox(0, 0, 0, 2, 2, 2))], [(3, corner[0])])


@enter(faces(7))
def box_without_a_corner(occ):
    corner = polyhedron(occ, [(1, 1, 1), (0, 1, 1), (1, 0, 1), (1, 1, 0)], TETRAHEDRON)
    occ.cut([(3, occ.addBox(0, 0, 0, 1, 1, 1))], [(3, corner)])


@enter(edges(5))
def box_with_an_edge_in_two(occ):
    occ.fragment([(3, occ.addBox(0, 0, 0, 2, 1, 1))], [(0, occ.addPoint(0.7, 0, 0))])


@enter(faces(7))
def box_with_a_face_in_two(occ):
    halves = rectangle(occ, (0, 1), (0, 2))
    occ.fragment([(3, occ.addBox(0, 0, 0, 2, 1, 2))], [(2, halves)])


@enter(faces(10))
def t_of_two_boxes_as_one_volume(occ):
    occ.fuse([(3, occ.addBox(0, 0, 0, 3, 1, 1))], [(3, occ.addBox(1, 1, 0, 1, 2, 1))])


@enter(either(faces(8), edges(5), edges(6)))
def t_of_two_boxes_that_share_a_face(occ):
    occ.fragment([(3, occ.addBox(0, 0, 0, 3, 1, 1))], [(3, occ.addBox(1, 1, 0, 1, 2, 1))])


@enter(either(r"volume 2 has 5 faces", r"volume 2.*face \d+ has 3 edges"))
def box_beside_a_prism(occ):
    occ.addBox(5, 0, 0, 1, 1, 1)
    triangular_prism(occ)


# Polyhedra that are no hexahedra

TETRAHEDRON = ((0, 1, 2), (0, 1, 3), (1, 2, 3), (2, 0, 3))


@enter(faces(4))
def tetrahedron(occ):
    polyhedron(occ, [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], TETRAHEDRON)


@enter(faces(5))
def pyramid(occ):
    sides = [(0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]
    polyhedron(occ, [*level(SQUARE, 0), (0, 0, 1)], sides)


@enter(edges(3))
def two_tetrahedra_as_one_volume(occ):
    corners = [on_circle(1, 0), on_circle(1, 120), on_circle(1, 240), (0, 0, 1), (0, 0, -1)]
    polyhedron(occ, corners, [(k, (k + 1) % 3, tip) for k in range(3) for tip in (3, 4)])


@enter(either(edges(3), edges(5)))
def pyramid_on_a_pentagon(occ):
    corners = [*(on_circle(1, 72 * k) for k in range(5)), (0, 0, 1)]
    polyhedron(occ, corners, [range(5), *((k, (k + 1) % 5, 5) for k in range(5))])


@enter(faces(5))
def triangular_prism(occ):
    lifted(occ, [plate(occ, [(0, 0, 0), (1, 0, 0), (0, 1, 0)])], 1)


@enter(faces(8))
def hexagonal_prism(occ):
    lifted(occ, [plate(occ, [on_circle(1, 60 * k) for k in range(6)])], 1)


@enter(faces(8), suffix=".brep")
def l_shaped_prism(occ):
    lifted(occ, [plate(occ, [(0, 0, 0), (2, 0, 0), (2, 1, 0), (1, 1, 0), (1, 2, 0), (0, 2, 0)])], 1)


# Hexahedra that fold


@enter(FOLDED)
def hexahedron_with_a_corner_pushed_in(occ):
    corners = np.array([*level(SQUARE, 0), *level(SQUARE, 2)])
    corners[6] = (-0.6, -0.6, 1.0)
    polyhedron(occ, corners)


@enter(FOLDED)
def bow_tie(occ):
    lifted(occ, [plate(occ, [(0, 0, 0), (2, 2, 0), (2, 0, 0), (0, 2, 0)])], 1)


@enter(FOLDED)
def arrow_head(occ):
    lifted(occ, [plate(occ, [(0, 0, 0), (3, 0, 0), (0.5, 0.5, 0), (0, 3, 0)])], 1)


# Files


@enter(NO_SOLID)
def surface_alone(occ):
    plate(occ, level(SQUARE, 0))


@enter(NO_SOLID, suffix=".step")
def surface_alone_by_step(occ):
    plate(occ, level(SQUARE, 0))


def enter_text(name, suffix, message, text):
    """Enter a file by its text."""
    UNCONVERTIBLE.enter(
        name, lambda occ: None, 0, None, message=message, suffix=suffix, write=lambda p: p.write_text(text)
    )


def enter_truncated(name, suffix, kept, end=None):
    """Enter the beginning of a good file, then its rest from `end` on.

    On most beginnings of B-rep text OpenCASCADE loops for ever or crashes.
    """

    def write(path: Path) -> None:
        good = replace(MODELS["cylinder_in_five"], name="whole", suffix=suffix)
        whole = written(good, path.parent).read_bytes()
        rest = whole[whole.index(end) :] if end else b""
        path.write_bytes(whole[: int(kept * len(whole))] + rest)

    UNCONVERTIBLE.enter(name, lambda occ: None, 0, None, message=UNREADABLE, suffix=suffix, write=write)


GARBAGE = "".join(chr(33 + (7 * k * k + k) % 90) for k in range(2000))
for ending in (".step", ".brep", ".xao", ".iges", ".geo"):
    enter_text(f"garbage_{ending[1:]}", ending, UNREADABLE, GARBAGE)
    enter_text(f"empty_{ending[1:]}", ending, either(UNREADABLE, NO_SOLID), "")
for ending in (".step", ".brep", ".xao"):
    enter_truncated(f"truncated_{ending[1:]}", ending, 2 / 3)
enter_truncated("brep_without_its_end", ".brep", 0.9)
enter_truncated("xao_with_half_a_shape", ".xao", 1 / 2, b"]]>")


def write_with_gmsh(path: Path) -> None:
    """Write a box in a format that holds no solids."""
    gmsh.model.add("box")
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    if path.suffix == ".stl":
        gmsh.model.mesh.generate(2)
    gmsh.write(str(path))
    gmsh.model.remove()


UNCONVERTIBLE.enter(
    "box_by_iges", lambda occ: None, 0, None, message="IGES.*" + NO_SOLID, suffix=".iges", write=write_with_gmsh
)
UNCONVERTIBLE.enter("box_by_stl", lambda occ: None, 0, None, message=r"(?i:stl)", suffix=".stl", write=write_with_gmsh)

enter_text(
    "built_in_kernel",
    ".geo",
    r"(?i:built-in).*(OpenCASCADE|mesh)",
    """Point(1) = {0, 0, 0}; Point(2) = {1, 0, 0}; Line(1) = {1, 2};
Extrude {0, 1, 0} { Line{1}; }
Extrude {0, 0, 1} { Surface{5}; }
""",
)
enter_text(
    "shell_command",
    ".geo",
    r"(?i:shell command|SystemCall)",
    'SystemCall "touch ran";\nSetFactory("OpenCASCADE");\nBox(1) = {0, 0, 0, 1, 1, 1};\n',
)
enter_text("script_with_an_error", ".geo", UNREADABLE, 'SetFactory("OpenCASCADE");\nBox(1) = {0, 0, 0, 1, 1};\n')
enter_text("script_without_a_volume", ".geo", NO_SOLID, 'SetFactory("OpenCASCADE");\nRectangle(1) = {0, 0, 0, 1, 1};\n')
