import gmsh
import numpy as np
import pytest

from geom2iga.cad import session
from geom2iga.cad.topology import merged, read_topology
from geom2iga.errors import GeometryError
from geom2iga.spline import points_of
from tests.geom2iga.cad.models import MODELS
from tests.geom2iga.cad.opened import opened, topology_of
from tests.geom2iga.cad.shapes import lifted, on_circle, plate


def copies_of_copies(occ):
    """A cylinder moved, turned, mirrored and copied again: locations of locations."""
    first = [(3, occ.addCylinder(0, 0, 0, 0, 0, 2, 1))]
    occ.translate(first, 1, 2, 3)
    second = occ.copy(first)
    occ.rotate(second, 0, 0, 0, 1, 2, 3, 0.7)
    third = occ.copy(second)
    occ.translate(third, 5, 0, 0)
    occ.rotate(third, 1, 1, 1, 0, 1, 0, 2.0)
    occ.mirror(occ.copy(third), 1, 2, 3, 4)


def seams_and_poles(occ):
    occ.addSphere(0, 0, 0, 1)
    occ.addCone(3, 0, 0, 0, 0, 2, 1, 0)
    occ.addTorus(9, 0, 0, 3, 1)


FROM_REGISTRY = (
    "turned_box",
    "small_box_on_a_box",
    "fan_of_5",
    "pipe_quarter_with_spherical_end",
    "conical_sector",
    "torus_sector_with_bulged_sides",
    "hemispherical_punch",
    "six_bezier_faces",
    "revolved_spline_surface",
    "mirrored_pipe_quarter",
    "sheared_pipe_quarter",
)
SHAPES = {name: MODELS[name].make for name in FROM_REGISTRY} | {
    "copies_of_copies": copies_of_copies,
    "seams_and_poles": seams_and_poles,
}


def below(dimension, tag):
    """Tags of what bounds an entity, as gmsh says."""
    return {tag for _, tag in gmsh.model.getBoundary([(dimension, tag)], combined=False, oriented=False)}


@pytest.mark.parametrize("make", SHAPES.values(), ids=SHAPES.keys())
def test_everything_is_where_gmsh_says_and_bounded_by_what_gmsh_says(make):
    with opened(make):
        found = read_topology(session.boundary())
        parts = (found.vertices, found.edges, found.faces, found.solids)
        assert [sorted(part) for part in parts] == [[tag for _, tag in gmsh.model.getEntities(d)] for d in range(4)]
        reach = 1e-13 * np.abs(list(found.vertices.values())).max()
        for tag, point in found.vertices.items():
            np.testing.assert_allclose(point, gmsh.model.getValue(0, tag, []), rtol=0, atol=reach)
        for tag, edge in found.edges.items():
            assert set(edge.ends) == below(1, tag)
            ends = points_of(edge.curve.at(np.array([0.0, 1.0])))
            np.testing.assert_allclose(ends, [found.vertices[end] for end in edge.ends], rtol=0, atol=1e-7)
        for tag, face in found.faces.items():
            assert set(face.edges) == below(2, tag)
        for tag, solid in found.solids.items():
            assert set(solid.faces) == below(3, tag)


@pytest.mark.parametrize("make", SHAPES.values(), ids=SHAPES.keys())
def test_gmsh_finds_the_points_of_our_edges_on_its_own(make):
    with opened(make):
        for tag, edge in read_topology(session.boundary()).edges.items():
            if edge.kind != "pole":
                points = points_of(edge.curve.at(np.linspace(0.05, 0.95, 7)))
                closest, _ = gmsh.model.getClosestPoint(1, tag, points.ravel())
                np.testing.assert_allclose(np.reshape(closest, (-1, 3)), points, rtol=0, atol=1e-7)


def test_a_seam_stands_twice_in_its_loop_and_a_pole_is_a_mere_point():
    found = topology_of(seams_and_poles)
    sphere = next(face for face in found.faces.values() if face.surface.kind == "sphere")
    (loop,) = sphere.loops
    kinds = [found.edges[edge].kind for edge in loop]
    assert sorted(kinds) == ["circle", "circle", "pole", "pole"]
    assert len(set(loop)) == 3
    for edge in found.edges.values():
        if edge.kind == "pole":
            assert np.ptp(edge.curve.coefficients, axis=0).max() == 0


def test_a_hole_is_another_loop_and_a_cavity_another_shell():
    def make(occ):
        occ.cut([(3, occ.addBox(-1, -1, 0, 2, 2, 1))], [(3, occ.addCylinder(0, 0, 0, 0, 0, 1, 0.5))])
        occ.cut([(3, occ.addBox(4, 0, 0, 3, 3, 3))], [(3, occ.addBox(5, 1, 1, 1, 1, 1))])

    found = topology_of(make)
    assert sorted(len(face.loops) for face in found.faces.values())[-3:] == [1, 2, 2]
    assert sorted(len(solid.shells) for solid in found.solids.values()) == [1, 2]


def test_the_size_is_the_largest_extent():
    assert topology_of(MODELS["box"].make).size == pytest.approx(3, rel=1e-15)


def test_a_boundary_with_an_offset_curve_names_the_edge():
    with opened(MODELS["box"].make):
        text = session.boundary()
    before, _, after = text.partition("Curves 12\n")
    line, _, rest = after.partition("\n")
    with pytest.raises(GeometryError, match=r"edge \d+: an offset curve is no NURBS"):
        read_topology(f"{before}Curves 12\n9 0.5\n0 0 1\n{line}\n{rest}")


def test_a_text_without_a_boundary_is_refused():
    with pytest.raises(GeometryError, match="first line is missing"):
        read_topology("<XAO></XAO>")


# Solids that do not share what they have in common


def cubes_apart(gap):
    """Two cubes, as they are before anybody lets them share a face."""

    def make(occ):
        occ.addBox(0, 0, 0, 1, 1, 1)
        occ.addBox(1 + gap, 0, 0, 1, 1, 1)

    return make


def counts(topology):
    """Numbers of different vertices, edges and faces of the solids."""
    faces = {face for solid in topology.solids.values() for face in solid.faces}
    edges = {edge for face in faces for edge in topology.faces[face].edges}
    return len({end for edge in edges for end in topology.edges[edge].ends}), len(edges), len(faces)


def test_cubes_in_touch_share_a_face_after_merging():
    found = topology_of(cubes_apart(0.0))
    assert counts(found) == (16, 24, 12)
    shared = merged(found, found.solids)
    assert counts(shared) == (12, 20, 11)
    for face in shared.faces.values():
        assert set(face.traces) == set(face.edges)


def test_cubes_that_do_not_touch_stay_apart():
    found = topology_of(cubes_apart(1e-4))
    assert counts(merged(found, found.solids)) == (16, 24, 12)


def test_one_of_two_touching_cubes_is_left_alone():
    found = topology_of(cubes_apart(0.0))
    alone = merged(found, {2: found.solids[2]})
    assert counts(alone) == (8, 12, 6)
    assert list(alone.solids) == [2]


def test_edges_with_the_same_ends_but_other_middles_stay_apart():
    """A chord and an arc over it."""

    def make(occ):
        ends = [on_circle(1, 0), on_circle(1, 90)]
        lifted(occ, [plate(occ, [(0, 0, 0), *ends])], 1)
        lifted(occ, [plate(occ, [(2, 2, 0), *ends[::-1]], {1: (0, 0, 0)})], 1)

    found = topology_of(make)
    shared = merged(found, found.solids)
    assert counts(shared) == (8, 2 * 9 - 2, 10)


def test_shared_solids_are_as_they_were():
    found = topology_of(MODELS["eight_boxes"].make)
    shared = merged(found, found.solids)
    assert counts(shared) == counts(found) == (27, 54, 36)
    assert {tag: solid.shells for tag, solid in shared.solids.items()} == {
        tag: solid.shells for tag, solid in found.solids.items()
    }
