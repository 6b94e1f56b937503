from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import geom2iga
from geom2iga.body_case import Grading, Mesh
from geom2iga.errors import CaseError
from geom2iga.glue import find_glued
from geom2iga.model import SIDES, Face, Model
from geom2iga.patch import evaluate, refined
from geom2iga.refinement import LONGER, meshed
from geom2iga.shapes import primitives
from tests.cases import block_patch
from tests.geom2iga.exchange.scrambled import CUBE, RING, ring, scrambled_model, turned_about, turnings
from tests.oracles import assert_same_map
from tests.strategies import SEEDS, graded_breaks

ONE = (1, 1, 1)
SIDE_FACES = {side: (Face("block", k // 2, k % 2),) for k, side in enumerate(SIDES)}
TRIPLES = st.tuples(*[st.integers(1, 6)] * 3)


def meshed_block(size=(1, 2, 3), degrees=ONE, knots=None, **mesh):
    """A cuboid with its mesh."""
    patch = block_patch(size=size) if knots is None else refined(block_patch(size=size), knots=knots)
    (found,) = meshed([patch], (), Mesh(**mesh), degrees, SIDE_FACES)
    return found


def cube_of_cells(seed):
    """Eight glued cells, their directions every which way, and the glued faces."""
    model = scrambled_model(seed, CUBE)
    return [model.patches[name] for name in model.bodies["body"]], model.glued


def assert_conforming(patches, glued):
    """A model of one body accepts the patches: glued faces share their control points."""
    Model({patch.name: patch for patch in patches}, {"body": tuple(p.name for p in patches)}, {}, glued)


def lengths_along(patch, axis):
    """Lengths (s,) of the spans along the first edge of a straight direction."""
    xi = np.zeros((len(patch.breaks[axis]), 3))
    xi[:, axis] = patch.breaks[axis]
    return np.linalg.norm(np.diff(evaluate(patch, xi)[0], axis=0), axis=1)


def largest_span(patch, axis, samples=40):
    """The longest piece between two knots of any of the four edges along a direction."""
    longest = 0.0
    for corner in np.ndindex(2, 2):
        for low, high in pairwise(patch.breaks[axis]):
            xi = np.insert(np.tile(np.array(corner, float), (samples, 1)), axis, np.linspace(low, high, samples), 1)
            longest = max(longest, np.linalg.norm(np.diff(evaluate(patch, xi)[0], axis=0), axis=1).sum())
    return longest


def grading(toward, ratio, equal=1):
    return Grading(toward=toward, ratio=ratio, equal=equal)


@given(TRIPLES, st.tuples(*[st.integers(1, 4)] * 3))
def test_a_block_gets_the_spans_and_degrees_that_are_asked_for(spans, degrees):
    patch = meshed_block(spans=spans, degrees=degrees)
    assert patch.degrees == degrees
    for at, count, knots, degree in zip(patch.breaks, spans, patch.knots, degrees, strict=True):
        np.testing.assert_allclose(np.diff(at), np.full(count, 1 / count), rtol=1e-12)
        assert len(knots) == count + 2 * degree + 1  # of highest smoothness
    assert_same_map(patch, block_patch(size=(1, 2, 3)))


def test_without_a_word_of_it_there_is_one_span():
    assert [at.tolist() for at in meshed_block().breaks] == [[0, 1]] * 3


@given(st.tuples(*[st.floats(0.05, 20)] * 3), st.floats(0.3, 30))
def test_no_span_of_a_block_is_longer_than_the_span_size_and_one_fewer_would_be(size, span_size):
    patch = meshed_block(size, span_size=span_size)
    for length, at in zip(size, patch.breaks, strict=True):
        count = len(at) - 1
        assert length / count <= span_size * (1 + 1e-8)
        assert count == 1 or length / (count - 1) > span_size
        np.testing.assert_allclose(np.diff(at), np.full(count, 1 / count), rtol=1e-10)


def test_a_span_size_that_divides_a_length_needs_no_span_more():
    assert [len(at) - 1 for at in meshed_block((0.3, 0.7, 1.1), span_size=0.1).breaks] == [3, 7, 11]


@given(SEEDS, st.floats(0.2, 3))
@settings(max_examples=10)
def test_patches_that_hang_together_take_the_spans_that_their_longest_edge_needs(seed, span_size):
    patches = [block_patch("a"), block_patch("b", origin=(0, 0, 1), size=(1, 1, 2.5))]
    ways = turnings()
    random = np.random.default_rng(seed)
    patches = [turned_about(patch, ways[random.integers(len(ways))]) for patch in patches]
    glued = find_glued(patches)
    found = meshed(patches, glued, Mesh(span_size=span_size), ONE, {})
    assert_conforming(found, glued)
    for before, after, height in zip(patches, found, (1, 2.5), strict=True):
        assert_same_map(after, before)
        counts = sorted(len(at) - 1 for at in after.breaks)
        across, along = (int(np.ceil(length / span_size - 1e-9)) for length in (1, height))
        assert counts == sorted([across, across, along])


@pytest.mark.parametrize("part", [primitives.pipe("body", 1, 2, 1), primitives.sphere("body", 1.0)])
def test_no_span_of_a_curved_edge_is_longer_than_the_span_size(part):
    glued = find_glued(part.patches)
    for patch in meshed(part.patches, glued, Mesh(span_size=0.35), ONE, part.faces):
        for axis in range(3):
            assert largest_span(patch, axis) <= 0.35 * (1 + 1e-3)


@pytest.mark.parametrize("part", [primitives.pipe("body", 1, 2, 1), primitives.sphere("body", 1.0)])
def test_spans_of_curved_edges_come_near_the_span_size(part):
    glued = find_glued(part.patches)
    found = meshed(part.patches, glued, Mesh(span_size=0.35), ONE, part.faces)
    assert_conforming(found, glued)
    longest = max(largest_span(patch, axis) for patch in found for axis in range(3))
    assert 0.2 < longest < 0.5


@given(st.integers(2, 12), st.floats(1, 50), st.sampled_from(SIDES), st.integers(1, 4))
def test_spans_grow_geometrically_away_from_the_face_to_the_ratio_asked_for(spans, ratio, side, degree):
    patch = meshed_block(spans=spans, degrees=(degree,) * 3, grading=[grading(side, ratio)])
    axis, end = divmod(SIDES.index(side), 2)
    lengths = lengths_along(patch, axis)[:: -1 if end else 1]
    assert len(lengths) == spans
    assert lengths[-1] / lengths[0] == pytest.approx(ratio, rel=1e-9)
    np.testing.assert_allclose(lengths[1:] / lengths[:-1], ratio ** (1 / (spans - 1)), rtol=1e-9)
    for other in {0, 1, 2} - {axis}:
        np.testing.assert_allclose(np.diff(patch.breaks[other]), np.full(spans, 1 / spans), rtol=1e-12)
    assert_same_map(patch, block_patch(size=(1, 2, 3)))


def test_a_ratio_of_one_is_no_grading():
    plain, graded = (meshed_block(spans=5, grading=g) for g in ((), [grading("top", 1)]))
    assert [at.tolist() for at in plain.breaks] == [at.tolist() for at in graded.breaks]


def test_a_single_span_has_nothing_to_grade():
    assert [at.tolist() for at in meshed_block(grading=[grading("top", 7)]).breaks] == [[0, 1]] * 3


def test_gradings_toward_faces_of_different_directions_go_together():
    patch = meshed_block(spans=4, grading=[grading("bottom", 3), grading("right", 5)])
    ratios = [lengths[-1] / lengths[0] for lengths in (lengths_along(patch, axis) for axis in range(3))]
    assert ratios == pytest.approx([1 / 5, 1, 3], rel=1e-9)


@given(st.floats(0.1, 2), st.floats(1, 20), st.sampled_from(SIDES))
def test_no_graded_span_is_longer_than_the_span_size_and_one_fewer_would_be(span_size, ratio, side):
    axis = SIDES.index(side) // 2
    patch = meshed_block(span_size=span_size, grading=[grading(side, ratio)])
    lengths = lengths_along(patch, axis)
    assert lengths.max() <= span_size * (1 + LONGER)
    if len(lengths) > 1:
        assert max(lengths.max() / lengths[0], lengths.max() / lengths[-1]) == pytest.approx(ratio, rel=1e-9)
        fewer = meshed_block(spans=len(lengths) - 1, grading=[grading(side, ratio)])
        assert lengths_along(fewer, axis).max() > span_size


@given(SEEDS, st.integers(2, 5), st.floats(1.5, 10))
@settings(max_examples=10)
def test_a_grading_goes_through_all_patches_that_are_glued(seed, spans, ratio):
    """Cells of a grid, turned every which way: spans grow away from the named face of one of them."""
    random, ways = np.random.default_rng(seed), turnings()
    cells = [block_patch(f"cell{n}", at) for n, at in enumerate(RING)]
    cells = [turned_about(cell, ways[random.integers(len(ways))]) for cell in cells]
    glued = find_glued(cells)
    bottom = next(face for face in (Face("cell0", k // 2, k % 2) for k in range(6)) if lies_at_bottom(cells[0], face))
    found = meshed(cells, glued, Mesh(spans=spans, grading=[grading("low", ratio)]), ONE, {"low": (bottom,)})
    assert_conforming(found, glued)
    for before, after in zip(cells, found, strict=True):
        assert_same_map(after, before)
        heights = np.unique(np.round(after.control_points[..., 2], 12))
        assert len(heights) == spans + 1
        assert np.diff(heights)[-1] / np.diff(heights)[0] == pytest.approx(ratio, rel=1e-9)


def lies_at_bottom(patch, face):
    """Whether a face of a straight block is the one at z = 0."""
    xi = np.full((1, 3), 0.5)
    xi[0, face.axis] = face.side
    return abs(evaluate(patch, xi)[0][0, 2]) < 1e-12


@pytest.mark.parametrize("kind", ["pipe", "cylinder"])
def test_every_patch_of_a_round_body_is_graded_toward_its_bottom(kind):
    table = {"name": "body", "height": 2.0, "spans": 4, "grading": {"toward": "bottom", "ratio": 3}}
    table |= {"pipe": {"inner": 1.0, "outer": 2.0}, "cylinder": {"radius": 1.0}}[kind]
    model = geom2iga.build({"geometry": {kind: [table]}})
    for patch in model.patches.values():
        lengths = lengths_along(patch, 2)
        assert lengths[-1] / lengths[0] == pytest.approx(3, rel=1e-9)


@given(st.integers(1, 12), st.integers(1, 6), st.floats(1.5, 50), st.sampled_from(SIDES))
def test_so_many_spans_next_to_the_face_are_equal_and_the_others_grow_from_there(grown, equal, ratio, side):
    patch = meshed_block(spans=equal + grown, grading=[grading(side, ratio, equal)])
    axis, end = divmod(SIDES.index(side), 2)
    lengths = lengths_along(patch, axis)[:: -1 if end else 1]
    np.testing.assert_allclose(lengths[:equal], lengths[0], rtol=1e-9)
    np.testing.assert_allclose(lengths[equal:] / lengths[equal - 1 : -1], ratio ** (1 / grown), rtol=1e-9)


def test_where_all_spans_are_to_be_equal_there_is_no_grading():
    plain, graded = (meshed_block(spans=5, grading=g) for g in ((), [grading("top", 9, 5)]))
    np.testing.assert_allclose(graded.breaks[2], plain.breaks[2], rtol=1e-14)


@given(st.integers(4, 15), st.floats(1.5, 50), st.floats(1.5, 50))
def test_toward_both_ends_of_a_direction_spans_grow_to_the_middle(spans, first, last):
    patch = meshed_block(spans=spans, grading=[grading("bottom", first), grading("top", last)])
    lengths = lengths_along(patch, 2)
    assert lengths.max() / lengths[0] == pytest.approx(first, rel=1e-9)
    assert lengths.max() / lengths[-1] == pytest.approx(last, rel=1e-9)
    middle = np.argmax(lengths)
    assert (np.diff(lengths)[:middle] > -1e-12).all()
    assert (np.diff(lengths)[middle:] < 1e-12).all()
    assert abs(middle - (spans - 1) / 2) <= 1


def test_a_row_of_patches_may_be_graded_toward_both_of_its_ends():
    patches = [block_patch("a"), block_patch("b", origin=(0, 0, 1))]
    faces = {"left": (Face("a", 0, 0),), "right": (Face("b", 0, 1),)}
    mesh = Mesh(spans=4, grading=[grading("left", 2), grading("right", 4)])
    for patch in meshed(patches, find_glued(patches), mesh, ONE, faces):
        np.testing.assert_allclose(lengths_along(patch, 0), np.array([2, 4, 4, 1]) / 11, rtol=1e-12)


def test_a_grading_across_a_twisted_ring_leads_both_ways():
    model = ring(0, 120, 240, twist=180)
    mesh = Mesh(spans=3, grading=[grading("inner", 2)])
    found = meshed(list(model.patches.values()), model.glued, mesh, ONE, {"inner": (Face("ring/1", 0, 0),)})
    for patch in found:
        np.testing.assert_allclose(lengths_along(patch, 0), lengths_along(patch, 0)[::-1], rtol=1e-12)


def test_two_different_gradings_toward_one_end_are_refused():
    mesh = Mesh(spans=3, grading=[grading("here", 2), grading("there", 3)])
    patches = [block_patch("a"), block_patch("b", origin=(0, 1, 0))]
    faces = {"here": (Face("a", 2, 0),), "there": (Face("b", 2, 0),)}
    with pytest.raises(CaseError, match="the same end of a direction"):
        meshed(patches, find_glued(patches), mesh, ONE, faces)


@pytest.mark.parametrize("faces", [{}, {"bottom": ()}, {"bottom": (Face("block", 2, 0),), "top": ()}])
def test_a_grading_toward_faces_that_do_not_exist_says_which_there_are(faces):
    mesh = Mesh(grading=[grading("top", 2)])
    with pytest.raises(CaseError, match=rf'"top".*known: {", ".join(faces)}'):
        meshed([block_patch()], (), mesh, ONE, faces)


@given(SEEDS, TRIPLES, st.tuples(*[st.integers(1, 4)] * 3))
@settings(max_examples=10)
def test_degrees_are_at_least_those_asked_for_and_those_of_the_shape(seed, spans, degrees):
    patches, glued = cube_of_cells(seed)
    found = meshed(patches, glued, Mesh(spans=spans), degrees, {})
    assert_conforming(found, glued)
    for before, after in zip(patches, found, strict=True):
        assert_same_map(after, before)
        assert all(
            new >= max(old, wanted) for new, old, wanted in zip(after.degrees, before.degrees, degrees, strict=True)
        )
        assert max(after.degrees) <= max(*before.degrees, *degrees)
        for at, coarse in zip(after.breaks, before.breaks, strict=True):
            assert np.abs(at[:, None] - coarse).min(axis=0).max() <= 1e-12


@given(graded_breaks(), st.integers(1, 8))
def test_the_breaks_of_a_shape_are_kept_and_no_span_is_longer_than_asked_for(at, spans):
    patch = meshed_block(knots=[at[1:-1], [], []], spans=spans)
    found = patch.breaks[0]
    assert np.abs(found[:, None] - at).min(axis=0).max() <= 1e-12
    assert np.diff(found).max() <= 1 / spans + 1e-9
    needed = np.ceil(spans * np.diff(at) - 1e-9).sum()
    assert len(found) - 1 == needed


@given(graded_breaks(), st.integers(2, 8), st.floats(1, 10))
def test_a_grading_keeps_the_breaks_of_a_shape(at, spans, ratio):
    patch = meshed_block(knots=[[], [], at[1:-1]], spans=spans, grading=[grading("bottom", ratio)])
    found = patch.breaks[2]
    assert np.abs(found[:, None] - at).min(axis=0).max() <= 1e-12
    assert np.diff(found).min() > 1e-3
    assert len(found) - 1 >= spans


def test_a_kink_stays_as_rough_as_the_shape_made_it():
    patch = meshed_block(knots=[[0.5], [], []], spans=4, degrees=(3, 3, 3))
    values, counts = np.unique(patch.knots[0], return_counts=True)
    assert values.tolist() == [0, 0.25, 0.5, 0.75, 1]
    assert counts.tolist() == [4, 1, 3, 1, 4]


def test_a_twisted_ring_gets_spans_alike_in_both_senses():
    model = ring(0, 120, 240, twist=180)
    found = meshed(list(model.patches.values()), model.glued, Mesh(spans=(3, 2, 5)), (2, 2, 2), {})
    assert_conforming(found, model.glued)
    for before, after in zip(model.patches.values(), found, strict=True):
        assert_same_map(after, before)
        assert after.degrees == (2, 2, 2)
        np.testing.assert_allclose(after.breaks[0], 1 - after.breaks[0][::-1], rtol=0, atol=1e-12)
