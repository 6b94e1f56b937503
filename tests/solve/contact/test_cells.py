import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geom2iga.errors import CaseError
from geom2iga.model import Model
from geom2iga.patch import basis, evaluate, refined
from solve.case import Contact
from solve.contact.cells import element_cells, find_cells, segment_cells
from solve.face import area_vectors, surface_of
from solve.space import gauss_points
from tests.cases import block_patch, hollow_cylinder, model_of, moved, outline, turned
from tests.strategies import rotations, stacked_blocks
from tests.verification.glued_bodies import glued_model, wall

GAPS = st.sampled_from([0.0, 0.01, -0.01, 0.5])


def sides(model, secondary="upper/bottom", primary="lower/top"):
    """The two faces of a contact as oriented surfaces."""
    return (surface_of(model, model.faces(secondary)[0]), surface_of(model, model.faces(primary)[0]))


def segments(secondary, primary, points=None):
    """Cells of one pair of faces."""
    (cells,) = segment_cells(secondary, [primary], points)
    return cells


def elements(secondary, primary, points=None):
    """Cells of one pair of faces."""
    (cells,) = element_cells(secondary, [primary], points)
    return cells


def overlap(model):
    return outline(model, "upper/bottom").intersection(outline(model, "lower/top")).area


def dense(patch, xi):
    """All basis functions of a surface at points, (q, n)."""
    functions = basis(patch, xi)
    values = np.zeros((len(xi), patch.weights.size))
    np.put_along_axis(values, functions.indices, functions.values, axis=1)
    return values


def products(cells, secondary, primary):
    """Integrals of every secondary times every primary basis function."""
    values = dense(secondary.patch, cells.secondary_xi)
    return (values * cells.area[:, None]).T @ dense(primary.patch, cells.primary_xi)


@given(stacked_blocks())
def test_segment_areas_add_up_to_the_overlap_of_the_faces(model):
    cells = segments(*sides(model))
    assert cells.area.sum() == pytest.approx(overlap(model), rel=1e-12)
    assert cells.primary_area.sum() == pytest.approx(overlap(model), rel=1e-12)
    assert np.all(cells.area >= 0)


@given(st.data(), GAPS, rotations())
def test_segment_points_face_each_other_across_the_gap_wherever_the_pair_lies(data, height, turn):
    model = data.draw(stacked_blocks(height=height, turn=turn))
    secondary, primary = sides(model)
    cells = segments(secondary, primary)
    normal = turn.apply([0.0, 0, 1])
    across = evaluate(secondary.patch, cells.secondary_xi)[0] - evaluate(primary.patch, cells.primary_xi)[0]
    np.testing.assert_allclose(across, np.broadcast_to(height * normal, across.shape), rtol=0, atol=1e-12)
    np.testing.assert_allclose(cells.gap, height, rtol=0, atol=1e-13)
    np.testing.assert_allclose(cells.normal, np.broadcast_to(normal, across.shape), rtol=0, atol=1e-12)
    for xi in (cells.secondary_xi, cells.primary_xi):
        assert np.all((xi >= 0) & (xi <= 1))


@given(st.data(), GAPS)
def test_either_side_may_be_the_secondary_one(data, height):
    model = data.draw(stacked_blocks(height=height))
    secondary, primary = sides(model)
    one, other = segments(secondary, primary), segments(primary, secondary)
    assert one.area.sum() == pytest.approx(other.area.sum(), rel=1e-12)
    np.testing.assert_allclose(other.gap, height, rtol=0, atol=1e-13)
    np.testing.assert_allclose(other.normal, -np.broadcast_to(one.normal[0], other.normal.shape), atol=1e-13)
    np.testing.assert_allclose(
        products(one, secondary, primary), products(other, primary, secondary).T, rtol=0, atol=1e-12
    )


def exact_products(secondary, primary):
    """Products of basis functions of two faces along the axes, one tensor Gauss rule per common span."""
    corners = [np.sort(evaluate(s.patch, [[0, 0], [1, 1]])[0][:, :2], axis=0) for s in (secondary, primary)]
    axes = []
    for d in range(2):
        lines = [
            c[0, d] + at * np.ptp(c[:, d])
            for c, s in zip(corners, (secondary, primary), strict=True)
            for at in [s.patch.breaks[d]]
        ]
        low, high = max(line[0] for line in lines), min(line[-1] for line in lines)
        breaks = np.unique(np.clip(np.concatenate(lines), low, high))
        nodes, weights = np.polynomial.legendre.leggauss(7)
        half = np.diff(breaks)[:, None] / 2
        axes.append(((breaks[:-1, None] + half * (1 + nodes)).ravel(), (half * weights).ravel()))
    x, y = (values.ravel() for values in np.meshgrid(axes[0][0], axes[1][0], indexing="ij"))
    area = np.outer(axes[0][1], axes[1][1]).ravel()
    xi = [(np.column_stack([x, y]) - c[0]) / np.ptp(c, axis=0) for c in corners]
    return (dense(secondary.patch, xi[0]) * area[:, None]).T @ dense(primary.patch, xi[1])


@pytest.mark.parametrize("degrees", [(1, 1), (2, 3), (3, 1)])
@pytest.mark.parametrize("origin", [(0.5, 0.5), (0.37, 0.81), (-0.4, 1.3)])
def test_products_of_both_sides_functions_are_integrated_exactly_along_the_axes(degrees, origin):
    model = model_of(
        block_patch("lower", size=(2, 2, 1), degree=degrees[0], spans=(3, 4, 1)),
        block_patch("upper", (*origin, 1), (1.0, 1.2, 1), degrees[1], spans=(5, 2, 1)),
    )
    secondary, primary = sides(model)
    found = products(segments(secondary, primary), secondary, primary)
    np.testing.assert_allclose(found, exact_products(secondary, primary), rtol=0, atol=1e-14)


@pytest.mark.parametrize(("angle", "points"), [(0.0, 3), (90.0, 3), (180.0, 3), (45.0, 6)])
def test_cells_along_the_knot_lines_of_both_sides_need_half_the_points_per_direction(angle, points):
    """Products of degrees 2 and 3 are of degree 5 along each direction, of total degree 10 where they are turned."""
    turn = Rotation.from_rotvec([0, 0, angle], degrees=True)
    upper = moved(turned(block_patch("upper", (-0.5, -0.5, 1), (1, 1, 1), 3), turn), (1, 1, 0))
    model = model_of(block_patch("lower", size=(2, 2, 1), degree=2), upper)
    assert len(segments(*sides(model)).area) == points**2


@pytest.mark.parametrize("spans", [(1, 1, 1), (4, 1, 1), (1, 4, 1)])
@pytest.mark.parametrize("swap", [False, True])
def test_knot_lines_that_coincide_but_for_rounding_cost_no_cell(spans, swap):
    """General polygon overlays raise on this corner, or lose cells, where an edge misses another by 1e-17."""
    lower = block_patch("lower", size=(2, 2, 1), spans=spans)
    upper = block_patch("upper", (-0.25, -0.25, 1), (0.5, 0.5, 1), spans=(4, 4, 1))
    secondary, primary = sides(model_of(lower, upper))[:: -1 if swap else 1]
    assert segments(secondary, primary).area.sum() == pytest.approx(0.25**2, rel=1e-12)


@given(stacked_blocks())
def test_no_kink_is_left_inside_a_segment_so_that_more_points_change_nothing(model):
    secondary, primary = sides(model)
    usual, finer = (segments(secondary, primary, points) for points in (None, 12))
    assert len(usual.area) < len(finer.area)
    np.testing.assert_allclose(
        products(usual, secondary, primary), products(finer, secondary, primary), rtol=0, atol=1e-13
    )


@given(st.floats(-40, 40), st.floats(-40, 40), st.floats(0, 90))
def test_a_tilted_pair_is_matched_along_the_primary_normal_and_measured_on_the_secondary_side(x, y, z):
    lower = block_patch("lower", size=(2, 2, 1), spans=(3, 2, 1))
    tilt = Rotation.from_euler("zxy", [z, x, y], degrees=True)
    upper = moved(turned(block_patch("upper", (-0.5, -0.5, 0), spans=(2, 3, 1), degree=2), tilt), (1.4, 1, 2))
    model = model_of(lower, upper)
    secondary, primary = sides(model)
    cells = segments(secondary, primary)
    cosine = tilt.apply([0, 0, 1])[2]
    assert cells.primary_area.sum() == pytest.approx(overlap(model), rel=1e-12)
    assert cells.area.sum() == pytest.approx(overlap(model) / cosine, rel=1e-12)
    across = evaluate(secondary.patch, cells.secondary_xi)[0] - evaluate(primary.patch, cells.primary_xi)[0]
    np.testing.assert_allclose(across, cells.gap[:, None] * [0, 0, 1], rtol=0, atol=1e-12)


def test_a_gap_that_is_mere_rounding_is_none():
    lower = block_patch("lower", origin=(0.1, 0.1, 0.1), size=(1, 1, 0.2))
    upper = block_patch("upper", origin=(0.1, 0.1, 0.3), size=(1, 1, 0.1), spans=(3, 3, 3))
    for make in (segments, elements):
        np.testing.assert_array_equal(make(*sides(model_of(lower, upper))).gap, 0)


@given(stacked_blocks(overhang=False))
def test_element_cells_integrate_the_secondary_functions_exactly_where_all_is_covered(model):
    secondary, primary = sides(model)
    cells = elements(secondary, primary)
    gauss = gauss_points(secondary.patch)
    np.testing.assert_array_equal(cells.secondary_xi, gauss.xi)
    reference = gauss_points(secondary.patch, [p + 3 for p in secondary.patch.degrees])
    stretch = area_vectors(secondary, reference.xi)[2]
    exact = dense(secondary.patch, reference.xi).T @ (stretch * reference.weights)
    found = dense(secondary.patch, cells.secondary_xi).T @ cells.area
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-14)
    assert cells.area.sum() == pytest.approx(outline(model, "upper/bottom").area, rel=1e-13)
    np.testing.assert_allclose(cells.gap, 0, rtol=0, atol=1e-13)


@given(stacked_blocks())
def test_element_points_that_hang_over_are_left_out(model):
    secondary, primary = sides(model)
    cells = elements(secondary, primary)
    points = evaluate(secondary.patch, gauss_points(secondary.patch).xi)[0]
    target = outline(model, "lower/top")
    distance = shapely.distance(shapely.points(points[:, :2]), target.exterior)
    over = shapely.contains_xy(target, points[:, 0], points[:, 1])
    assert np.count_nonzero(over & (distance > 1e-6)) <= len(cells.area) <= np.count_nonzero(over | (distance < 1e-6))


def test_element_cells_take_the_given_number_of_points():
    secondary, primary = sides(model_of(block_patch("lower", size=(2, 2, 1)), block_patch("upper", (0.5, 0.5, 1))))
    assert len(elements(secondary, primary, 5).area) == 25


@pytest.mark.parametrize(("secondary", "primary"), [("inner/right", "outer/left"), ("outer/left", "inner/right")])
def test_element_cells_find_the_gap_between_concentric_cylinders(secondary, primary):
    inner = refined(hollow_cylinder(1.0, 2.0, 3.0, name="inner"), spans=2)
    outer = refined(hollow_cylinder(2.1, 3.0, 3.0, name="outer"), spans=3)
    pair = sides(model_of(inner, outer), secondary, primary)
    cells = elements(*pair)
    at = evaluate(pair[1].patch, cells.primary_xi)[0]
    radial = at * [1, 1, 0] / np.linalg.norm(at[:, :2], axis=1, keepdims=True)
    np.testing.assert_allclose(cells.gap, 0.1, rtol=0, atol=1e-12)
    np.testing.assert_allclose(cells.normal, radial * pair[1].face.side - radial * (1 - pair[1].face.side), atol=1e-12)
    radius = 2.0 if secondary == "inner/right" else 2.1
    assert cells.area.sum() == pytest.approx(radius * np.pi / 2 * 3, rel=1e-6)


TWO = model_of(block_patch("lower"), block_patch("upper", origin=(0.2, 0.2, 1)))


@pytest.mark.parametrize(
    ("model", "secondary", "primary", "names"),
    [
        (TWO, "upper/bottm", "lower/top", ['"upper/bottm"', 'did you mean "upper/bottom"']),
        (TWO, "upper/bottom", "lower/tp", ['"lower/tp"', 'did you mean "lower/top"']),
        (TWO, "upper/bottom", "upper/top", ['"upper"', "two bodies"]),
        (TWO, "upper/top", "lower/top", ['"upper/top"', '"lower/top"', "look at each other"]),
        (TWO, "upper/left", "lower/top", ['"upper/left"', '"lower/top"', "look at each other"]),
    ],
)
def test_faces_that_cannot_touch_are_refused_by_name(model, secondary, primary, names):
    with pytest.raises(CaseError) as error:
        find_cells(model, Contact(secondary=secondary, primary=primary))
    assert all(name in str(error.value) for name in names)


@pytest.mark.parametrize("integration", ["segment", "element"])
def test_faces_that_nowhere_lie_opposite_each_other_are_refused(integration):
    model = model_of(block_patch("lower"), block_patch("upper", origin=(5, 0, 1)))
    with pytest.raises(CaseError, match="opposite"):
        find_cells(model, Contact(secondary="upper/bottom", primary="lower/top", integration=integration))


def test_element_cells_refuse_faces_that_look_the_same_way():
    with pytest.raises(CaseError, match="look at each other"):
        find_cells(TWO, Contact(secondary="upper/top", primary="lower/top", integration="element"))


def cells_of(model, integration, secondary="upper/bottom", primary="lower/top"):
    return find_cells(model, Contact(secondary=secondary, primary=primary, integration=integration))


INTEGRATIONS = pytest.mark.parametrize("integration", ["segment", "element"])


@INTEGRATIONS
def test_points_on_the_joint_of_two_primary_faces_count_once(integration):
    """The middle one of three Gauss points of the secondary span lies on the joint."""
    lower, upper = wall("l", spans=((1, 1), (1,), (1,))), block_patch("upper", (0, 0, 1), degree=2)
    cells = cells_of(glued_model({"lower": lower, "upper": [upper]}), integration)
    assert sum(part.area.sum() for part in cells) == pytest.approx(1, rel=1e-12)


@INTEGRATIONS
@pytest.mark.parametrize("name", ["upper/bottom", "upper/skin"])
def test_several_faces_cover_each_other_once_and_those_that_look_elsewhere_do_not_count(integration, name):
    lower, upper = wall("l", size=(2, 2, 1)), wall("u", (0.3, 0.2, 1), (1, 1.5, 1), spans=((2, 1), (3, 1), (2,)))
    cells = cells_of(glued_model({"lower": lower, "upper": upper}), integration, name)
    assert {part.secondary.patch[0] + part.primary.patch[0] for part in cells} == {"ul"}
    assert sum(part.area.sum() for part in cells) == pytest.approx(1.5, rel=1e-12 if integration == "segment" else 0.1)
    for part in cells:
        np.testing.assert_array_equal(part.gap, 0)


@INTEGRATIONS
@pytest.mark.parametrize("first", [0, 1])
def test_a_wall_behind_another_is_not_in_touch(integration, first):
    """The left face of a block looks at the right faces of two others of one body, one behind the other."""
    near, far = block_patch("near", (2, 0, 0)), block_patch("far")
    upper = block_patch("upper", (3.1, 0, 0), spans=(1, 2, 2))
    model = model_of(near, far, upper)
    faces = [*model.faces("near/right"), *model.faces("far/right")]
    groups = {**model.groups, "walls": tuple(faces if first else faces[::-1])}
    model = Model(model.patches, {"walls": ("near", "far"), "upper": ("upper",)}, groups)
    (cells,) = (part for part in cells_of(model, integration, "upper/left", "walls") if len(part.area))
    assert cells.primary.patch == "near"
    assert cells.area.sum() == pytest.approx(1, rel=1e-12)
    np.testing.assert_allclose(cells.gap, 0.1, rtol=0, atol=1e-13)
