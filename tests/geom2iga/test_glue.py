from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geom2iga.errors import GeometryError
from geom2iga.glue import MEETS, Edge, conformed, find_glued, normalised, parallel_edges
from geom2iga.model import Face, Glued, Model
from geom2iga.patch import Patch, elevated, evaluate, refined, surface
from tests.cases import block_patch
from tests.geom2iga.exchange.scrambled import CORNER, CUBE, RING, cell, ring, scrambled_model, turned_about, turnings
from tests.oracles import assert_same_map
from tests.strategies import SEEDS, open_knot_vectors

XI = np.array([[0.0, 0.0], [0.1, 0.7], [0.45, 0.2], [1.0, 0.35], [0.8, 1.0]])
EVERY_WAY = list(product(turnings(), repeat=2))


def partner(xi, orientation):
    """Where points (q, 2) of a first face lie on the second one."""
    flips = np.array([bool(orientation & 2), bool(orientation & 4)])
    xi = np.where(flips, 1 - xi, xi)
    return xi[:, ::-1] if orientation & 1 else xi


def assert_one(patches, pair):
    """Two glued faces are the same surface, point by point."""
    by_name = {patch.name: patch for patch in patches}
    first, second = (surface(by_name[face.patch], face) for face in (pair.first, pair.second))
    there = evaluate(second, partner(XI, pair.orientation))[0]
    np.testing.assert_allclose(evaluate(first, XI)[0], there, rtol=0, atol=1e-12)


def pair_of(first, second):
    """Two bent cells side by side, their directions chosen in one of 24 ways each."""
    return turned_about(cell("a", (0, 0, 0)), first), turned_about(cell("b", (1, 0, 0)), second)


def two(**second):
    """Two blocks one upon the other; keys of the upper one."""
    return block_patch("lower"), block_patch("upper", **({"origin": (0, 0, 1)} | second))


def test_two_patches_are_glued_in_each_of_the_8_orientations():
    random, seen = np.random.default_rng(0), set()
    for number in random.permutation(len(EVERY_WAY))[:80]:
        patches = pair_of(*EVERY_WAY[number])
        (pair,) = find_glued(patches)
        assert {pair.first.patch, pair.second.patch} == {"a", "b"}
        assert_one(patches, pair)
        Model({p.name: p for p in patches}, {"both": ("a", "b")}, {}, [pair])  # checks every control point
        seen.add((pair.orientation, pair.first.side, pair.second.side))
    assert {orientation for orientation, _, _ in seen} == set(range(8))


@given(SEEDS, st.sampled_from([(RING, 4), (CUBE, 12)]))
def test_every_face_inside_a_body_is_glued_once(seed, body):
    cells, count = body
    model = scrambled_model(seed, cells)
    assert len(model.glued) == count
    inside = [face for pair in model.glued for face in (pair.first, pair.second)]
    assert len(set(inside)) == 2 * count
    for pair in model.glued:
        assert_one(model.patches.values(), pair)


def roughened(patch, random):
    """The same map with degrees and knots of its own."""
    patch = elevated(patch, [p + int(random.integers(0, 2)) for p in patch.degrees])
    return refined(patch, knots=[random.uniform(0.1, 0.9, random.integers(0, 3)) for _ in range(3)])


@given(SEEDS, st.sampled_from([CORNER, RING, CUBE]))
@settings(max_examples=10)
def test_patches_of_different_degrees_and_knots_are_glued_and_made_to_conform(seed, cells):
    random, model = np.random.default_rng(seed), scrambled_model(seed, cells)
    rough = [roughened(model.patches[name], random) for name in model.bodies["body"]]
    glued = find_glued(rough)
    assert len(glued) == {3: 2, 4: 4, 8: 12}[len(rough)]
    found = conformed(rough, glued)
    for before, after in zip(rough, found, strict=True):
        assert after.name == before.name
        assert_same_map(after, before)
    Model({p.name: p for p in found}, {"body": tuple(p.name for p in found)}, {}, glued)


@given(SEEDS)
def test_patches_that_conform_stay_as_they_are(seed):
    model = scrambled_model(seed)
    patches = tuple(model.patches.values())
    for before, after in zip(patches, conformed(patches, model.glued), strict=True):
        assert after.degrees == before.degrees
        for one, other in zip(after.knots, before.knots, strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-15)
        np.testing.assert_allclose(after.control_points, before.control_points, rtol=0, atol=1e-14)


def test_a_direction_that_no_neighbour_shares_keeps_its_degree_and_knots():
    lower, upper = two()
    upper = refined(elevated(upper, (1, 1, 3)), knots=[[], [0.5], [0.25]])
    found = conformed((lower, upper), find_glued((lower, upper)))
    assert [patch.degrees for patch in found] == [(1, 1, 1), (1, 1, 3)]
    assert [at.tolist() for at in found[0].breaks] == [[0, 1], [0, 0.5, 1], [0, 1]]


def bulged(patch, at, by):
    """A patch of degree 2 whose face in the middle, at one end along z, is moved up."""
    points = elevated(patch, (2, 2, 1)).control_points.copy()
    points[1, 1, at, 2] += by
    return replace(elevated(patch, (2, 2, 1)), control_points=points)


def test_faces_with_the_same_corners_and_edges_but_another_middle_are_not_glued():
    lower, upper = two()
    assert find_glued((lower, bulged(upper, 0, 0.1))) == ()
    assert find_glued((bulged(lower, 1, 0.1), upper)) == ()
    assert len(find_glued((bulged(lower, 1, 0.1), bulged(upper, 0, 0.1)))) == 1


def test_faces_that_are_passed_at_another_speed_are_not_glued():
    """They are one set of points, but their control points cannot be shared."""
    lower, upper = two()
    points = elevated(upper, (2, 1, 1)).control_points.copy()
    points[1, ..., 0] += 0.1
    assert find_glued((lower, replace(elevated(upper, (2, 1, 1)), control_points=points))) == ()


def test_faces_that_meet_in_part_are_not_glued():
    assert find_glued(two(size=(0.5, 1, 1))) == ()
    assert find_glued(two(origin=(0.5, 0, 1))) == ()
    assert find_glued(two(origin=(1, 0, 1))) == ()  # they share an edge


@pytest.mark.parametrize(("share", "count"), [(0.2, 1), (5, 0)])
def test_faces_are_one_where_they_lie_nearer_than_cad_programs_can_tell(share, count):
    """In sizes of the body, which is 2 here."""
    assert len(find_glued(two(origin=(0, 0, 1 + share * MEETS * 2)))) == count


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_what_is_glued_does_not_depend_on_the_unit_of_length(size):
    patches = [replace(p, control_points=size * p.control_points) for p in two()]
    assert find_glued(patches) == (Glued(Face("lower", 2, 1), Face("upper", 2, 0), 0),)


def test_a_face_is_glued_to_one_other_only():
    patches = (*two(), block_patch("third", origin=(0, 0, 1)))
    found = find_glued(patches)
    inside = [face for pair in found for face in (pair.first, pair.second)]
    assert len(set(inside)) == len(inside)
    assert found[0] == Glued(Face("lower", 2, 1), Face("upper", 2, 0), 0)


def test_a_patch_whose_ends_meet_is_glued_to_itself():
    """A whole ring of one patch, bent from a bar."""
    angles = np.radians([0, 45, 90, 135, 180, 225, 270, 315, 360])
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.where(np.arange(9) % 2, 2**0.5, 1)[:, None]
    points = np.zeros((2, 9, 2, 3))
    for i, radius in enumerate((1.0, 2.0)):
        points[i, :, :, :2] = radius * circle[:, None]
    points[:, :, 1, 2] = 1.0
    weights = np.broadcast_to(np.where(np.arange(9) % 2, 0.5**0.5, 1)[None, :, None], (2, 9, 2))
    knots = np.array([0, 0, 0, 0.25, 0.25, 0.5, 0.5, 0.75, 0.75, 1, 1, 1])
    bar = Patch("ring", (1, 2, 1), ([0, 0, 1, 1], knots, [0, 0, 1, 1]), points, weights)
    assert find_glued((bar,)) == (Glued(Face("ring", 1, 0), Face("ring", 1, 1), 0),)


def test_nothing_is_glued_to_a_single_block():
    assert find_glued((block_patch(),)) == ()


def test_classes_of_parallel_directions_hold_every_direction_of_every_patch():
    model = scrambled_model(3, CUBE)
    patches = list(model.patches.values())
    classes = parallel_edges(patches, model.glued)
    places = [(edge.patch, edge.axis) for edges in classes for edge in edges]
    assert sorted(places) == [(patch, axis) for patch in range(len(patches)) for axis in range(3)]
    assert sorted(map(len, classes)) == [1, 1, 1, *[4] * 6]  # three of the body beside; two layers of 4 per direction


def test_a_class_says_in_which_sense_its_directions_run():
    model = scrambled_model(5, CUBE)
    patches = list(model.patches.values())
    for edges in parallel_edges(patches, model.glued):
        ways = []
        for edge in edges:
            ends = np.full((2, 3), 0.5)
            ends[:, edge.axis] = (1, 0) if edge.reversed else (0, 1)
            ways.append(np.diff(evaluate(patches[edge.patch], ends)[0], axis=0)[0])
        assert np.min(ways @ ways[0]) > 0


def test_around_a_plain_ring_the_directions_keep_their_sense():
    model = ring(0, 120, 240)
    classes = parallel_edges(list(model.patches.values()), model.glued)
    assert sorted(len(edges) for edges in classes) == [1, 1, 1, 3, 3]
    for edges in classes:
        assert len({edge.reversed for edge in edges}) == 1


def test_around_a_twisted_ring_the_directions_of_the_cross_section_run_in_both_senses():
    model = ring(0, 120, 240, twist=180)
    classes = parallel_edges(list(model.patches.values()), model.glued)
    assert sorted(len(edges) for edges in classes) == [1, 1, 1, 6, 6]
    both = [edges for edges in classes if len(edges) == 6]
    for edges in both:
        assert {Edge(edge.patch, edge.axis, not edge.reversed) for edge in edges} == set(edges)


def test_the_knots_of_a_twisted_ring_become_symmetric():
    model = ring(0, 120, 240, twist=180)
    patches = list(model.patches.values())
    patches[1] = refined(patches[1], knots=[[0.2], [], [0.4]])
    found = conformed(patches, model.glued)
    for patch in found:
        assert patch.breaks[0] == pytest.approx([0, 0.2, 0.5, 0.8, 1], abs=1e-15)
        assert patch.breaks[2] == pytest.approx([0, 0.4, 0.5, 0.6, 1], abs=1e-15)
    for before, after in zip(patches, found, strict=True):
        assert_same_map(after, before)
    Model({p.name: p for p in found}, model.bodies, {}, model.glued)


@given(st.tuples(*[open_knot_vectors()] * 3), SEEDS)
def test_knots_from_0_to_1_are_the_same_map_at_another_speed(splines, seed):
    knots, degrees = zip(*splines, strict=True)
    shape = tuple(len(k) - p - 1 for k, p in splines)
    random = np.random.default_rng(seed)
    patch = Patch("any", degrees, knots, random.normal(size=(*shape, 3)), random.uniform(0.5, 2, shape))
    found = normalised(patch)
    assert all((k[0], k[-1]) == (0, 1) for k in found.knots)
    xi = random.random((9, 3))
    low, high = (np.array([k[end] for k in knots]) for end in (0, -1))
    np.testing.assert_allclose(evaluate(found, xi)[0], evaluate(patch, low + xi * (high - low))[0], rtol=0, atol=1e-9)


def test_a_common_factor_of_all_weights_of_a_patch_does_not_part_it_from_its_neighbour():
    lower, upper = two()
    patches = lower, replace(upper, weights=3 * upper.weights)
    glued = find_glued(patches)
    Model({p.name: p for p in conformed(patches, glued)}, {"both": ("lower", "upper")}, {}, glued)


@pytest.mark.parametrize("thickness", [1e-12, 1e-9, 1e-7, 1e-3])
def test_a_thin_plate_is_not_glued_to_itself(thickness):
    assert find_glued([block_patch(size=(1, thickness, 1))]) == ()


def test_thin_patches_of_a_body_of_several_are_refused_since_nobody_knows_which_faces_touch():
    plates = [block_patch(f"plate {n}", (0, n * 1e-8, 0), (1, 1e-8, 1)) for n in range(3)]
    with pytest.raises(GeometryError, match='"plate 0" is 1e-08 thick'):
        find_glued(plates)
