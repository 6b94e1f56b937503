from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geom2iga.bspline import find_spans
from geom2iga.errors import CaseError
from geom2iga.patch import evaluate, refined
from solve.case import Contact
from solve.contact.cells import find_cells
from solve.contact.pressure import ControlPointPressures, PointPressures, ReducedPressures, pressure_space
from solve.space import number_control_points
from tests.cases import bent_patch, block_patch, model_of
from tests.strategies import SEEDS, graded_breaks, stacked_blocks
from tests.verification.glued_bodies import glued_model, wall

SIDES = {"secondary": "upper/bottom", "primary": "lower/top"}
METHODS = {"p": {}, "p-2": {"multiplier": "p-2"}, "kts": {"method": "kts"}}


def space_on(model, **values):
    """Pressure space of "upper" on "lower", with the cells that it is integrated over."""
    space, contact = number_control_points(model), Contact(**SIDES, **values)
    cells = find_cells(model, contact)
    return pressure_space(space, contact, np.concatenate([part.points for part in cells])), cells


def all_functions(pressures, cells):
    """Functions (q, size) at all quadrature points."""
    starts = np.cumsum([0, *(len(part.area) for part in cells)])
    return [pressures.functions(part, start).toarray() for part, start in zip(cells, starts, strict=False)]


@cache
def walls(degree=2):
    """A wall of four faces, no two with the same number of spans, on a block."""
    upper = wall("u", (0.2, 0.3, 1), (1, 1, 1), degree, ((2, 1), (1, 3), (1,)))
    return glued_model({"lower": [block_patch("lower", size=(2, 2, 1), spans=(3, 2, 1))], "upper": upper})


@cache
def on_walls(method):
    return space_on(walls(), **METHODS[method])


@pytest.mark.parametrize("method", METHODS)
@given(st.data())
def test_the_functions_are_nowhere_negative_and_add_up_to_one(method, data):
    model = data.draw(stacked_blocks() | st.just(walls()))
    if method == "p-2" and min(model.patches[face.patch].degrees[0] for face in model.faces("upper/bottom")) < 2:
        return
    pressures, cells = space_on(model, **METHODS[method])
    for values in all_functions(pressures, cells):
        assert values.shape[1] == pressures.size
        assert values.min(initial=0.0) >= -1e-14
        np.testing.assert_allclose(values.sum(axis=1), 1, rtol=0, atol=1e-13)


@pytest.mark.parametrize("method", METHODS)
def test_functions_of_different_faces_do_not_mix_unless_the_faces_share_control_points(method):
    pressures, cells = on_walls(method)
    used = [set(np.flatnonzero(values.any(axis=0))) for values in all_functions(pressures, cells)]
    assert len({part.secondary for part in cells}) == 4
    shared = {
        i
        for part, own in zip(cells, used, strict=True)
        for other, o in zip(cells, used, strict=True)
        if part.secondary != other.secondary
        for i in own & o
    }
    assert bool(shared) == (method == "p")


@given(graded_breaks(), st.integers(2, 5), st.lists(st.integers(1, 4), min_size=8, max_size=8))
def test_reduced_pressures_have_two_degrees_and_two_derivatives_less_on_the_same_spans(breaks, degree, multiplicities):
    """An inner knot that stands m times leaves p - m derivatives, and with two less the functions reach p - 2 - m."""
    inner = np.repeat(breaks[1:-1], [min(m, degree) for m in multiplicities[: len(breaks) - 2]])
    patch = refined(block_patch("upper", degree=degree), knots=[inner, [], []])
    model = model_of(block_patch("lower"), patch)
    (face,) = model.faces("upper/bottom")
    reduced = ReducedPressures({face: model.surface(face)})
    knots, lower = reduced.directions[face][0]
    assert lower == degree - 2
    np.testing.assert_array_equal(np.unique(knots), np.unique(patch.knots[0]))
    for at, count in zip(*np.unique(knots, return_counts=True), strict=True):
        before = np.count_nonzero(patch.knots[0] == at)
        ends = at in (patch.knots[0][0], patch.knots[0][-1])
        assert count == (degree - 1 if ends else min(before, degree - 1))
    assert reduced.shapes[face] == (len(knots) - lower - 1, degree - 1)


@pytest.mark.parametrize("method", ["p", "p-2"])
@given(SEEDS, st.floats(-3, 3))
def test_the_field_of_a_constant_is_the_constant(method, seed, value):
    pressures, _ = on_walls(method)
    xi = np.random.default_rng(seed).random((20, 2))
    for face in walls().faces("upper/bottom"):
        field = pressures.field(face, xi, None, np.arange(pressures.size), np.full(pressures.size, value))
        np.testing.assert_allclose(field, value, rtol=0, atol=1e-13)


@given(SEEDS)
def test_the_field_on_control_points_is_the_spline_through_the_geometry_of_the_face(seed):
    """Control values that are a coordinate of the control points give that coordinate of the surface."""
    patch = bent_patch(seed, name="upper")
    space = number_control_points(model_of(patch))
    (face,) = space.model.faces("upper/bottom")
    rows = space.face_numbers(face)
    xi = np.random.default_rng(seed).random((20, 2))
    pressures = ControlPointPressures(space)
    field = pressures.field(face, xi, None, rows, space.control_points[rows, 0])
    np.testing.assert_allclose(field, evaluate(space.model.surface(face), xi)[0][:, 0], rtol=0, atol=1e-13)


@pytest.mark.parametrize("method", METHODS)
@given(SEEDS)
def test_the_field_is_what_gaps_are_averaged_with(method, seed):
    """At a quadrature point the field is the sum of the functions there, weighted by the pressures."""
    pressures, cells = on_walls(method)
    pressure = np.random.default_rng(seed).random(pressures.size)
    for part, values in zip(cells, all_functions(pressures, cells), strict=True):
        field = pressures.field(part.secondary, part.secondary_xi, None, np.arange(pressures.size), pressure)
        np.testing.assert_allclose(field, values @ pressure, rtol=0, atol=1e-12)


@pytest.mark.parametrize("method", ["p", "p-2"])
def test_functions_without_an_area_of_competence_carry_no_pressure(method):
    pressures, _ = on_walls(method)
    face, xi = walls().faces("upper/bottom")[0], np.random.default_rng(0).random((20, 2))
    some, pressure = np.arange(0, pressures.size, 2), np.random.default_rng(1).random(pressures.size)
    every = np.where(np.isin(np.arange(pressures.size), some), pressure, 0.0)
    found = pressures.field(face, xi, None, some, pressure[some])
    np.testing.assert_allclose(found, pressures.field(face, xi, None, np.arange(pressures.size), every), atol=1e-14)


def test_a_reduced_pressure_jumps_where_it_has_no_continuity_and_is_taken_from_the_span_asked_for():
    pressures, _ = space_on(
        model_of(block_patch("lower"), block_patch("upper", (0, 0, 1), degree=2, spans=(2, 1, 1))), multiplier="p-2"
    )
    (face,) = pressures.surfaces
    knots = pressures.surfaces[face].knots[0]
    assert pressures.size == 2
    spans = np.stack([find_spans(knots, 2, np.array([0.25, 0.75])), np.full(2, 2)], axis=1)
    field = pressures.field(face, np.full((2, 2), 0.5), spans, np.arange(2), np.array([1.0, 5.0]))
    np.testing.assert_array_equal(field, [1.0, 5.0])


@given(SEEDS)
def test_the_pressure_of_single_points_is_that_of_the_nearest(seed):
    random = np.random.default_rng(seed)
    space = number_control_points(model_of(bent_patch(seed, name="upper")))
    (face,) = space.model.faces("upper/bottom")
    xi = random.random((30, 2))
    points, pressure = random.normal(size=(9, 3)), random.random(9)
    rows = np.flatnonzero(random.random(9) < 0.6)
    field = PointPressures(space, points[rows]).field(face, xi, None, rows, pressure[rows])
    at = evaluate(space.model.surface(face), xi)[0]
    if len(rows):
        distance = np.linalg.norm(at[:, None] - points[rows], axis=2)
        np.testing.assert_array_equal(field, pressure[rows][distance.argmin(axis=1)])
    else:
        np.testing.assert_array_equal(field, 0)


def test_no_point_at_all_has_no_pressure():
    space = number_control_points(model_of(block_patch("upper")))
    (face,) = space.model.faces("upper/bottom")
    pressures = PointPressures(space, np.empty((0, 3)))
    none = np.empty(0, dtype=np.int64)
    np.testing.assert_array_equal(pressures.field(face, np.zeros((3, 2)), None, none, np.empty(0)), [0, 0, 0])


def test_a_multiplier_two_degrees_below_one_is_refused_with_its_remedy():
    model = model_of(block_patch("lower", degree=3), block_patch("upper", (0, 0, 1), degree=(2, 1, 2)))
    with pytest.raises(CaseError) as error:
        space_on(model, multiplier="p-2")
    message = str(error.value)
    assert "\n" not in message
    for part in ('"p-2"', '"upper/bottom"', 'patch "upper"', "2 and 1", "raise it"):
        assert part in message


@pytest.mark.parametrize("method", METHODS)
def test_the_case_names_the_space(method):
    kinds = {"p": ControlPointPressures, "p-2": ReducedPressures, "kts": PointPressures}
    pressures, cells = on_walls(method)
    assert type(pressures) is kinds[method]
    if method == "kts":
        assert pressures.size == sum(len(part.area) for part in cells)
