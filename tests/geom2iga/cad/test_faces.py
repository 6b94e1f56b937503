from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from geom2iga.cad.faces import convert_faces, distance_from, find_quad
from geom2iga.cad.topology import merged
from geom2iga.errors import GeometryError
from geom2iga.spline import points_of
from tests.geom2iga.cad.models import MODELS
from tests.geom2iga.cad.opened import topology_of

AT = np.linspace(0, 1, 13)
NAMES = (
    "hexahedron_with_ruled_faces",
    "cone_in_five",
    "pipe_in_four",
    "pipe_quarter_cut_obliquely",
    "pipe_quarter_with_spherical_end",
    "block_with_spherical_bottom",
    "hemispherical_punch",
    "six_rounded_faces",
    "extruded_rational_surface_with_uneven_corners",
    "revolved_spline_surface",
    "block_with_conical_bottom",
    "block_under_a_trimmed_spline_surface",
)


@cache
def converted(name):
    """The topology of a model of the registry, and its faces as splines."""
    found = topology_of(MODELS[name].make)
    shared = merged(found, found.solids)
    return shared, convert_faces(shared, 1e-6, exact=False)


def of_kind(name, kind):
    """The splines of the faces on one kind of surface."""
    found = [face for face in converted(name)[1].values() if face.kind == kind]
    assert found
    return found


def sides(face):
    """The four sides of a face with the corners that they run between."""
    for axis in range(2):
        for side in range(2):
            yield tuple(np.take(face.corners, side, axis=axis).tolist()), face.spline.end(axis, side)


@pytest.mark.parametrize("name", NAMES)
def test_neighbours_agree_on_their_edge_in_homogeneous_coordinates(name):
    topology, faces = converted(name)
    seen = {}
    for face in faces.values():
        for ends, curve in sides(face):
            values = curve.at(AT)
            middle = tuple(np.round(points_of(values)[6] / topology.size, 6) + 0.0)
            key = (frozenset(ends), middle)
            if key not in seen:
                seen[key] = ends, values
                continue
            first, expected = seen[key]
            expected = expected if first == ends else expected[::-1]
            np.testing.assert_allclose(values, expected, rtol=0, atol=1e-12 * topology.size)
    assert len(seen) == len(topology.edges)


@pytest.mark.parametrize("name", NAMES)
def test_every_corner_is_its_vertex_with_weight_one(name):
    topology, faces = converted(name)
    for face in faces.values():
        expected = np.array([[topology.vertices[tag] for tag in row] for row in face.corners])
        np.testing.assert_allclose(points_of(face.spline.corners), expected, rtol=0, atol=2e-7 * topology.size)
        np.testing.assert_allclose(face.spline.corners[..., 3], 1, rtol=0, atol=1e-14)
        assert face.spline.coefficients[..., 3].min() > 0


@pytest.mark.parametrize("name", NAMES)
def test_the_distance_is_that_of_the_spline_and_small_where_it_is_exact(name):
    topology, faces = converted(name)
    for tag, face in faces.items():
        assert face.distance == distance_from(topology.faces[tag], face.spline)
        assert (face.distance > 1e-12 * topology.size) == face.fitted


# The four ways


def test_a_face_between_four_iso_lines_is_cut_out_of_its_surface():
    for face in of_kind("pipe_quarter_cut_obliquely", "plane")[:1] + of_kind("pipe_in_four", "cylinder"):
        assert not face.fitted
        assert max(face.spline.degrees) <= 2
    (face,) = of_kind("block_with_toroidal_side", "torus")
    assert face.spline.degrees == (2, 2)
    assert not face.fitted


def test_a_face_between_four_arcs_on_a_sphere_is_biquartic():
    faces = of_kind("hemispherical_punch", "sphere") + of_kind("block_with_spherical_bottom", "sphere")
    assert len(faces) == 6
    for face in faces:
        assert not face.fitted
        assert min(face.spline.degrees) >= 4
        assert face.distance < 1e-14 * 10


def test_the_wall_of_a_pipe_that_is_cut_obliquely_is_interpolated_between_its_edges():
    faces = of_kind("pipe_quarter_cut_obliquely", "cylinder")
    assert len(faces) == 2
    for face in faces:
        assert not face.fitted
        assert sorted(face.spline.degrees) == [1, 2]


@pytest.mark.parametrize(
    ("name", "kind"), [("block_with_conical_bottom", "cone"), ("block_under_a_trimmed_spline_surface", "B-spline")]
)
def test_what_no_exact_way_reaches_is_fitted_and_says_how_far_it_lies_off(name, kind):
    topology, _ = converted(name)
    (face,) = of_kind(name, kind)
    assert face.fitted
    assert 1e-12 * topology.size < face.distance < 1e-5 * topology.size
    finer = convert_faces(topology, 1e-9, exact=False)[face.tag]
    assert finer.distance <= face.distance


def test_two_patches_of_one_sphere_share_the_turn_of_their_edge():
    """The ball in seven closes although each face alone could choose its turns."""
    _, faces = converted("ball_in_seven")
    outer = [face for face in faces.values() if face.kind == "sphere"]
    assert len(outer) == 6
    assert {face.spline.degrees for face in outer} == {(4, 4)}
    assert max(face.distance for face in outer) < 1e-14


# Running around a face


def test_a_quad_runs_from_corner_to_corner_along_its_edges():
    topology, _ = converted("hemispherical_punch")
    for face in topology.faces.values():
        quad = find_quad(face, topology.edges)
        assert sorted(edge for pair in quad.sides for edge, _ in pair) == sorted(face.edges)
        for axis, pair in enumerate(quad.sides):
            for side, (edge, turned) in enumerate(pair):
                ends = topology.edges[edge].ends
                assert np.take(quad.corners, side, axis=axis).tolist() == list(ends[::-1] if turned else ends)


def test_edges_that_do_not_run_around_once_are_refused():
    """A face of a box with one of its edges changed for the one on the far side."""
    topology, _ = converted("box")
    face = topology.faces[1]
    near = {end for edge in face.edges for end in topology.edges[edge].ends}
    far = next(tag for tag, edge in topology.edges.items() if not near & set(edge.ends))
    with pytest.raises(GeometryError, match=r"face 1: its four edges do not run around it once"):
        find_quad(replace(face, loops=((*face.edges[:3], far),)), topology.edges)
