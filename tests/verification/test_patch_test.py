"""The contact patch test: two blocks under pressure have a uniform stress, to rounding."""

import numpy as np
import pytest

import geom2iga
from tests.cases import converged, largest_stress_error, patch_test_case

UNIFORM = (0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
TOLERANCE = 1e-10


def solved(**case):
    tables = patch_test_case(**case)
    return converged(geom2iga.build(tables), tables)


def assert_passed(result, area=1.0):
    """Every stress component is right at 1000 random points of each block, and the contact carries the pressure."""
    assert largest_stress_error(result, UNIFORM, count=1000) < TOLERANCE
    (contact,) = result.contacts
    sign = 1.0 if contact.definition.secondary.startswith("upper") else -1.0
    np.testing.assert_allclose(contact.force, [0, 0, sign * area], rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(contact.pressure, 1, rtol=0, atol=1e-8)
    assert result.statistics["equilibrium_error"] < TOLERANCE


@pytest.mark.parametrize("integration", ["segment", "element"])
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_the_case_of_the_paper_is_exact_with_both_kinds_of_cells(degree, integration):
    assert_passed(solved(degree=degree, integration=integration))


COARSE, FINE = (3, 3, 2), (5, 4, 2)
HARDER = {
    "knot lines that do not match": {},
    "off centre": {"upper_origin": (0.31, 0.83, 1.0)},
    "turned by 17": {"angle": 17.0},
    "turned by 45": {"angle": 45.0},
    "turned by 90": {"angle": 90.0},
    "turned by -128.37": {"angle": -128.37},
    "off centre and turned": {"upper_origin": (0.6, 0.45, 1.0), "angle": 33.0},
    "hanging over on one side": {"upper_origin": (1.3, 0.4, 1.0)},
    "hanging over on two sides": {"upper_size": (3.0, 1.0, 1.0), "upper_origin": (-0.5, 0.5, 1.0)},
    "hanging over at a corner": {"upper_origin": (1.4, -0.3, 1.0)},
    "hanging over all around": {"upper_size": (3.0, 3.0, 1.0), "upper_origin": (-0.5, -0.5, 1.0), "angle": 20.0},
    "lower degree 2, upper 3": {"degree": 2, "upper_degree": 3},
    "lower degree 3, upper 2": {"degree": 3, "upper_degree": 2},
    "degree 3": {"degree": 3},
    "degree 4": {"degree": 4, "lower_spans": (3, 2, 1), "upper_spans": (2, 3, 1), "angle": 33.0},
    "penalty 1e2": {"penalty": 1e2},
    "penalty 1e8": {"penalty": 1e8},
    "degree 4, penalty 1e8": {"degree": 4, "lower_spans": (3, 2, 1), "upper_spans": (2, 3, 1), "penalty": 1e8},
    "apart": {"upper_origin": (0.5, 0.5, 1.01)},
    "overlapping": {"upper_origin": (0.5, 0.5, 0.99)},
}
COVERED = {
    "hanging over on one side": 0.7,
    "hanging over on two sides": 2.0,
    "hanging over at a corner": 0.6 * 0.7,
    "hanging over all around": 4.0,
}


@pytest.mark.parametrize("swap", [False, True], ids=["upper secondary", "lower secondary"])
@pytest.mark.parametrize("name", HARDER)
def test_segment_cells_are_exact_wherever_the_blocks_lie_and_whichever_is_secondary(name, swap):
    case = {"degree": 2, "lower_spans": COARSE, "upper_spans": FINE, "swap": swap, **HARDER[name]}
    assert_passed(solved(**case), area=COVERED.get(name, 1.0))


def test_a_deep_overlap_at_a_stiff_penalty_still_carries_the_load():
    result = solved(degree=2, upper_origin=(0.5, 0.5, 0.5), penalty=1e7)
    np.testing.assert_allclose(result.contacts[0].force, [0, 0, 1], rtol=0, atol=1e-8)


def test_two_passes_share_the_pressure_and_what_they_cover_counts_once():
    tables = patch_test_case(degree=2, lower_spans=COARSE, upper_spans=FINE)
    there = tables["solve"]["contact"][0]
    tables["solve"]["contact"].append(there | {"secondary": there["primary"], "primary": there["secondary"]})
    result = converged(geom2iga.build(tables), tables)
    assert largest_stress_error(result, UNIFORM) < TOLERANCE
    first, second = result.contacts
    np.testing.assert_allclose(first.force - second.force, [0, 0, 1], rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("swap", [False, True], ids=["upper secondary", "lower secondary"])
def test_the_whole_assembly_may_be_turned_in_space(swap):
    turn = {"axis": [1.0, 2.0, -0.7], "angle": 77.0, "about": [0.3, -2.0, 1.0]}
    tables = patch_test_case(degree=2, lower_spans=COARSE, upper_spans=FINE, turn=turn, swap=swap)
    result = converged(geom2iga.build(tables), tables)
    vertical = np.diff(result.model.patches["lower"].control_points[0, 0, [0, -1]], axis=0)[0]
    vertical /= np.linalg.norm(vertical)
    assert abs(vertical[2]) < 0.9
    x, y, z = vertical
    assert largest_stress_error(result, [-x * x, -y * y, -z * z, -x * y, -y * z, -x * z]) < TOLERANCE
    np.testing.assert_allclose(result.contacts[0].force, -vertical if swap else vertical, rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize(("length", "stress"), [(1e-3, 1.0), (1e3, 1e6)])
def test_units_do_not_matter(length, stress):
    tables = patch_test_case(degree=2, lower_spans=COARSE, upper_spans=FINE, angle=20.0, penalty="auto")
    for block in tables["geometry"]["block"]:
        for key in ("origin", "size"):
            block[key] = [length * value for value in block.get(key, (0.0, 0.0, 0.0))]
    tables["solve"]["material"][0]["young"] *= stress
    for load in tables["solve"]["load"]:
        load["pressure"] *= stress
    result = converged(geom2iga.build(tables), tables)
    assert largest_stress_error(result, np.multiply(stress, UNIFORM)) < stress * TOLERANCE
    np.testing.assert_allclose(
        result.contacts[0].force, [0, 0, stress * length**2], rtol=0, atol=1e-9 * stress * length**2
    )


NESTED = {
    "matching": {"upper_spans": (2, 2, 2)},
    "finer above": {"upper_spans": (4, 6, 2)},
    "one span each": {"lower_spans": (1, 1, 1), "upper_spans": (1, 1, 1)},
}


@pytest.mark.parametrize("name", NESTED)
@pytest.mark.parametrize("degree", [1, 2])
def test_element_cells_are_exact_where_every_secondary_span_lies_inside_a_primary_one(name, degree):
    assert_passed(solved(degree=degree, integration="element", **NESTED[name]))


STRADDLING = {  # of 4 x 4 spans each where nothing else is said
    "knot lines that do not match": {"upper_spans": FINE, "upper_origin": (0.4, 0.55, 1.0)},
    "coarser above": {"lower_spans": (8, 8, 1), "upper_spans": (1, 1, 1)},
    "off centre": {"upper_origin": (0.31, 0.83, 1.0)},
    "turned": {"angle": 33.0},
    "hanging over": {"upper_origin": (1.3, 0.4, 1.0)},
    "larger side secondary": {"swap": True, "upper_origin": (0.4, 0.55, 1.0)},
}


@pytest.mark.parametrize("name", STRADDLING)
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_element_cells_are_off_where_a_secondary_span_lies_on_several_primary_ones(name, degree):
    case = {"lower_spans": (4, 4, 1), "upper_spans": (4, 4, 1), **STRADDLING[name]}
    result = solved(degree=degree, integration="element", **case)
    assert largest_stress_error(result, UNIFORM) > 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("swap", [False, True], ids=["upper secondary", "lower secondary"])
@pytest.mark.parametrize("origin", [(0.5, 0.5, 1.0), (0.31, 0.83, 1.0), (1.3, -0.4, 1.0)])
@pytest.mark.parametrize("angle", [45.0, 71.3])
@pytest.mark.parametrize("penalty", [1e2, 1e8])
@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
def test_segment_cells_are_exact_for_all_combinations(degree, penalty, angle, origin, swap):
    spans = {"lower_spans": (3, 3, 2), "upper_spans": (4, 5, 1)}
    tables = patch_test_case(degree, upper_origin=origin, penalty=penalty, angle=angle, swap=swap, **spans)
    tables["solve"]["newton"] = {"tolerance": 1e-12}
    result = converged(geom2iga.build(tables), tables)
    assert largest_stress_error(result, UNIFORM) < 10 * TOLERANCE
