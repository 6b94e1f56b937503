"""Segment cells on curved faces: areas, coupling integrals, balance of forces."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import geom2iga
from geom2iga.bspline import open_knots
from geom2iga.errors import CaseError
from geom2iga.patch import Patch, elevated, evaluate, refined
from solve.case import Contact, Load
from solve.contact.cells import find_cells
from solve.contact.outlines import find_outlines
from solve.face import area_vectors, trace_matrix
from solve.loads import assemble_loads, face_load
from solve.space import gauss_points, number_control_points
from tests.cases import block_patch, hollow_cylinder, model_of, moved, turned
from tests.solve.contact.curved_faces import (
    averages,
    products,
    rings,
    segments,
    shell,
    shells,
    sides,
    waves,
    whole_spheres,
)

SKEW = Rotation.from_rotvec([0.1, 0.2, 0.5])
SWAPPED = pytest.mark.parametrize("swap", [False, True], ids=["inner secondary", "outer secondary"])


def either(model, names, swap):
    return sides(model, *(names[::-1] if swap else names))


@SWAPPED
@pytest.mark.parametrize("gap", [0.0, 0.1, -0.05])
def test_concentric_cylinders_are_covered_once_on_either_side(gap, swap):
    cells = segments(*either(rings((2, 3), (3, 2), gap), ("inner/right", "outer/left"), swap))
    radii = (2 + gap, 2) if swap else (2, 2 + gap)
    for found, radius in zip((cells.area, cells.primary_area), radii, strict=True):
        assert found.sum() == pytest.approx(1.5 * np.pi * radius, rel=1e-13)
    np.testing.assert_allclose(cells.gap, gap, rtol=0, atol=1e-14)
    assert cells.area.min() > 0


def test_a_span_many_times_as_long_as_it_is_wide_is_cut_across_its_length_alone():
    long = refined(elevated(hollow_cylinder(2.0, 3.0, 1e5, name="outer"), (2, 2, 1)), spans=2)
    short = refined(elevated(hollow_cylinder(1.0, 2.0, 2.0, name="inner"), (2, 2, 1)), spans=2)
    secondary, primary = sides(model_of(short, long), "inner/right", "outer/left")
    assert len(find_outlines(secondary, primary).corners) < 200
    cells = segments(secondary, primary)
    assert cells.area.sum() == pytest.approx(2 * np.pi, rel=1e-12)


@pytest.mark.parametrize("height", [1e-12, 1e-30])
def test_spans_that_are_all_but_lines_are_refused_where_they_would_be_cut_without_end(height):
    bodies = (hollow_cylinder(1.0, 2.0, height, name="inner"), hollow_cylinder(2.0, 3.0, 1.0, name="outer"))
    faces = sides(model_of(*(elevated(body, (2, 2, 1)) for body in bodies)), "inner/right", "outer/left")
    with pytest.raises(CaseError, match="more than 100000 times as long as wide"):
        segments(*faces)


def balance_error(model, groups, swap=False):
    """Largest difference of contact forces under a unit pressure from those of the pressure itself, on either side."""
    space = number_control_points(model)
    names = groups[::-1] if swap else groups
    cells = find_cells(model, Contact(secondary=names[0], primary=names[1]))
    errors = []
    for side, sign in (("secondary", 1), ("primary", -1)):
        forces, expected = np.zeros((2, space.size, 3))
        for part in cells:
            face, xi, spans = (getattr(part, name) for name in (side, f"{side}_xi", f"{side}_spans"))
            forces += sign * trace_matrix(space, face, xi, spans).T @ (part.area[:, None] * part.normal)
        for face in model.faces(names[0] if side == "secondary" else names[1]):
            np.add.at(expected, space.face_numbers(face), face_load(space, face, Load(on=names[0], pressure=1.0)))
        errors.append(np.abs(forces - expected).max() / np.abs(expected).max())
    return max(errors)


@SWAPPED
@pytest.mark.parametrize(("degrees", "spans"), [((2, 2), (2, 3)), ((3, 2), (4, 3)), ((2, 3), (1, 2)), ((3, 3), (3, 3))])
def test_pressure_on_fitting_cylinders_is_in_balance_on_every_control_point(degrees, spans, swap):
    assert balance_error(rings(degrees, spans), ("inner/right", "outer/left"), swap) < 1e-11


@SWAPPED
def test_pressure_on_fitting_pieces_of_spheres_is_in_balance_on_every_control_point(swap):
    assert balance_error(shells((2, 3)), ("inner/top", "outer/bottom"), swap) < 1e-11


@pytest.mark.slow
@SWAPPED
def test_pressure_between_whole_spheres_whose_seams_cross_is_in_balance_on_every_control_point(swap):
    assert balance_error(whole_spheres((2, 3), 0.0, SKEW), ("inner", "outer"), swap) < 1e-10


def test_the_seams_of_a_sphere_count_once():
    model = whole_spheres((1, 1), 0.1, SKEW)
    cells = find_cells(model, Contact(secondary="one of six", primary="outer", points=10))
    assert len(cells) > 2
    assert sum(part.area.sum() for part in cells) == pytest.approx(4 / 6 * np.pi, rel=1e-12)
    assert sum(part.primary_area.sum() for part in cells) == pytest.approx(4 / 6 * np.pi * 1.1**2, rel=1e-12)
    for part in cells:
        np.testing.assert_allclose(part.gap, 0.1, rtol=0, atol=1e-13)


@pytest.mark.parametrize("widths", [(0.5, 0.5), (0.3, 0.5)])
def test_fitting_spheres_give_the_same_coupling_whichever_is_secondary(widths):
    """The two ways cut their cells in different planes along different curves."""
    one, other = sides(shells((3, 2), turn=SKEW, widths=widths), "inner/top", "outer/bottom")
    there, back = products(segments(one, other), one, other), products(segments(other, one), other, one)
    np.testing.assert_allclose(there, back.T, rtol=0, atol=2e-12 * there.max())


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("size", [1.6, 2.5])
def test_no_kink_is_left_inside_a_cell_so_that_more_points_change_nothing(degree, size):
    pair = sides(waves(degree, ((4, 4), (5, 3)), 20.0, size), "upper/bottom", "lower/top")
    usual, finer = (segments(*pair, points) for points in (None, 16))
    assert len(usual.area) < len(finer.area)
    for integrals in (lambda cells: products(cells, *pair), lambda cells: averages(cells, pair[0])):
        np.testing.assert_allclose(integrals(usual), integrals(finer), rtol=0, atol=1e-10 * integrals(finer).max())


def test_overhanging_waves_agree_with_a_brute_force_sum():
    """Many points in each secondary span; those on the lower sheet's span line up to the border only."""
    pair = sides(waves(2, ((4, 4), (5, 3)), 20.0, 1.2), "upper/bottom", "lower/top")
    dense_points = gauss_points(pair[0].patch, (60, 60))
    cells = segments(*pair)
    stretch = area_vectors(pair[0], dense_points.xi)[2]
    assert cells.area.sum() == pytest.approx(dense_points.weights @ stretch, rel=1e-11)


def test_points_lie_on_each_others_normal():
    pair = sides(waves(3, ((4, 4), (5, 3)), 20.0, 1.6), "upper/bottom", "lower/top")
    cells = segments(*pair)
    at = [
        evaluate(side.patch, xi, spans=spans)[0]
        for side, xi, spans in (
            (pair[0], cells.secondary_xi, cells.secondary_spans),
            (pair[1], cells.primary_xi, cells.primary_spans),
        )
    ]
    np.testing.assert_allclose(at[0] - at[1], cells.gap[:, None] * cells.normal, rtol=0, atol=1e-12)


@pytest.mark.parametrize("spans", [1, 5])
def test_what_lies_under_a_dome_has_the_area_of_its_shadow(spans):
    """Vertical normals: the area on the plane is that of the dome's flat image, however much larger the plane is."""
    dome = moved(turned(shell("dome", (0.5, 1.0), 2), Rotation.from_euler("x", 180, degrees=True)), (0.1, 0.05, 1.02))
    model = model_of(block_patch("plane", (-1.5, -1.5, -1), (3, 3, 1), 2, (spans, spans, 1)), dome)
    pair = sides(model, "dome/top", "plane/top")
    cells = segments(*pair)
    reference = gauss_points(pair[0].patch, (20, 20))
    _, normal, stretch = area_vectors(pair[0], reference.xi)
    area = reference.weights * stretch
    assert cells.area.sum() == pytest.approx(area.sum(), rel=1e-10)
    assert cells.primary_area.sum() == pytest.approx(-area @ normal[:, 2], rel=1e-10)


def test_cells_beyond_the_reach_are_left_out():
    dome = moved(turned(shell("dome", (0.5, 1.0), 4), Rotation.from_euler("x", 180, degrees=True)), (0, 0, 1))
    model = model_of(block_patch("plane", (-1, -1, -1), (2, 2, 1), 2, (6, 6, 1)), dome)
    for integration in ("segment", "element"):
        contact = Contact(secondary="dome/top", primary="plane/top", reach=0.03, integration=integration)
        (near,) = find_cells(model, contact)
        (whole,) = find_cells(model, contact.model_copy(update={"reach": None}))
        assert 0 < near.area.sum() < 0.5 * whole.area.sum()
        expected = whole.area[whole.gap <= 0.03].sum()
        assert near.area[near.gap <= 0.03].sum() == pytest.approx(expected, rel=1e-12)


def test_a_pressure_that_leaves_out_what_the_partner_covers_leaves_the_bare_part():
    """An outer ring as long as the inner one above half of it: at a gap, on the outer side, along a circle."""
    whole = rings((2, 2), (2, 3), 0.1)
    inner = moved(whole.patches["inner"], (0, 0, 1.7))
    model = model_of(inner, whole.patches["outer"])
    contact = Contact(secondary="inner/right", primary="outer/left")
    space = number_control_points(model)
    load = Load(on="outer/left", traction=(0.0, 0.0, 1.0), exposed=True)
    bare = assemble_loads(space, [load], [], [(contact, find_cells(model, contact))])
    assert bare.sum(axis=0)[2] == pytest.approx(2.1 * np.pi / 2 * 1.7, rel=1e-12)


def test_faces_at_right_angles_share_no_cells_and_flat_rings_do():
    flat = model_of(hollow_cylinder(name="low"), moved(hollow_cylinder(name="high"), (0, 0, 1)))
    (cells,) = find_cells(flat, Contact(secondary="high/bottom", primary="low/top"))
    assert cells.area.sum() == pytest.approx(3 * np.pi / 4, rel=1e-12)
    with pytest.raises(CaseError, match="look at each other"):
        find_cells(flat, Contact(secondary="high/left", primary="low/top"))


def test_a_pole_gives_numbers():
    """A spherical triangle as a patch with an edge of no length, about its twin."""
    arc = np.array([[1.0, 0, 0], [1, 0, 1], [0, 0, 1]])
    around = np.array([[1.0, 0, 0], [1, 1, 0], [0, 1, 0]])
    ring = np.array([[around[j] * arc[i, 0] + [0, 0, arc[i, 2]] for j in range(3)] for i in range(3)])
    weights = np.multiply.outer([1, 0.5**0.5, 1], [1, 0.5**0.5, 1])
    patches = [
        Patch(name, (2, 2, 1), (open_knots([0, 1], 2),) * 2 + (open_knots([0, 1], 1),),
              np.stack([low * ring, high * ring], axis=2)[::-1], np.stack([weights] * 2, axis=2))
        for name, low, high in (("inner", 0.5, 1.0), ("outer", 1.0, 1.5))
    ]  # fmt: skip
    cells = segments(*sides(model_of(*patches), "inner/top", "outer/bottom"))
    assert all(np.isfinite(values).all() for values in (cells.area, cells.normal, cells.gap, cells.primary_area))
    assert cells.area.sum() == pytest.approx(np.pi / 2, rel=1e-2)


def over_a_block(width, spans, secondary, **body):
    """Cells of a round body over a cubic block, and the area of the block that they see."""
    corner, size = [-width / 2, -width / 2, -width], [width] * 3
    block = {"name": "lower", "origin": corner, "size": size, "spans": [spans, spans, 1]}
    model = geom2iga.build({"geometry": {"degree": 2, "block": [block], **body}})
    cells = find_cells(model, Contact(secondary=secondary, primary="lower/top"))
    return cells, sum(part.primary_area.sum() for part in cells)


@pytest.mark.parametrize(("width", "spans", "fine"), [(100.0, 1, 4), (100.0, 1, 16), (1000.0, 1, 1), (1000.0, 4, 4)])
def test_a_small_punch_over_one_large_span_is_covered_whole(width, spans, fine):
    dome = {"name": "upper", "size": [1.0, 1.0, 1.0], "radius": 2.0, "bottom": "paraboloid", "spans": [fine, fine, 1]}
    assert over_a_block(width, spans, "upper/bottom", domed_block=[dome])[1] == pytest.approx(1.0, rel=1e-8)


@pytest.mark.parametrize("spans", [1, 5, 20])
def test_a_hemisphere_over_a_block_has_cells_whose_normals_look_at_it(spans):
    """Sides of outlines that end a rounding error before a corner do not count as a fifth side."""
    ball = {"name": "upper", "radius": 1.0, "flat": "up", "origin": [0.0, 0.0, 1.02], "spans": 1}
    cells, area = over_a_block(3.0, spans, "upper/outside", hemisphere=[ball])
    assert 0.7 * np.pi < area < np.pi  # grazing parts are left out
    assert min(part.gap.min() for part in cells) == pytest.approx(0.02, abs=1e-3)
