from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geom2iga.build import build_from_gmsh
from geom2iga.cad.blocks import block_spline, check_block, labellings, signed_volume
from geom2iga.cad.faces import convert_faces
from geom2iga.cad.topology import Solid, merged
from geom2iga.errors import GeometryError
from geom2iga.model import SIDES
from geom2iga.spline import points_of
from tests.cases import UNIT
from tests.geom2iga.cad.models import MODELS
from tests.geom2iga.cad.opened import opened, topology_of
from tests.geom2iga.cad.shapes import level, polyhedron
from tests.strategies import SEEDS

BOX = topology_of(MODELS["box"].make)
BOX_FACES = convert_faces(BOX, 1e-6)


def positions(topology, way):
    """Corners (2, 2, 2, 3)."""
    return np.array([topology.vertices[tag] for tag in way.corners.ravel().tolist()]).reshape(2, 2, 2, 3)


def handedness(topology, way):
    """Of the three edges at the first corner."""
    corners = positions(topology, way)
    return np.sign(np.linalg.det([corners[at] - corners[0, 0, 0] for at in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]))


@pytest.mark.parametrize("name", ["box", "wedge", "pipe_quarter_cut_obliquely", "six_curved_faces"])
def test_three_directions_run_through_a_hexahedron_in_48_ways_half_of_them_right_handed(name):
    found = topology_of(MODELS[name].make)
    topology = merged(found, found.solids)  # without the points that curves were made of
    (solid,) = topology.solids.values()
    ways = list(labellings(topology, solid))
    assert len({tuple(way.corners.ravel().tolist()) for way in ways}) == 48
    assert sorted(handedness(topology, way) for way in ways) == [-1] * 24 + [1] * 24
    for way in ways:
        assert sorted(way.corners.ravel().tolist()) == sorted(topology.vertices)
        assert sorted(way.faces.ravel().tolist()) == sorted(solid.faces)
        for (axis, side), tag in np.ndenumerate(way.faces):
            ends = {end for edge in topology.faces[tag].edges for end in topology.edges[edge].ends}
            assert set(np.take(way.corners, side, axis=axis).ravel().tolist()) == ends


@given(SEEDS, st.booleans())
def test_the_directions_point_along_the_axes_asked_for_as_nearly_as_may_be(seed, mirrored):
    """Where those are left-handed, one of them is given up."""
    axes = Rotation.random(random_state=seed).as_matrix() * (-1 if mirrored else 1)
    (solid,) = BOX.solids.values()
    spline, _ = block_spline(BOX, solid, BOX_FACES, axes)
    assert signed_volume(spline) == pytest.approx(6, rel=1e-12)
    corners = points_of(spline.corners)
    found = np.array([corners[at] - corners[0, 0, 0] for at in ((1, 0, 0), (0, 1, 0), (0, 0, 1))])
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    if not mirrored:
        turns = [Rotation.from_matrix(m).as_matrix() for m in Rotation.create_group("O").as_matrix()]
        best = max(np.sum(turn * axes) for turn in turns)
        assert np.sum(found * axes) == pytest.approx(best, abs=1e-8)


@given(SEEDS)
def test_the_faces_of_a_block_lie_where_it_says(seed):
    (solid,) = BOX.solids.values()
    spline, around = block_spline(BOX, solid, BOX_FACES, Rotation.random(random_state=seed).as_matrix())
    for (axis, side), tag in np.ndenumerate(around):
        found = points_of(spline.end(axis, side).corners).mean(axis=(0, 1))
        ends = {end for edge in BOX.faces[tag].edges for end in BOX.edges[edge].ends}
        np.testing.assert_allclose(found, np.mean([BOX.vertices[end] for end in ends], axis=0), rtol=0, atol=1e-15 * 10)


@pytest.mark.parametrize("angle", [0, 30, 60, 90, 135, 180, 300])
def test_left_is_left_and_top_is_top_however_a_box_was_turned(angle):
    def make(occ):
        occ.rotate([(3, occ.addBox(-1, -1.5, -2, 2, 3, 4))], 0, 0, 0, 0, 0, 1, np.radians(angle))

    with opened(make):
        model = build_from_gmsh(name="box")
    axes = np.repeat(np.eye(3), 2, axis=0) * np.tile([-1, 1], 3)[:, None]
    for side, axis in zip(SIDES, axes, strict=True):
        (face,) = model.faces(f"box/{side}")
        middle = model.surface(face).control_points.mean(axis=(0, 1))
        assert middle @ axis / np.linalg.norm(middle) > np.cos(np.radians(46))


@given(st.floats(0.1, 4), st.floats(0.1, 2), st.floats(0.1, 3))
def test_a_wedge_with_a_narrow_top_becomes_a_patch(long, narrow, height):
    """gmsh's wedge: x is `long` wide at y = 0 and `narrow` at y = height."""
    with opened(lambda occ: occ.addWedge(0, 0, 0, long, height, 1, ltx=narrow)):
        model = build_from_gmsh(name="wedge", degree=2)
    expected = UNIT * [1, height, 1]
    expected[..., 0] *= np.array([long, narrow])[None, :, None]
    found = model.patches["wedge"].control_points[::2, ::2, ::2]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14 * 4)
    assert model.certificates["wedge"].volume == pytest.approx((long + narrow) / 2 * height, rel=1e-12)


@given(SEEDS)
def test_any_convex_hexahedron_becomes_a_right_handed_patch(seed):
    """A projective image of the unit cube: its faces stay plane, no two stay parallel."""
    random = np.random.default_rng(seed)
    linear, tilt = np.eye(3) + random.uniform(-0.2, 0.2, (3, 3)), random.uniform(-0.2, 0.2, 3)
    expected = UNIT @ linear.T / (1 + UNIT @ tilt)[..., None]
    around = [(0, 0), (1, 0), (1, 1), (0, 1)]
    with opened(lambda occ: polyhedron(occ, [expected[i, j, k] for k in range(2) for i, j in around])):
        model = build_from_gmsh(name="body")
    np.testing.assert_allclose(model.patches["body"].control_points, expected, rtol=0, atol=1e-14 * 4)
    assert model.certificates["body"].jacobian.status == "proven"


# What is no block


def pillow(splits):
    """A sphere in squares: two back to back, of which some are split by a new corner between opposite ones."""
    faces, corners = [(0, 1, 2, 3), (0, 3, 2, 1)], 4
    for number in splits:
        a, b, c, d = faces.pop(number)
        faces += [(a, b, c, corners), (a, corners, c, d)]
        corners += 1
    edges, loops = {}, {}
    for tag, face in enumerate(faces, 1):
        around = [tuple(sorted(pair)) for pair in zip(face, (*face[1:], face[0]), strict=True)]
        loops[tag] = tuple(edges.setdefault(pair, len(edges) + 1) for pair in around)
    return SimpleNamespace(
        vertices=dict.fromkeys(range(corners), np.zeros(3)),
        edges={tag: SimpleNamespace(ends=pair) for pair, tag in edges.items()},
        faces={tag: SimpleNamespace(edges=loop) for tag, loop in loops.items()},
    )


@pytest.mark.parametrize("splits", [(0, 0, 0, 0), (0, 1, 2, 3), (1, 1, 0, 0), (0, 2, 1, 3)])
def test_six_four_sided_faces_are_not_always_those_of_a_cube(splits):
    topology = pillow(splits)
    solid = Solid(1, (tuple(topology.faces),))
    assert len(topology.faces) == 6
    with pytest.raises(GeometryError, match=r"volume 1: its six faces do not bound a hexahedron: split it"):
        list(labellings(topology, solid))


def test_the_seam_of_a_cylinder_is_named_where_it_makes_a_seventh_face():
    def make(occ):
        roll = occ.addCylinder(0, -5, 8, 0, 10, 0, 8)
        occ.rotate([(3, roll)], 0, 0, 8, 0, 1, 0, np.pi)
        occ.intersect([(3, occ.addBox(-1, -1, -1, 2, 2, 4))], [(3, roll)])

    topology = topology_of(make)
    (solid,) = topology.solids.values()
    with pytest.raises(GeometryError, match=r"7 faces.*faces (\d+) and (\d+) lie on one cylinder: remove its seam"):
        check_block(topology, solid)


def chamfered(occ):
    """A box without one edge."""
    profile = [(0, 0), (2, 0), (2, 1.5), (1.5, 2), (0, 2)]
    sides = [tuple(range(5)), tuple(range(5, 10)), *((k, (k + 1) % 5, (k + 1) % 5 + 5, k + 5) for k in range(5))]
    polyhedron(occ, [*level(profile, 0), *level(profile, 1)], sides)


def test_two_faces_on_parallel_planes_are_no_seam():
    topology = topology_of(chamfered)
    (solid,) = topology.solids.values()
    with pytest.raises(GeometryError, match=r"has 7 faces, a block has 6: split it \(occ\.fragment\)$"):
        check_block(topology, solid)
