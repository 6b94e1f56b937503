from contextlib import suppress
from itertools import product

import gmsh
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from geom2iga.cad.brep import combined, read_brep
from geom2iga.cad.exact import curve_spline, surface_spline
from geom2iga.errors import GeometryError
from geom2iga.spline import points_of
from tests.strategies import SEEDS

ORIGIN, NORMAL = np.array([1.0, 2, 3]), np.array([0.0, 0, 1])
X, Y = np.array([0.6, 0.8, 0]), np.array([-0.8, 0.6, 0])
FRAME = "1 2 3 0 0 1 0.6 0.8 0 -0.8 0.6 0"  # origin, normal or axis, x, y
VERTEX = "Ve\n1e-07\n1 2 3\n0 0\n\n0101101\n*\n"
ENDS = "0 0 0 0 "  # of an edge in a parameter plane, as version 2 writes them


def listed(name, records):
    return f"{name} {len(records)}\n" + "".join(f"{record}\n" for record in records)


def text_of(shapes=(VERTEX,), root="+1 0", version=3, locations=(), plane_curves=(), curves=(), surfaces=()):
    """The text of a boundary representation; the first shape has the highest number."""
    sections = (("Locations", locations), ("Curve2ds", plane_curves), ("Curves", curves), ("Polygon3D", ()))
    sections += (("PolygonOnTriangulations", ()), ("Surfaces", surfaces), ("Triangulations", ()))
    lists = "".join(listed(*section) for section in sections)
    return (
        f"\nCASCADE Topology V{version}, (c) Open Cascade\n{lists}\nTShapes {len(shapes)}\n{''.join(shapes)}\n{root} 0"
    )


def edge_of(*traces):
    """An edge without vertices."""
    return f"Ed\n 1e-07 1 1 0\n{''.join(trace + chr(10) for trace in traces)}0\n\n0101000\n*\n"


def curve_of(record):
    """The record of a curve, as an edge holds it."""
    (trace,) = read_brep(text_of((edge_of("1 1 0 0.25 2"),), curves=(record,))).shapes[1].traces
    assert (trace.surface, trace.location, trace.range) == (0, (), (0.25, 2.0))
    return trace.curve


def surface_of(record):
    return read_brep(text_of(surfaces=(record,))).surfaces[1]


# Curves and surfaces


def bezier(*points):
    """A cubic, at parameters t."""
    p = np.array(points, dtype=float)
    return lambda t: ((1 - t) ** 3) * p[0] + 3 * t * (1 - t) ** 2 * p[1] + 3 * t**2 * (1 - t) * p[2] + t**3 * p[3]


CURVES = {
    "line": ("1 1 2 3 0.6 0.8 0", lambda t: ORIGIN + t * X),
    "circle": (f"2 {FRAME} 2.5", lambda t: ORIGIN + 2.5 * (np.cos(t) * X + np.sin(t) * Y)),
    "ellipse": (f"3 {FRAME} 2.5 0.5", lambda t: ORIGIN + 2.5 * np.cos(t) * X + 0.5 * np.sin(t) * Y),
    "parabola": (f"4 {FRAME} 0.5", lambda t: ORIGIN + t**2 / 2 * X + t * Y),
    "hyperbola": (f"5 {FRAME} 2.5 0.5", lambda t: ORIGIN + 2.5 * np.cosh(t) * X + 0.5 * np.sinh(t) * Y),
    "Bezier": ("6 0 3  0 0 0  1 2 0  3 1 1  4 0 2", bezier((0, 0, 0), (1, 2, 0), (3, 1, 1), (4, 0, 2))),
    "trimmed": (f"8 0 3\n2 {FRAME} 2.5", lambda t: ORIGIN + 2.5 * (np.cos(t) * X + np.sin(t) * Y)),
}


@pytest.mark.parametrize("kind", CURVES)
def test_a_curve_follows_its_formula(kind):
    record, formula = CURVES[kind]
    curve = curve_of(record)
    low, high = (0.1, 0.9) if kind == "Bezier" else (0.25, 2.0)
    assert curve.kind == kind
    points = points_of(curve_spline(curve, low, high).at(np.array([0, 0.5, 1])))
    expected = [formula(t) for t in (low, (low + high) / 2, high)]
    np.testing.assert_allclose(points, expected, rtol=0, atol=1e-14 * 10)


def test_a_b_spline_curve_has_its_knots_and_control_points():
    curve = curve_of("7 0 0 2 4 3  0 0 0  1 1 0  2 4 0  3 9 0  0 3 1 1 2 3")
    assert (curve.kind, curve.degrees, curve.periodic) == ("B-spline", (2,), (False,))
    assert curve.knots[0].tolist() == [0, 0, 0, 1, 2, 2, 2]
    at = np.linspace(0, 2, 9)
    expected = BSpline([0, 0, 0, 1, 2, 2, 2], [[0, 0, 0], [1, 1, 0], [2, 4, 0], [3, 9, 0]], 2)(at)
    np.testing.assert_allclose(points_of(curve_spline(curve, 0, 2).at(at / 2)), expected, rtol=0, atol=1e-14)


def test_weights_of_a_curve_stand_behind_its_points():
    curve = curve_of("6 1 2  1 0 0 1  1 1 0 0.5  0 1 0 2")
    np.testing.assert_allclose(curve.coefficients, [[1, 0, 0, 1], [0.5, 0.5, 0, 0.5], [0, 2, 0, 2]])


def test_an_offset_curve_is_read_and_refused():
    curve = curve_of(f"9 0.5\n0 0 1\n2 {FRAME} 2.5")
    assert curve.kind == "offset"
    with pytest.raises(GeometryError, match=r"an offset curve is no NURBS.*replace it"):
        curve_spline(curve, 0, 1)


PLANE_CURVES = {
    "line": "1 1 2 0.6 0.8",
    "circle": "2 1 2 1 0 0 1 2.5",
    "ellipse": "3 1 2 1 0 0 1 2.5 0.5",
    "parabola": "4 1 2 1 0 0 1 0.5",
    "hyperbola": "5 1 2 1 0 0 1 2.5 0.5",
    "Bezier": "6 0 1  0 0  1 1",
    "B-spline": "7 1 0 1 2 2  0 0 1  1 1 2  0 2 1 2",
    "trimmed": "8 0 1\n1 1 2 0.6 0.8",
    "offset": "9 0.5\n1 1 2 0.6 0.8",
}


@pytest.mark.parametrize("version", [1, 2, 3])
@pytest.mark.parametrize("kind", PLANE_CURVES)
def test_a_curve_in_a_parameter_plane_takes_no_more_words_than_it_has(kind, version):
    """The line after it is read right."""
    plane_curves = (PLANE_CURVES[kind], "1 7 8 0 1")
    ends = ENDS if version == 2 else ""
    edge = edge_of(f"2 1 1 0 0 1 {ends}", f"2 2 1 0 3 4 {ends}")
    brep = read_brep(text_of((edge,), version=version, plane_curves=plane_curves, surfaces=(f"1 {FRAME}",)))
    first, second = brep.shapes[1].traces
    assert first.curve.kind == kind
    np.testing.assert_array_equal(second.curve.vectors, [[7, 8], [0, 1]])
    assert (first.range, second.range, second.surface) == ((0, 1), (3, 4), 1)


def revolved(radius, height, angle):
    return ORIGIN + radius * (np.cos(angle) * X + np.sin(angle) * Y) + height * NORMAL


SURFACES = {
    "plane": (f"1 {FRAME}", lambda u, v: ORIGIN + u * X + v * Y),
    "cylinder": (f"2 {FRAME} 2.5", lambda u, v: revolved(2.5, v, u)),
    "cone": (f"3 {FRAME} 2.5\n0.3", lambda u, v: revolved(2.5 + v * np.sin(0.3), v * np.cos(0.3), u)),
    "sphere": (f"4 {FRAME} 2.5", lambda u, v: revolved(2.5 * np.cos(v), 2.5 * np.sin(v), u)),
    "torus": (f"5 {FRAME} 2.5 0.5", lambda u, v: revolved(2.5 + 0.5 * np.cos(v), 0.5 * np.sin(v), u)),
    "extrusion": (
        f"6 0 0.6 0.8\n2 {FRAME} 2.5",
        lambda u, v: revolved(2.5, 0, u) + v * np.array([0, 0.6, 0.8]),
    ),
    "revolution": (
        "7 1 2 3 0 0 1\n1 2 2 3 0.6 0 0.8",
        lambda u, v: ORIGIN + (1 + 0.6 * v) * np.array([np.cos(u), np.sin(u), 0]) + 0.8 * v * NORMAL,
    ),
    "Bezier": (
        "8 0 0 2 1  0 0 0  0 2 0  1 0 1  1 2 2  2 0 0  2 2 0",
        lambda u, v: np.array([2 * u, 2 * v, 2 * u * (1 - u) * (1 + v)]),
    ),
    "trimmed": (f"10 0 1 0 1\n2 {FRAME} 2.5", lambda u, v: revolved(2.5, v, u)),
}


@pytest.mark.parametrize("kind", SURFACES)
def test_a_surface_follows_its_formula(kind):
    record, formula = SURFACES[kind]
    surface = surface_of(record)
    assert surface.kind == kind
    at = np.array([[0.2, 0.5, 0.8], [0.1, 0.5, 0.9]])
    spline = surface_spline(surface, at[:, [0, 2]])
    points = points_of(spline.at(*[np.array([0, 0.5, 1])] * 2))
    expected = [[formula(u, v) for v in at[1]] for u in at[0]]
    np.testing.assert_allclose(points, expected, rtol=0, atol=1e-14 * 10)


def test_a_b_spline_surface_has_its_knots_and_homogeneous_control_points_along_u_first():
    points = "  ".join(f"{i} {j} 0 {1 + i + 10 * j}" for i, j in product(range(3), range(2)))
    surface = surface_of(f"9 1 0 0 0 2 1 3 2 2 2  {points}  0 3 1 3  0 2 5 2")
    assert (surface.degrees, surface.periodic) == ((2, 1), (False, False))
    assert [knots.tolist() for knots in surface.knots] == [[0, 0, 0, 1, 1, 1], [0, 0, 5, 5]]
    for i, j in product(range(3), range(2)):
        weight = 1 + i + 10 * j
        np.testing.assert_array_equal(surface.coefficients[i, j], [weight * i, weight * j, 0, weight])


def test_an_offset_surface_is_read_and_refused():
    surface = surface_of(f"11 0.5\n2 {FRAME} 2.5")
    assert surface.kind == "offset"
    with pytest.raises(GeometryError, match=r"an offset surface is no NURBS.*replace it"):
        surface_spline(surface, np.array([[0, 1], [0, 1]]))


# Locations


@st.composite
def motions(draw):
    """Rigid motions (3, 4)."""
    seed = draw(SEEDS)
    shift = np.random.default_rng(seed).uniform(-5, 5, (3, 1))
    return np.hstack([Rotation.random(random_state=seed).as_matrix(), shift])


def full(matrix):
    return np.vstack([matrix, [0, 0, 0, 1]])


@given(motions(), motions(), st.lists(st.tuples(st.integers(1, 2), st.integers(-3, 3)), min_size=1, max_size=4))
def test_a_location_is_the_product_of_powers_of_others(first, second, parts):
    elementary = [" 1\n" + " ".join(f"{x:.17g}" for x in matrix.ravel()) for matrix in (first, second)]
    parts = [(number, power) for number, power in parts if power]
    chain = " ".join(f"{number} {power}" for number, power in parts)
    nested = ["2 " + chain + " 0", "2 3 2 1 1 0", "2 4 -1 0"]
    brep = read_brep(text_of(locations=(*elementary, *nested)))
    powers = [np.linalg.matrix_power(full((first, second)[number - 1]), power) for number, power in parts]
    expected = np.linalg.multi_dot([np.eye(4), np.eye(4), *reversed(powers)])  # what stands first is applied first
    twice = full(first) @ expected @ expected
    for number, matrix in ((3, expected), (4, twice), (5, np.linalg.inv(twice))):
        found = brep.matrix(brep.locations[number])
        np.testing.assert_allclose(found, matrix[:3], rtol=0, atol=1e-11 * np.abs(matrix).max())


def test_powers_of_one_location_add_up_and_vanish():
    assert combined(((1, 2),), ((1, 3), (2, 1))) == ((1, 5), (2, 1))
    assert combined(((2, 1), (1, 2)), ((1, -2), (2, -1))) == ()


# Whole files


def gmsh_text(path):
    """A box and a quarter of a pipe, as OpenCASCADE writes them."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addBox(0, 0, 0, 1, 2, 3)
    gmsh.model.occ.addCylinder(5, 0, 0, 0, 0, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.write(str(path))
    gmsh.finalize()
    return path.read_text()


def test_a_box_has_its_shapes_and_its_size(tmp_path):
    brep = read_brep(gmsh_text(tmp_path / "box.brep"))
    kinds = [shape.kind for shape in brep.shapes.values()]
    counts = {kind: kinds.count(kind) for kind in ("solid", "shell", "face", "wire", "edge", "vertex")}
    assert counts == {"solid": 2, "shell": 2, "face": 9, "wire": 9, "edge": 15, "vertex": 10}
    corners = np.array([shape.point for shape in brep.shapes.values() if shape.kind == "vertex"])
    assert corners[:, 1].max() == 2


@pytest.mark.parametrize("smoothness", ["1CN", "1 CN", "1C0", "1G1", "1 C2"])
def test_words_that_opencascade_glues_together_are_told_apart(smoothness):
    """How smoothly two surfaces meet along an edge: their numbers and locations."""
    edge = edge_of(f"4 {smoothness} 0 1 0", "1 1 0 5 6")
    (trace,) = read_brep(text_of((edge,), curves=("1 0 0 0 1 0 0",), surfaces=(f"1 {FRAME}",))).shapes[1].traces
    assert trace.range == (5, 6)


@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_seam_has_two_curves_of_which_the_first_is_read(version):
    seam = f"3 1 2CN 1 0 5 6 {(ENDS * 2) if version == 2 else ''}"
    edge = edge_of(seam, "1 1 0 7 8")
    text = text_of(
        (edge,),
        version=version,
        plane_curves=("1 0 0 0 1", "1 6 0 0 1"),
        curves=("1 0 0 0 1 0 0",),
        surfaces=(f"2 {FRAME} 1",),
    )
    first, second = read_brep(text).shapes[1].traces
    assert (first.surface, first.range, first.curve.vectors.tolist()) == (1, (5, 6), [[0, 0], [0, 1]])
    assert (second.surface, second.range) == (0, (7, 8))


def test_places_of_a_vertex_on_curves_and_surfaces_are_passed_over():
    vertex = "Ve\n1e-07\n1 2 3\n0.5 1 1 0\n0.5 2 1 1 0\n0.5 3 0.25 1 0\n0 0\n\n0101101\n*\n"
    assert read_brep(text_of((vertex,))).shapes[1].point == (1, 2, 3)


def test_a_text_without_its_first_line_is_told_so():
    for text in ("", "hello\n", "DBRep_DrawableShape\n"):
        with pytest.raises(GeometryError, match="first line is missing"):
            read_brep(text)


def test_a_text_cut_off_after_any_line_is_refused_and_nothing_else_happens(tmp_path):
    lines = gmsh_text(tmp_path / "box.brep").rstrip().splitlines(keepends=True)
    for count in range(len(lines)):
        with pytest.raises(GeometryError, match=r"first line is missing|cut off or damaged"):
            read_brep("".join(lines[:count]))


@given(SEEDS)
def test_a_damaged_text_is_read_or_refused_and_nothing_else_happens(tmp_path_factory, seed):
    folder = tmp_path_factory.getbasetemp()
    path = folder / "damaged.brep"
    text = path.read_text() if path.exists() else gmsh_text(path)
    random = np.random.default_rng(seed)
    words = text.split(" ")
    for _ in range(3):
        words[random.integers(20, len(words))] = str(random.choice(["", "0", "-1", "7", "1e9", "x", "99999999999"]))
    with suppress(GeometryError):
        read_brep(" ".join(words))


@pytest.mark.parametrize("multiplicity", [3, 10**15])
def test_knots_that_do_not_fit_the_control_points_are_refused(multiplicity):
    with pytest.raises(GeometryError, match="damaged"):
        curve_of(f"7 0 0 1 2 2  0 0 0  1 1 1  0 {multiplicity}  1 2")
