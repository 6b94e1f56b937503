from itertools import product
from math import pi

import gmsh
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geom2iga.cad.hexahedra import distances, mesh_volumes
from geom2iga.cad.mesh_route import CORNERS, fit_volumes, fitted, structured_grid
from geom2iga.errors import CaseError, GeometryError
from geom2iga.glue import find_glued
from geom2iga.model import Model, oriented
from geom2iga.patch import Face, evaluate, surface
from tests.cases import bent_patch
from tests.oracles import assert_order
from tests.strategies import SEEDS

pytestmark = pytest.mark.usefixtures("empty_gmsh")

COUNTS = st.tuples(*[st.integers(1, 4)] * 3)


def fit(spans):
    """Fit every volume of the gmsh model."""
    gmsh.model.occ.synchronize()
    return fit_volumes({tag: f"volume {tag}" for _, tag in gmsh.model.getEntities(3)}, spans)


def kinds_of_elements(tag):
    """What gmsh calls the elements in a volume."""
    return [gmsh.model.mesh.getElementProperties(kind)[0] for kind in gmsh.model.mesh.getElementTypes(3, tag)]


def add_pipe_sector(height=2.0):
    """A quarter of a pipe about z, radii 1 and 2."""
    outer, inner = (gmsh.model.occ.addCylinder(0, 0, 0, 0, 0, height, radius, angle=pi / 2) for radius in (2, 1))
    gmsh.model.occ.cut([(3, outer)], [(3, inner)])


def add_prism(points, height=1.0):
    """A polygon in the plane z = 0, extruded."""
    occ = gmsh.model.occ
    tags = [occ.addPoint(*point, 0) for point in points]
    lines = [occ.addLine(start, end) for start, end in zip(tags, [*tags[1:], tags[0]], strict=True)]
    occ.extrude([(2, occ.addPlaneSurface([occ.addCurveLoop(lines)]))], 0, 0, height)


def lattice(shape, seed=0, jitter=0.2):
    """A grid (a + 1, b + 1, c + 1, 3) of points near whole numbers."""
    points = np.stack(np.meshgrid(*[np.arange(n + 1.0) for n in shape], indexing="ij"), axis=-1)
    return points + jitter * np.random.default_rng(seed).uniform(-1, 1, points.shape)


def hexahedra_of(shape):
    """Hexahedra (m, 8) of a grid whose nodes are numbered with the last direction fastest."""
    numbers = np.arange(np.prod(np.add(shape, 1))).reshape(np.add(shape, 1))
    ends = [numbers[tuple(slice(d, n + d) for d, n in zip(at, shape, strict=True))].ravel() for at in CORNERS]
    return np.stack(ends, axis=-1)


def cube_turns():
    """The 48 ways (48, 8) to number the corners of a cube, mirrored ones too."""
    centred = 2 * np.array(CORNERS) - 1
    axes = [np.eye(3, dtype=int)[list(p)] for p in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (1, 0, 2), (0, 2, 1), (2, 1, 0))]
    turns = [centred @ (np.diag(signs) @ a) for a in axes for signs in product((1, -1), repeat=3)]
    return np.array([[centred.tolist().index(row) for row in turn.tolist()] for turn in turns])


def scrambled(shape, points, random):
    """The mesh of a grid with its nodes and elements renumbered, and every element turned, at random."""
    number = random.permutation(points[..., 0].size)
    nodes = np.empty((number.size, 3))
    nodes[number] = points.reshape(-1, 3)
    hexahedra = random.permutation(number[hexahedra_of(shape)])
    return nodes, np.take_along_axis(hexahedra, random.choice(cube_turns(), len(hexahedra)), axis=1)


@given(COUNTS, SEEDS)
def test_a_grid_is_recovered_from_any_numbering_of_its_nodes_and_hexahedra(shape, seed):
    points = lattice(shape, seed)
    nodes, hexahedra = scrambled(shape, points, np.random.default_rng(seed))
    np.testing.assert_array_equal(nodes[structured_grid(nodes, hexahedra)], points)


@given(COUNTS, SEEDS, st.booleans())
def test_a_recovered_grid_is_right_handed_however_it_lies_in_space(shape, seed, mirrored):
    points = lattice(shape, seed) @ Rotation.random(random_state=seed).as_matrix() * (-1 if mirrored else 1)
    nodes, hexahedra = scrambled(shape, points, np.random.default_rng(seed))
    found = nodes[structured_grid(nodes, hexahedra)]
    assert sorted(found.shape[:3]) == sorted(points.shape[:3])
    assert np.linalg.det([found[end] - found[0, 0, 0] for end in ((-1, 0, 0), (0, -1, 0), (0, 0, -1))]) > 0


@pytest.mark.parametrize(
    "kept",
    [
        lambda cells: np.arange(27) != 13,  # hollow: all nodes are there
        lambda cells: np.arange(27) != 0,
        lambda cells: cells[:, 0] != 1,  # two plates
        lambda cells: (cells[:, 0] != 1) | (cells[:, 1] != 1),  # a ring
    ],
)
def test_hexahedra_that_are_no_grid_are_refused(kept):
    cells = np.stack(np.unravel_index(np.arange(27), (3, 3, 3)), axis=1)
    used, hexahedra = np.unique(hexahedra_of((3, 3, 3))[kept(cells)], return_inverse=True)
    with pytest.raises(GeometryError, match="form no structured grid"):
        structured_grid(lattice((3, 3, 3)).reshape(-1, 3)[used], hexahedra.reshape(-1, 8))


@settings(deadline=None)
@given(SEEDS, st.tuples(*[st.integers(2, 3)] * 3))
def test_points_of_a_cubic_spline_give_back_its_control_points(seed, spans):
    patch = bent_patch(seed, (3, 3, 3), spans, rational=False)
    at = [np.linspace(0, 1, 2 * count + 1) for count in spans]
    points = evaluate(patch, np.stack(np.meshgrid(*at, indexing="ij"), axis=-1).reshape(-1, 3))[0]
    found, error = fitted(points.reshape(*map(len, at), 3), "bent")
    assert error < 1e-12
    np.testing.assert_allclose(found.control_points, patch.control_points, rtol=0, atol=1e-12)


@settings(deadline=None)
@given(SEEDS, st.integers(0, 7))
def test_neighbours_that_share_the_points_of_a_face_share_its_control_points(seed, orientation):
    first, second = lattice((4, 6, 8), seed), lattice((4, 6, 8) if not orientation & 1 else (4, 8, 6), seed + 1)
    first[-1] = oriented(second[0], orientation)
    here = surface(fitted(first, "first")[0], Face("first", 0, 1))
    there = surface(fitted(second, "second")[0], Face("second", 0, 0))
    shared = oriented(there.control_points, orientation)
    np.testing.assert_allclose(here.control_points, shared, rtol=0, atol=1e-14 * np.abs(first).max())


@settings(deadline=None)
@given(SEEDS)
def test_fitting_commutes_with_affine_maps(seed):
    random = np.random.default_rng(seed)
    points, matrix, shift = lattice((4, 4, 4), seed), random.normal(size=(3, 3)), random.normal(size=3)
    moved = fitted(points @ matrix + shift, "moved")[0].control_points
    np.testing.assert_allclose(moved, fitted(points, "here")[0].control_points @ matrix + shift, rtol=0, atol=1e-12)


def test_fitting_stops_where_the_points_do_not_determine_the_control_points():
    with pytest.raises(ValueError, match="3 points do not determine 4 control points"):
        fitted(lattice((2, 4, 4)), "thin")


def test_too_few_spans_for_the_degree_are_refused():
    with pytest.raises(CaseError, match="fits degree 4 with 3 or more spans, found 2"):
        fit_volumes({1: "volume"}, 2, degree=4)


def test_the_error_of_a_pipe_sector_is_that_of_its_radius_and_falls_with_the_fourth_power_of_the_span():
    add_pipe_sector()
    errors = []
    for spans in (4, 8, 16):
        (result,) = fit(spans)
        round_ones = [face for tag, face in result.faces.items() if gmsh.model.getType(2, tag) == "Cylinder"]
        xi = np.random.default_rng(0).random((4000, 2))
        radii = np.array([np.linalg.norm(evaluate(surface(result.patch, f), xi)[0][:, :2], axis=1) for f in round_ones])
        assert sorted(np.rint(radii[:, 0])) == [1, 2]
        assert np.abs(radii - np.rint(radii)).max() == pytest.approx(result.boundary_error, rel=0.05)
        errors.append(result.boundary_error)
    assert errors[1] < 2e-5
    assert_order(errors, [1 / 4, 1 / 8, 1 / 16], 4)


def test_a_pipe_sector_cut_by_a_crossing_cylinder_is_fitted_to_the_accuracy_of_its_spans():
    occ = gmsh.model.occ
    add_pipe_sector()
    occ.cut([(3, 1)], [(3, occ.addCylinder(-1, 1, 3, 5, 0, 0, 2))])
    (coarse,), (fine,) = fit(8), fit(16)
    assert coarse.boundary_error < 1e-4
    assert fine.boundary_error < coarse.boundary_error / 6


def test_a_curved_block_of_the_built_in_kernel_is_fitted():
    geo = gmsh.model.geo
    corners = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2.5), (0, 2, 2)]
    points = [geo.addPoint(*corner) for corner in corners]
    bulges = [geo.addPoint(*at) for at in [(1, -0.3, 0.2), (2.2, 1, 0.1), (1, 2.2, -0.2), (0.1, 1, -0.3)]]
    around = [(0, 1), (1, 2), (2, 3), (3, 0)]
    below = [geo.addSpline([points[i], b, points[j]]) for (i, j), b in zip(around, bulges, strict=True)]
    above = [geo.addLine(points[i + 4], points[j + 4]) for i, j in around]
    upright = [geo.addLine(points[i], points[i + 4]) for i in range(4)]
    sides = [[below[i], upright[j], -above[i], -upright[i]] for i, j in around]
    faces = [geo.addSurfaceFilling([geo.addCurveLoop(loop)]) for loop in (below, above, *sides)]
    geo.addVolume([geo.addSurfaceLoop(faces)])
    geo.synchronize()
    (coarse,), (fine,) = (fit_volumes({1: "block"}, spans) for spans in (4, 8))
    assert fine.boundary_error < 3e-4
    assert fine.boundary_error < coarse.boundary_error / 6
    assert fine.faces[faces[0]] == Face("block", 2, 0)


def test_the_four_volumes_of_a_pipe_are_glued():
    occ = gmsh.model.occ
    add_pipe_sector(3)
    sectors = [(3, 1), *[(3, occ.copy([(3, 1)])[0][1]) for _ in range(3)]]
    for number, sector in enumerate(sectors):
        occ.rotate([sector], 0, 0, 0, 0, 0, 1, number * pi / 2)
    occ.fragment(sectors[:1], sectors[1:])
    results = fit(4)
    patches = {result.patch.name: result.patch for result in results}
    glued = find_glued(list(patches.values()))
    Model(patches, {"pipe": tuple(patches)}, {}, glued)
    tags = {face: tag for result in results for tag, face in result.faces.items()}
    assert len(glued) == 4
    assert all(tags[pair.first] == tags[pair.second] for pair in glued)
    for pair in glued:
        first, second = (surface(patches[face.patch], face).control_points for face in (pair.first, pair.second))
        np.testing.assert_allclose(first, oriented(second, pair.orientation), rtol=0, atol=1e-14)


def test_each_face_of_the_patch_knows_its_face_of_the_model():
    gmsh.model.occ.addBox(1, 2, 3, 4, 5, 6)
    (result,) = fit(2)
    assert len(set(result.faces.values())) == 6
    for tag, face in result.faces.items():
        middle = evaluate(surface(result.patch, face), [[0.5, 0.5]])[0][0]
        np.testing.assert_allclose(middle, gmsh.model.occ.getCenterOfMass(2, tag), atol=1e-12)
    assert result.boundary_error < 1e-13


def test_distances_are_measured_to_the_surface():
    gmsh.model.occ.addSphere(0, 0, 0, 2)
    gmsh.model.occ.synchronize()
    np.testing.assert_allclose(distances(1, np.array([[3.0, 0, 0], [0, 1.5, 0]])), [1, 0.5], atol=1e-12)


def test_the_settings_of_the_users_gmsh_change_neither_the_mesh_nor_themselves():
    add_pipe_sector()
    gmsh.model.occ.addBox(5, 5, 5, 1, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.setTransfiniteCurve(gmsh.model.getEntities(1)[0][1], 5)
    gmsh.model.setVisibility([(3, 1)], 0)
    options = {
        "Mesh.ElementOrder": 2,
        "Mesh.FlexibleTransfinite": 1,
        "Mesh.MeshSizeFactor": 0.5,
        "Mesh.SubdivisionAlgorithm": 2,
    }
    for name, value in options.items():
        gmsh.option.setNumber(name, value)
    gmsh.model.mesh.generate(3)
    assert len(mesh_volumes([1], 4)[1].hexahedra) == 64
    assert {name: gmsh.option.getNumber(name) for name in options} == options
    assert [gmsh.model.getVisibility(3, tag) for tag in (1, 2)] == [0, 1]


def test_no_mesh_and_no_rule_for_one_is_left_behind():
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    fit(2)
    assert len(gmsh.model.mesh.getNodes()[0]) == 0
    gmsh.model.mesh.generate(3)
    assert "Hexahedron" not in str(kinds_of_elements(1))


def test_volumes_that_were_not_asked_for_are_not_meshed(monkeypatch):
    for x in (0, 5):
        gmsh.model.occ.addBox(x, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    generate, found = gmsh.model.mesh.generate, {}

    def watched(dimension):
        generate(dimension)
        found.update({tag: kinds_of_elements(tag) for tag in (1, 2)})

    monkeypatch.setattr(gmsh.model.mesh, "generate", watched)
    mesh_volumes([2], 3)
    assert found == {1: [], 2: ["Hexahedron 8"]}


def test_what_gmsh_meshes_with_tetrahedra_is_refused(monkeypatch):
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    monkeypatch.setattr(gmsh.model.mesh, "setTransfiniteVolume", lambda tag: None)
    with pytest.raises(GeometryError, match=r"volume 1: gmsh cannot mesh it with 4 x 4 x 4 hexahedra, it made .*Tetra"):
        fit(2)


def test_a_volume_with_a_deep_reentrant_corner_is_refused():
    add_prism([(0, 0), (2, 0), (0.4, 0.4), (0, 2)])
    with pytest.raises(GeometryError, match="volume 1: its transfinite mesh is folded"):
        fit(4)


def add_pyramid():
    """Six faces, the base with five edges."""
    occ = gmsh.model.occ
    angles = np.arange(5) * 2 * pi / 5
    base = [occ.addPoint(np.cos(a), np.sin(a), 0) for a in angles]
    top = occ.addPoint(0, 0, 1)
    below = [occ.addLine(base[i], base[(i + 1) % 5]) for i in range(5)]
    above = [occ.addLine(point, top) for point in base]
    loops = [below, *[[below[i], above[(i + 1) % 5], -above[i]] for i in range(5)]]
    occ.addVolume([occ.addSurfaceLoop([occ.addPlaneSurface([occ.addCurveLoop(loop)]) for loop in loops])])


def add_rounded_box():
    """Six faces, one of them a piece of a sphere with its seam."""
    occ = gmsh.model.occ
    occ.intersect([(3, occ.addBox(-1, -1, -3, 2, 2, 3))], [(3, occ.addSphere(0, 0, 0, 2.5))])


@pytest.mark.parametrize(
    ("add", "message"),
    [
        (lambda: add_prism([(0, 0), (2, 0), (3, 1), (2, 2), (0, 2)]), "volume 1 has 7 faces, a block has 6: split it"),
        (lambda: add_prism([(0, 0), (2, 0), (0, 2)]), "volume 1 has 5 faces, a block has 6"),
        (add_pyramid, "face 1 has 5 edges, a block face has 4: merge edges or split it"),
        (add_rounded_box, r"face \d+ meets itself along a seam"),
    ],
)
def test_a_volume_that_is_no_block_is_refused_with_its_face(add, message):
    add()
    with pytest.raises(GeometryError, match=message):
        fit(2)
