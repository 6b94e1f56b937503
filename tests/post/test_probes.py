import csv

import numpy as np
import pytest

import geom2iga
from geom2iga.errors import CaseError
from post.case import LineProbe, PointProbe, PostCase
from post.fields import sample_at
from post.probes import check_probes, probe, sample_line, sample_point, write_line, write_point
from post.quantities import QUANTITIES
from tests.cases import block_patch, converged, displacement_at, model_of, patch_test_case
from tests.verification.glued_bodies import glued_model, wall

FIXED = {"ux": 0.0, "uy": 0.0, "uz": 0.0}
UPRIGHT = {"name": "up", "start": [0.7, 0.8, -0.5], "end": [0.7, 0.8, 2.5], "points": 31}


def bar_case(name="bar", height=1.0):
    """A bar of E = 1000, nu = 0.25, compressed by 1 %."""
    supports = [{"on": f"{name}/{side}", "normal": 0.0} for side in ("left", "front", "bottom")]
    supports.append({"on": f"{name}/top", "uz": -0.01 * height})
    return {"solve": {"material": [{"young": 1000.0, "poisson": 0.25}], "support": supports}}


@pytest.fixture(scope="module")
def glued():
    """A bar of eight skewed patches."""
    model = glued_model({"bar": wall("b", degree=2, spans=((1, 1), (1, 1), (1, 1)), shift=(0.1, -0.1))})
    return converged(model, bar_case())


@pytest.fixture(scope="module")
def apart():
    """Two bars with a gap of 0.5 between them."""
    model = model_of(block_patch("lower"), block_patch("upper", (0, 0, 1.5)))
    lower, upper = (bar_case(name)["solve"] for name in ("lower", "upper"))
    case = {"solve": {**lower, "support": lower["support"] + upper["support"]}}
    return converged(model, case)


@pytest.fixture(scope="module")
def stepped():
    source = patch_test_case(lower_spans=(2, 2, 1), upper_spans=(3, 2, 1))
    source["solve"]["steps"] = {"count": 4}
    return converged(geom2iga.build(source), source)


def post_case(**tables):
    return PostCase.model_validate({"post": tables})


def read_columns(path):
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def test_linear_fields_are_exact_along_a_line_through_glued_patches(glued):
    line = sample_line(glued, LineProbe(name="a", start=(0, 0, 0), end=(1, 1, 1), points=41))
    share = np.linspace(0, 1, 41)
    assert line.body == ("bar",) * 41
    np.testing.assert_allclose(line.distance, np.sqrt(3) * share, rtol=0, atol=1e-15)
    expected = share[:, None] * [0.0025, 0.0025, -0.01]
    np.testing.assert_allclose(line.samples.displacement, expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(line.samples.stress, [[0, 0, -10, 0, 0, 0]] * 41, rtol=0, atol=1e-9)


def test_a_line_through_a_gap_has_no_numbers_there(apart):
    line = sample_line(apart, LineProbe(name="a", start=(0.5, 0.5, -0.5), end=(0.5, 0.5, 3.0), points=36))
    expected = np.repeat(["", "lower", "", "upper", ""], [5, 11, 4, 11, 5])
    assert list(line.body) == expected.tolist()
    inside = expected != ""
    assert np.isnan(line.samples.stress[~inside]).all()
    assert np.isnan(line.samples.displacement[~inside]).all()
    np.testing.assert_allclose(line.samples.von_mises[inside], 10, rtol=0, atol=1e-9)


@pytest.mark.parametrize("downward", [False, True])
def test_where_bodies_touch_a_line_has_both_and_first_the_one_that_it_leaves(bent, downward):
    ends = [(1.8, 0.9, 0.0), (1.8, 0.9, 2.0)]
    start, end = reversed(ends) if downward else ends
    line = sample_line(bent, LineProbe(name="a", start=start, end=end, points=21))
    expected = ("lower",) * 11 + ("upper",) * 11
    assert line.body == (expected[::-1] if downward else expected)
    np.testing.assert_array_equal(line.distance[10], line.distance[11])
    assert not np.array_equal(line.samples.stress[10], line.samples.stress[11])
    for body in ("lower", "upper"):
        alone = sample_line(bent, LineProbe(name="a", start=start, end=end, points=21, body=body))
        own = np.array(line.body) == body
        inside = np.array(alone.body) == body
        np.testing.assert_array_equal(line.samples.stress[own], alone.samples.stress[inside])
        assert len(alone.body) == 21


def test_anywhere_in_a_body_the_fields_are_those_of_the_patch(bent):
    xi = np.random.default_rng(0).random((30, 3))
    expected = sample_at(bent, "upper", xi)
    found = probe(bent, expected.points, "upper")
    np.testing.assert_allclose(found.displacement, expected.displacement, rtol=0, atol=1e-14)
    np.testing.assert_allclose(found.stress, expected.stress, rtol=0, atol=1e-9)
    outside = probe(bent, [[0.0, 0.0, 50.0]])
    assert np.isnan(outside.stress).all()
    assert np.isnan(outside.principal_stress).all()


def test_a_point_is_followed_through_the_load_steps(stepped):
    point = sample_point(stepped, PointProbe(name="a", at=(1.0, 0.7, 1.4)))
    assert point.body == "upper"
    np.testing.assert_array_equal(point.load_factor, [0.25, 0.5, 0.75, 1.0])
    np.testing.assert_allclose(point.samples.stress[:, 2], -point.load_factor, rtol=0, atol=1e-9)
    last = displacement_at(stepped, "upper", np.array([[0.5, 0.2, 0.4]]))[0]
    np.testing.assert_allclose(point.samples.displacement, point.load_factor[:, None] * last, rtol=0, atol=1e-12)


def test_a_line_comes_back_from_its_file_to_the_last_bit(bent, tmp_path):
    line = sample_line(bent, LineProbe(**UPRIGHT))
    write_line(tmp_path / "line_up.csv", line)
    columns = read_columns(tmp_path / "line_up.csv")
    assert list(columns) == ["distance", "x", "y", "z", "body", *QUANTITIES]
    assert tuple(columns.pop("body")) == line.body
    numbers = {name: np.array(values, dtype=float) for name, values in columns.items()}
    np.testing.assert_array_equal(numbers["distance"], line.distance)
    np.testing.assert_array_equal(np.stack([numbers[axis] for axis in "xyz"], axis=1), line.samples.points)
    for name, quantity in QUANTITIES.items():
        np.testing.assert_array_equal(numbers[name], quantity.values(line.samples))
    assert [entry.name for entry in tmp_path.iterdir()] == ["line_up.csv"]


def test_a_point_comes_back_from_its_file_to_the_last_bit(stepped, tmp_path):
    point = sample_point(stepped, PointProbe(name="a", at=(0.3, 0.7, 0.4)))
    write_point(tmp_path / "point_a.csv", point)
    columns = read_columns(tmp_path / "point_a.csv")
    assert list(columns) == ["load_step", "load_factor", "x", "y", "z", "body", *QUANTITIES]
    assert columns["load_step"] == ["1", "2", "3", "4"]
    assert columns["body"] == ["lower"] * 4
    for name, quantity in QUANTITIES.items():
        np.testing.assert_array_equal(np.array(columns[name], dtype=float), quantity.values(point.samples))


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"point": [{"name": "a", "at": [0, 0, 0], "body": "uper"}]}, ["post.point[0].body", '"uper"', '"upper"']),
        ({"line": [{**UPRIGHT, "body": "uper"}]}, ["post.line[0].body", '"uper"', 'did you mean "upper"']),
        (
            {"point": [{"name": "a", "at": [0.6, 0.6, 0.5]}, {"name": "b", "at": [1, 1, 9.5]}]},
            ["post.point[1].at = [1, 1, 9.5] lies outside every body", '"upper", lies within', "to [1.5, 1.5, 2]"],
        ),
        (
            {"point": [{"name": "a", "at": [1, 1, 1.5], "body": "lower"}]},
            ['post.point[0].at = [1, 1, 1.5] lies outside body "lower", which lies within [0, 0, 0] to [2, 2, 1]'],
        ),
        (
            {"point": [{"name": "a", "at": [1, 1, 1]}]},
            ['post.point[0].at = [1, 1, 1] lies in "lower" and "upper": name one of them as body'],
        ),
        (
            {"line": [UPRIGHT, {"name": "off", "start": [-1, -1, 0], "end": [-1, 3, 0]}]},
            ["post.line[1]: all points of the line from [-1, -1, 0] to [-1, 3, 0] lie outside every body", '"lower"'],
        ),
        (
            {"line": [{**UPRIGHT, "end": [0.7, 0.8, 0.5], "body": "upper"}]},
            ['lie outside body "upper", which lies within [0.5, 0.5, 1]'],
        ),
    ],
)
def test_a_probe_that_does_not_fit_the_model_is_named_with_what_would(stepped, tables, words):
    with pytest.raises(CaseError) as error:
        check_probes(stepped.model, post_case(**tables))
    assert all(word in str(error.value) for word in words), str(error.value)


def test_probes_that_fit_the_model_pass(stepped):
    points = [{"name": "a", "at": [1, 1, 1], "body": "upper"}, {"name": "b", "at": [0, 0, 0]}]
    check_probes(stepped.model, post_case(point=points, line=[UPRIGHT, {**UPRIGHT, "name": "own", "body": "lower"}]))


def test_a_point_that_no_single_body_holds_is_refused(stepped):
    with pytest.raises(CaseError, match=r"at = .* name one of them as body"):
        sample_point(stepped, PointProbe(name="a", at=(1.0, 1.0, 1.0)))
