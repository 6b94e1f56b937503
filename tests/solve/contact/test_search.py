import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geom2iga.patch import evaluate, refined
from solve.contact.search import find_box_pairs, find_opposite, may_lie_opposite, spans_of
from solve.face import area_vectors, surface_of
from tests.cases import bent_patch, block_patch, model_of, moved, turned
from tests.strategies import SEEDS, rotations


@given(SEEDS, st.integers(0, 12), st.integers(1, 12))
def test_the_pairs_are_those_whose_boxes_meet_each_once_and_in_sequence(seed, count, other_count):
    random = np.random.default_rng(seed)
    low, other_low = random.integers(0, 6, (count, 2)) / 2, random.integers(0, 6, (other_count, 2)) / 2
    high, other_high = low + random.integers(0, 3, (count, 2)), other_low + random.integers(0, 3, (other_count, 2))
    meet = np.all((low[:, None] <= other_high) & (other_low <= high[:, None]), axis=2)
    found = find_box_pairs(low, high, other_low, other_high)
    np.testing.assert_array_equal(np.stack(found), np.stack(np.nonzero(meet)))


def test_the_spans_of_a_face_are_listed_with_their_knot_indices():
    patch = block_patch(degree=(2, 1, 1), spans=(2, 1, 1))
    spans = spans_of(model_of(refined(patch, knots=[[0.5], [], []])).surface(model_of(patch).faces("block/top")[0]))
    np.testing.assert_array_equal(spans.low, [[0, 0], [0.5, 0]])
    np.testing.assert_array_equal(spans.high, [[0.5, 1], [1, 1]])
    np.testing.assert_array_equal(spans.numbers, [[2, 1], [4, 1]])


@pytest.mark.parametrize(("reach", "spans"), [(None, 4), (13, 4), (9, 3), (5, 2), (0.05, 1)])
def test_spans_that_are_farther_away_than_the_reach_are_left_out(reach, spans):
    lower, upper = block_patch("lower", size=(4, 1, 1)), block_patch("upper", (0, 0, 1), (4, 1, 1), spans=(4, 1, 1))
    points = upper.control_points.copy()
    points[..., 2] += 4 * points[..., 0]
    model = model_of(lower, type(upper)(upper.name, upper.degrees, upper.knots, points))
    sides = [surface_of(model, model.faces(name)[0]) for name in ("upper/bottom", "lower/top")]
    opposite = find_opposite(*sides, reach)
    assert len(opposite.low) == len(opposite.high) == spans


def test_faces_that_look_the_same_way_are_nowhere_opposite():
    model = model_of(block_patch("lower"), block_patch("upper", (0, 0, 1)))
    sides = [surface_of(model, model.faces(name)[0]) for name in ("upper/top", "lower/top")]
    opposite = find_opposite(*sides)
    assert not len(opposite.low)
    assert not len(opposite.feet)


def top_and_bottom(upper, lower):
    model = model_of(upper, lower)
    return [surface_of(model, model.faces(f"{name}")[0]) for name in (f"{upper.name}/bottom", f"{lower.name}/top")]


@given(SEEDS, st.floats(-30, 30), rotations())
def test_a_face_that_a_normal_of_the_other_meets_is_never_ruled_out(seed, gap, turn):
    """A corner of one block is put somewhere along a normal at a corner of the bent one."""
    bent = turned(bent_patch(seed), turn)
    top = surface_of(model_of(bent), model_of(bent).faces("bent/top")[0])
    at, normal, _ = area_vectors(top, np.random.default_rng(seed).integers(0, 2, (1, 2)) * 1.0)
    block = turned(block_patch("block", size=(0.3, 0.2, 0.1)), turn.inv())
    corner = evaluate(block, [[0, 1, 0]])[0][0]
    assert may_lie_opposite(*top_and_bottom(moved(block, at[0] + gap * normal[0] - corner), bent))


@pytest.mark.parametrize("bend", [0.0, 0.1])
@given(turn=rotations())
def test_faces_far_aside_are_ruled_out_however_they_lie(bend, turn):
    lower = block_patch("lower", degree=2, spans=(2, 2, 1))
    points = lower.control_points.copy()
    points[..., 2] += bend * np.sin(3 * points[..., 0])
    lower = type(lower)("lower", lower.degrees, lower.knots, points)
    for way in ((3, 0, 1), (0, -3, 1.2), (2.2, 2.2, 0.9)):
        assert not may_lie_opposite(*top_and_bottom(*(turned(p, turn) for p in (block_patch("upper", way), lower))))
    assert may_lie_opposite(*top_and_bottom(*(turned(p, turn) for p in (block_patch("upper", (0.9, 0, 1)), lower))))
