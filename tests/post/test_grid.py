import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import solve
from geom2iga import Face, Patch
from post import grid
from post.fields import Samples, sample_at, sample_face, sample_patch
from post.grid import choose_samples, count_points, face_grid, find_slabs, sample_grid, sample_line
from solve.material import Material
from solve.newton import Status
from solve.result import Result, State
from tests.cases import bent_patch, model_of


def moved_at_random(patch: Patch) -> Result:
    """A result whose displacement is random."""
    model = model_of(patch)
    displacement = np.random.default_rng(3).normal(size=(patch.weights.size, 3))
    return Result(Status.CONVERGED, model, {patch.name: Material(3.0, 0.3)}, (State(displacement),), (), {})


@st.composite
def repeated_knots(draw):
    """A degree and an open knot vector whose inner knots stand up to `degree` times."""
    degree = draw(st.integers(1, 4))
    counts = [degree + 1, *draw(st.lists(st.integers(1, degree), max_size=4)), degree + 1]
    return degree, np.repeat(np.arange(len(counts)), counts).astype(float)


@given(repeated_knots(), st.integers(2, 5))
def test_points_are_shared_where_derivatives_are_continuous_and_nowhere_else(knots_of, samples):
    degree, knots = knots_of
    line, apart = (sample_line(knots, degree, samples, joined) for joined in (True, False))
    at, counts = np.unique(knots, return_counts=True)
    torn = at[(counts >= degree) & (at > 0) & (at < at[-1])]
    points, spans = line.rule.points, len(at) - 1
    assert len(points) == spans * (samples - 1) + 1 + len(torn)
    assert len(apart.rule.points) == spans * samples
    np.testing.assert_array_equal(points[1:][np.diff(points) == 0], torn)
    np.testing.assert_array_equal(points[line.knots], at)
    for which in (line, apart):
        widths = which.rule.points[which.starts + 1] - which.rule.points[which.starts]
        np.testing.assert_allclose(widths, 1 / (samples - 1))
        assert len(widths) == spans * (samples - 1)
        np.testing.assert_array_equal(np.bincount(which.spans)[np.unique(which.spans)], which.rule.counts)


@pytest.mark.parametrize("degrees", [(1, 2, 3), (2, 2, 2)])
@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize(("long", "slab"), [(32, 10**6), (4, 1), (1, 200)])
def test_slabs_and_bricks_of_any_size_hold_what_is_evaluated_point_by_point(degrees, rational, long, slab, monkeypatch):
    monkeypatch.setattr(grid, "LONG", long)
    monkeypatch.setattr(grid, "SLAB", slab)
    result = moved_at_random(bent_patch(1, degrees, (3, 4, 5), rational=rational))
    part = sample_patch(result, "bent", 3)
    points = sample_grid(result.model.patches["bent"], 3, joined=True)
    expected = sample_at(result, "bent", points.xi, points.spans)
    for name in ("points", "displacement", "stress"):
        found, exact = getattr(part, name), getattr(expected, name)
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-12 * np.abs(exact).max())
    np.testing.assert_array_equal(part.cells, points.cells)
    assert (len(part.points), len(part.cells)) == count_points(result.model.patches["bent"], 3)
    assert len(list(find_slabs(result.model.patches["bent"], points))) == (1 if slab > 10**5 else 3)


@given(st.integers(0, 2), st.integers(0, 1))
def test_a_face_is_the_end_of_the_volume(axis, side):
    result = moved_at_random(bent_patch(2, (2, 1, 3), (2, 3, 2)))
    patch, face = result.model.patches["bent"], Face("bent", axis, side)
    shape = sample_grid(patch, 3, joined=True).shape
    part, whole = sample_face(result, face, 3), sample_patch(result, "bent", 3)
    for name in ("points", "displacement", "stress"):
        end = np.take(getattr(whole, name).reshape(*shape, -1), -side, axis=axis)
        found = getattr(part, name)
        np.testing.assert_allclose(found, end.reshape(found.shape), rtol=0, atol=1e-12 * np.abs(end).max())
    first, second = (face_grid(patch, face, 3).lines[a] for a in face.axes)
    corners = part.points.reshape(len(first.rule.points), len(second.rule.points), 3)
    np.testing.assert_array_equal(part.points[part.cells[0]], corners[[0, 1, 1, 0], [0, 0, 1, 1]])
    assert len(part.cells) == len(first.starts) * len(second.starts)


def test_stress_is_no_number_where_an_edge_has_no_length_and_nowhere_else():
    points = np.stack(np.meshgrid([0.0, 1], [0.0, 1], [0.0, 1], indexing="ij"), axis=-1)
    points[0, :, :, 1] = 0.0  # a wedge
    patch = Patch("wedge", (1, 1, 1), ([0, 0, 1, 1],) * 3, points)
    part = sample_patch(moved_at_random(patch), "wedge", 3)
    np.testing.assert_array_equal(np.isnan(part.stress).any(axis=1), part.points[:, 0] == 0)
    assert not np.isnan(part.displacement).any()


def test_fewer_points_are_chosen_where_there_are_very_many(monkeypatch):
    model = model_of(bent_patch(1, (2, 2, 2), (4, 4, 4)))
    assert choose_samples(model) == 4
    for samples in (4, 3, 2):
        monkeypatch.setattr(grid, "MANY", ((samples - 1) * 4 + 1) ** 3)
        assert choose_samples(model) == samples
    monkeypatch.setattr(grid, "MANY", 1)
    assert choose_samples(model) == 2


def test_slabs_name_their_patch_one_after_the_other(bent: solve.Result):
    names = [name for name, _ in Samples(bent, 2).slabs(bent.model.bodies)]
    assert names == sorted(names, key=list(bent.model.patches).index)
    assert set(names) == set(bent.model.patches)
