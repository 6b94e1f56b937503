from math import asin, cos, pi, radians, sin, sqrt, tan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from geom2iga.errors import CaseError, GeometryError
from geom2iga.glue import conformed, find_glued
from geom2iga.model import Model
from geom2iga.patch import evaluate, surface
from geom2iga.shapes.case import Cylinder, DomedBlock, Extrusion, Hemisphere, Pipe, Revolution, Sphere
from geom2iga.shapes.primitives import (
    cylinder,
    domed_block,
    extrusion,
    hemisphere,
    pipe,
    placed,
    revolution,
    sphere,
)
from geom2iga.tables import Table, checked

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
ANGLES = st.floats(0.5, 359.5) | st.sampled_from([90.0, 135.0, 180.0, 270.0, 360.0])
LENGTHS = st.floats(0.1, 10)


def grid(count, directions):
    axis = np.linspace(0, 1, count)
    return np.stack(np.meshgrid(*[axis] * directions, indexing="ij"), axis=-1).reshape(-1, directions)


def jacobians(patch, xi):
    return np.linalg.det(evaluate(patch, xi, 1)[1])


def volume(part, points=14):
    """Volume by a Gauss rule on every span."""
    total = 0.0
    for patch in part.patches:
        axes, weights = [], []
        for at in patch.breaks:
            x, w = np.polynomial.legendre.leggauss(points)
            axes.append(((at[:-1, None] + at[1:, None]) / 2 + np.diff(at)[:, None] / 2 * x).ravel())
            weights.append((np.diff(at)[:, None] / 2 * w).ravel())
        xi = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        total += np.einsum("i,j,k->ijk", *weights).ravel() @ jacobians(patch, xi)
    return total


def face_points(part, name, count=9):
    by_name = {patch.name: patch for patch in part.patches}
    faces = [surface(by_name[face.patch], face) for face in part.faces[name]]
    return np.concatenate([evaluate(face, grid(count, 2))[0] for face in faces])


def assert_sound(part, glued, named):
    """The Jacobian is positive up to the boundary, faces meet as counted, and each outer face has one name."""
    for patch in part.patches:
        assert jacobians(patch, grid(9, 3)).min() > 0, patch.name
    pairs = find_glued(part.patches)
    assert len(pairs) == glued
    inner = {face for pair in pairs for face in (pair.first, pair.second)}
    outer = [face for faces in part.faces.values() for face in faces]
    assert set(part.faces) == set(named)
    assert len(set(outer)) == len(outer) == 6 * len(part.patches) - 2 * glued
    assert not inner & set(outer)
    patches = {patch.name: patch for patch in conformed(part.patches, pairs)}
    Model(patches, {"body": tuple(patches)}, part.faces, pairs)  # insists on equal homogeneous control points


@given(LENGTHS, LENGTHS, ANGLES)
@settings(max_examples=12)
def test_a_cylinder_of_any_angle_is_exact(radius, height, angle):
    part = cylinder("rod", radius, height, angle)
    cuts = () if angle == 360 else ("start", "end")
    cores = 0 if angle == 360 else (1 if angle <= 135 else 2 if angle <= 270 else 3)
    assert_sound(part, 8 if angle == 360 else 5 * cores - 2, ("side", "bottom", "top", *cuts))
    assert len(part.patches) == (5 if angle == 360 else 3 * cores)
    assert volume(part) == pytest.approx(radians(angle) / 2 * radius**2 * height, rel=1e-11)
    assert abs(np.linalg.norm(face_points(part, "side")[:, :2], axis=1) - radius).max() <= 1e-14 * radius
    assert abs(face_points(part, "top")[:, 2] - height).max() <= 1e-14 * height
    assert abs(face_points(part, "bottom")[:, 2]).max() == 0
    for cut, at in zip(cuts, (0, radians(angle)), strict=False):
        assert abs(face_points(part, cut)[:, :2] @ (-sin(at), cos(at))).max() <= 1e-14 * radius


@given(LENGTHS, st.floats(0.05, 0.95), LENGTHS, ANGLES)
@settings(max_examples=12)
def test_a_pipe_of_any_angle_is_exact(outer, share, height, angle):
    inner = share * outer
    part = pipe("pipe", inner, outer, height, angle)
    count = int(np.ceil(angle / 90))
    cuts = () if angle == 360 else ("start", "end")
    assert_sound(part, 4 if angle == 360 else count - 1, ("inner", "outer", "bottom", "top", *cuts))
    assert len(part.patches) == count
    assert volume(part) == pytest.approx(radians(angle) / 2 * (outer**2 - inner**2) * height, rel=1e-11)
    for name, radius in (("inner", inner), ("outer", outer)):
        assert abs(np.linalg.norm(face_points(part, name)[:, :2], axis=1) - radius).max() <= 1e-14 * outer


def test_a_quarter_annulus_is_one_patch_of_circles_to_1e_15():
    part = pipe("ring", 1.0, 2.0, 1.0, 90.0)
    (patch,) = part.patches
    assert patch.degrees == (1, 2, 1)
    for name, radius in (("inner", 1), ("outer", 2)):
        assert abs(np.linalg.norm(face_points(part, name, 33)[:, :2], axis=1) - radius).max() <= 1e-15 * radius


def test_a_ball_of_seven_blocks_has_the_volume_of_the_ball():
    part = sphere("ball", 1.0)
    assert len(part.patches) == 7
    assert_sound(part, 18, ["outside"])
    assert volume(part) == pytest.approx(4 * pi / 3, rel=1e-11)
    assert abs(np.linalg.norm(face_points(part, "outside", 33), axis=1) - 1).max() <= 1e-15


@given(LENGTHS, st.floats(0.1, 5) | st.just(0.0), st.sampled_from(["up", "down"]))
@settings(max_examples=4)
def test_a_hemisphere_is_exact_with_and_without_a_shank(radius, height, flat):
    part = hemisphere("punch", radius, height, flat)
    sign = 1 if flat == "up" else -1
    assert len(part.patches) == (11 if height else 6)
    assert_sound(part, 26 if height else 13, ["outside", "flat", *(["side"] if height else [])])
    assert volume(part) == pytest.approx(2 * pi / 3 * radius**3 + pi * radius**2 * height, rel=1e-11)
    dome = face_points(part, "outside")
    assert abs(np.linalg.norm(dome, axis=1) - radius).max() <= 1e-14 * radius
    assert (sign * dome[:, 2]).max() <= 1e-14 * radius
    assert abs(face_points(part, "flat")[:, 2] - sign * height).max() <= 1e-14 * (radius + height)
    if height:
        assert abs(np.linalg.norm(face_points(part, "side")[:, :2], axis=1) - radius).max() <= 1e-14 * radius


def depression(kind, radius, x, y):
    """Height of a domed bottom above its lowest point, (q,)."""
    if kind == "paraboloid":
        return (x**2 + y**2) / (2 * radius)
    square = x**2 + (y**2 if kind == "sphere" else 0)
    return square / (radius + np.sqrt(radius**2 - square))


@given(st.sampled_from(["sphere", "cylinder", "paraboloid"]), st.floats(0.1, 0.95), st.floats(0.05, 1.5), LENGTHS)
def test_a_domed_block_lies_on_its_dome_between_plane_sides(kind, share, slant, radius):
    width, depth = 2 * share * radius * cos(slant), 2 * share * radius * sin(slant)
    part = domed_block("punch", (width, depth, 2 * radius), radius, kind)
    assert_sound(part, 0, ("left", "right", "front", "back", "bottom", "top"))
    x, y, z = face_points(part, "bottom").T
    assert abs(z - depression(kind, radius, x, y)).max() <= 1e-14 * radius / sqrt(1 - share**2)
    assert abs(np.linalg.norm(face_points(part, "bottom") - (0, 0, radius), axis=1) - radius).max() <= (
        1e-14 * radius if kind == "sphere" else np.inf
    )
    for name, axis, at in (("left", 0, -width), ("right", 0, width), ("front", 1, -depth), ("back", 1, depth)):
        assert abs(face_points(part, name)[:, axis] - at / 2).max() <= 1e-14 * radius
    assert abs(face_points(part, "top")[:, 2] - 2 * radius).max() <= 1e-14 * radius


@given(st.sampled_from(["sphere", "cylinder", "paraboloid"]), st.floats(0.1, 0.95), st.floats(0.05, 1.5), LENGTHS)
def test_four_quarters_of_a_domed_block_are_the_whole(kind, share, slant, radius):
    width, depth = share * radius * cos(slant), share * radius * sin(slant)
    part = domed_block("punch", (width, depth, 2 * radius), radius, kind, quarter=True)
    assert_sound(part, 0, ("left", "right", "front", "back", "bottom", "top"))
    whole = domed_block("punch", (2 * width, 2 * depth, 2 * radius), radius, kind)
    assert volume(part) == pytest.approx(volume(whole) / 4, rel=1e-11)
    x, y, z = face_points(part, "bottom").T
    assert abs(z - depression(kind, radius, x, y)).max() <= 1e-14 * radius / sqrt(1 - share**2)
    for name, axis, at in (("left", 0, 0.0), ("right", 0, width), ("front", 1, 0.0), ("back", 1, depth)):
        assert abs(face_points(part, name)[:, axis] - at).max() <= 1e-14 * radius


def under_circle(radius, half):
    """Area between a circle of a radius and the line through its lowest point, between -half and half."""
    return 2 * half * radius - half * sqrt(radius**2 - half**2) - radius**2 * asin(half / radius)


def test_domed_blocks_have_the_volumes_of_closed_forms():
    width, depth, height, radius = 1.0, 2.0, 2.0, 3.0
    missing = {
        "paraboloid": width * depth * (width**2 + depth**2) / 24 / radius,
        "cylinder": depth * under_circle(radius, width / 2),
        "sphere": quad(  # the area above a strip of the sphere is that under a smaller circle, lifted
            lambda x: under_circle(sqrt(radius**2 - x**2), depth / 2) + depth * depression("sphere", radius, x, 0.0),
            -width / 2,
            width / 2,
            epsabs=1e-14,
        )[0],
    }
    for kind, gap in missing.items():
        part = domed_block("punch", (width, depth, height), radius, kind)
        assert volume(part) == pytest.approx(width * depth * height - gap, rel=1e-11), kind


@given(st.floats(-2, 2), st.floats(-2, 2), LENGTHS, st.floats(0.05, 0.4))
def test_an_extruded_profile_has_sides_that_are_arcs(x, y, z, bulge):
    part = extrusion("bar", SQUARE, (x, y, z), {"front": (0.5, -bulge), "back": (0.5, 1 - bulge)})
    assert_sound(part, 0, ("left", "right", "front", "back", "bottom", "top"))
    assert volume(part) == pytest.approx(z, rel=1e-11)
    radius = (0.25 + bulge**2) / (2 * bulge)
    points = face_points(part, "front")
    plane = points[:, :2] - points[:, 2:] / z * (x, y)
    assert abs(np.linalg.norm(plane - (0.5, radius - bulge), axis=1) - radius).max() <= 1e-14 * radius
    assert abs(face_points(part, "top")[:, 2] - z).max() <= 1e-14 * z


def test_a_side_that_bulges_adds_the_segment_of_its_circle():
    part = extrusion("bar", SQUARE, (0, 0, 1), {"right": (1 + tan(pi / 8) / 2, 0.5)})
    assert volume(part) == pytest.approx(1 + (pi / 2 - 1) / 4, rel=1e-11)  # a quarter of a circle over a chord of 1


@given(ANGLES, st.floats(0.05, 0.3), st.floats(0.5, 5))
@settings(max_examples=10)
def test_a_revolved_profile_obeys_the_theorem_of_pappus(angle, bulge, distance):
    corners = [(distance, 0), (distance + 1, 0), (distance + 1, 1), (distance, 1)]
    through = {"bottom": (distance + 0.5, -bulge), "top": (distance + 0.5, 1 + bulge)}  # symmetric about the middle
    part = revolution("ring", corners, through, angle)
    radius = (0.25 + bulge**2) / (2 * bulge)
    half = asin(0.5 / radius)
    area = 1 + radius**2 * (2 * half - sin(2 * half))
    assert volume(part) == pytest.approx(radians(angle) * (distance + 0.5) * area, rel=1e-11)
    count = int(np.ceil(angle / 90))
    cuts = () if angle == 360 else ("start", "end")
    assert_sound(part, 4 if angle == 360 else count - 1, ("inner", "outer", "bottom", "top", *cuts))


@given(st.floats(-180, 180), st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_a_placed_part_is_moved_to_its_origin_and_turned_about_its_axis(angle, seed):
    random = np.random.default_rng(seed)
    origin, axis, about = random.normal(size=(3, 3))
    turn = Rotation.from_rotvec(radians(angle) * axis / np.linalg.norm(axis))
    part = cylinder("rod", 1, 2, 100)
    for centre, given_about in ((origin, None), (about, about)):
        moved = placed(part, origin, axis, angle, given_about)
        for patch, before in zip(moved.patches, part.patches, strict=True):
            expected = turn.apply(before.control_points.reshape(-1, 3) + origin - centre) + centre
            np.testing.assert_allclose(patch.control_points.reshape(-1, 3), expected, rtol=0, atol=1e-14)
        assert moved.faces == part.faces


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: pipe("p", 2, 1, 1), "inner radius 2 of a pipe must be less than its outer radius 1"),
        (lambda: pipe("p", 1, 2, 1, 361), "at most 360 degrees, found 361"),
        (lambda: cylinder("c", 1, 1, 0), "more than 0 and at most 360 degrees, found 0"),
        (lambda: pipe("p", 1, 2, 1, 360 * (1 - 1e-15)), r"an angle of 359\.9999999\d+ degrees leaves less than 0\.001"),
        (lambda: domed_block("d", (2, 2, 3), 1), r"reaches 1\.41421 to the side, its sphere only 1"),
        (lambda: domed_block("d", (2, 1, 3), 1, "cylinder"), "reaches 1 to the side, its cylinder only 1"),
        (lambda: domed_block("d", (1, 1, 0.1), 1), r"the height 0\.1 of a block must be more than the 0\.292893"),
        (lambda: extrusion("e", SQUARE[::-1], (0, 0, 1)), "run clockwise"),
        (
            lambda: extrusion("e", [(0, 0), (1, 0), (0.2, 0.2), (0, 1)], (0, 0, 1)),
            r"folds or is flat near \(0\.2, 0\.2",
        ),
        (lambda: extrusion("e", SQUARE, (0, 0, 1), {"front": (0.5, 0.9), "back": (0.5, 0.1)}), "arc of 243"),
        (lambda: extrusion("e", SQUARE, (0, 0, 1), {"front": (0.5, 0.3), "left": (0.3, 0.5)}), "folds or is flat"),
        (lambda: extrusion("e", SQUARE, (0, 0, 1), {"front": (0.5, 0)}), "goes straight through"),
        (lambda: extrusion("e", SQUARE, (0, 0, 1), {"frnt": (0.5, 0.1)}), 'no side "frnt"; did you mean "front"'),
        (lambda: extrusion("e", SQUARE, (1, 0, 0)), "the z of its vector must be positive, found 0"),
        (lambda: revolution("r", SQUARE), "must keep off the axis, found 0"),
    ],
)
def test_what_cannot_be_built_says_why(make, message):
    with pytest.raises(GeometryError, match=message):
        make()


class Bodies(Table):
    pipe: tuple[Pipe, ...] = ()


class Case(Table):
    geometry: Bodies


def test_a_wrong_table_is_named_with_its_key():
    with pytest.raises(CaseError, match=r"geometry\.pipe\[0\]: the inner radius 2 of a pipe must be less"):
        checked({"geometry": {"pipe": [{"name": "p", "inner": 2.0, "outer": 1.0, "height": 1.0}]}}, Case)


def test_tables_build_the_parts_they_describe():
    common = {"name": "body", "origin": (1, 2, 3), "rotate": {"axis": (0, 1, 0), "angle": 90.0}}
    tables = [
        (Cylinder(**common, radius=1.0, height=2.0, angle=90.0), cylinder("body", 1, 2, 90)),
        (Pipe(**common, inner=1.0, outer=2.0, height=2.0), pipe("body", 1, 2, 2)),
        (Sphere(**common, radius=2.0), sphere("body", 2)),
        (Hemisphere(**common, radius=2.0, height=1.0, flat="down"), hemisphere("body", 2, 1, "down")),
        (DomedBlock(**common, size=(1, 1, 1), radius=3.0), domed_block("body", (1, 1, 1), 3)),
        (
            DomedBlock(**common, size=(1, 1, 1), radius=3.0, quarter=True),
            domed_block("body", (1, 1, 1), 3, quarter=True),
        ),
        (Extrusion(**common, points=SQUARE, vector=(0, 0, 1)), extrusion("body", SQUARE, (0, 0, 1))),
        (Revolution(**common, points=[(1, 0), (2, 0), (2, 1), (1, 1)]), pipe("body", 1, 2, 1)),
    ]
    for table, shape in tables:
        expected = placed(shape, (1, 2, 3), (0, 1, 0), 90.0)
        found = table.part()
        assert found.faces == expected.faces
        for patch, other in zip(found.patches, expected.patches, strict=True):
            np.testing.assert_array_equal(patch.control_points, other.control_points)
    lying = tables[0][0].part()  # along x from the origin
    assert face_points(lying, "top")[:, 0] == pytest.approx(3.0, abs=1e-14)
