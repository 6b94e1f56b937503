import numpy as np
import pytest
import pyvista
from hypothesis import given, settings
from vtkmodules.vtkCommonCore import reference
from vtkmodules.vtkCommonDataModel import VTK_BEZIER_HEXAHEDRON
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

from geom2iga.bspline import extraction
from geom2iga.patch import Patch, evaluate
from post import bezier
from post.bezier import bezier_grid, extracted, write_bezier
from post.fields import sample_at
from post.projected import project_stress
from tests.cases import bent_patch, block_patch, hollow_cylinder, model_of
from tests.post.test_gauss import posed, shape_of
from tests.strategies import open_knot_vectors

EXACT = 1e-13  # of the size of the body


def waved(points):
    """Displacements that vary."""
    return 0.1 * np.sin(points[:, [1, 2, 0]] * [1.0, 1.3, 0.7])


def with_repeated_knots():
    """A rational volume with inner knots of every multiplicity."""
    random = np.random.default_rng(1)
    knots = ([0, 0, 0, 0, 1, 2, 2, 3, 3, 3, 4, 4, 4, 4], [0, 0, 0, 0.3, 0.3, 1, 1, 1], [-1, -1, 0, 5, 5])
    shape, degrees = (10, 5, 3), (3, 2, 1)
    cube = [np.linspace(0, length, count) for length, count in zip((4, 2, 3), shape, strict=True)]
    points = np.stack(np.meshgrid(*cube, indexing="ij"), axis=-1) + random.uniform(-0.05, 0.05, (*shape, 3))
    return model_of(Patch("body", degrees, knots, points, random.uniform(0.7, 1.4, shape)))


def two_bodies():
    """Bodies of different degrees, one of them rational."""
    return model_of(block_patch("first", (5, 0, 0), degree=1, spans=(2, 1, 1)), bent_patch(2, (2, 3, 1), name="second"))


MODELS = {
    "linear": model_of(block_patch(degree=1, spans=(2, 3, 1))),
    "quadratic": model_of(block_patch(degree=2, spans=(2, 1, 3))),
    "cubic": model_of(block_patch(degree=3, spans=(1, 2, 2))),
    "mixed": model_of(bent_patch(0, (1, 2, 3), (3, 2, 2), rational=False)),
    "mixed and rational": model_of(bent_patch(1, (3, 1, 2), (2, 2, 3))),
    "higher": model_of(bent_patch(4, (4, 5, 2), (2, 1, 1))),
    "cylinder": shape_of("cylinder", radius=2.0, height=3.0),
    "pipe": shape_of("pipe", inner=1.0, outer=2.0, height=3.0),
    "sphere": shape_of("sphere", radius=2.0, degree=4, spans=(1, 1, 1)),
    "repeated knots": with_repeated_knots(),
    "two bodies": two_bodies(),
}


def read_back(path):
    """What VTK's own reader finds."""
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput()


def spans_of(model):
    """Each span in the sequence of the file: patch, lower and upper ends (3,)."""
    for name in (name for names in model.bodies.values() for name in names):
        at = model.patches[name].breaks
        for span in np.ndindex(*(len(own) - 1 for own in at)):
            yield name, *(np.array([own[k + end] for own, k in zip(at, span, strict=True)]) for end in (0, 1))


def located(cell, share):
    """Position (3,) in a cell, numbers of its points and their rational functions there."""
    place, functions = [0.0] * 3, [0.0] * cell.GetNumberOfPoints()
    cell.EvaluateLocation(reference(0), share, place, functions)
    return place, [cell.GetPointId(k) for k in range(len(functions))], functions


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_cells_that_vtk_read_are_the_spans_of_the_patches_and_hold_their_fields(model, tmp_path):
    result, random = posed(model, waved), np.random.default_rng(0)
    write_bezier(tmp_path / "bezier.vtu", result)
    mesh = pyvista.wrap(read_back(tmp_path / "bezier.vtu"))
    spans, stress = list(spans_of(model)), project_stress(result)
    assert mesh.n_cells == len(spans)
    assert set(mesh.celltypes) == {VTK_BEZIER_HEXAHEDRON}
    assert set(mesh.point_data.keys()) == {"displacement", "stress", "RationalWeights"}
    for k in random.choice(len(spans), min(len(spans), 25), replace=False):
        name, low, high = spans[k]
        share = random.uniform(0, 1, 3)
        xi = (low + share * (high - low))[None]
        place, points, functions = located(mesh.GetCell(k), share)
        expected = sample_at(result, name, xi)
        smooth = evaluate(model.patches[name], xi, 0, stress[name])[0]
        np.testing.assert_allclose(place, expected.points[0], rtol=0, atol=EXACT * mesh.length)
        for field, value in (("displacement", expected.displacement), ("stress", smooth)):
            values = mesh.point_data[field]
            found = functions @ values[points]
            np.testing.assert_allclose(found, value[0], rtol=0, atol=EXACT * np.abs(values).max())


def test_degrees_and_weights_are_attributes_and_bodies_are_numbered(tmp_path):
    model = two_bodies()
    write_bezier(tmp_path / "bezier.vtu", posed(model, waved))
    grid = read_back(tmp_path / "bezier.vtu")
    assert grid.GetPointData().GetRationalWeights().GetName() == "RationalWeights"
    assert grid.GetCellData().GetHigherOrderDegrees().GetName() == "HigherOrderDegrees"
    mesh = pyvista.read(tmp_path / "bezier.vtu")
    degrees = [model.patches[name].degrees for name, _, _ in spans_of(model)]
    np.testing.assert_array_equal(mesh.cell_data["HigherOrderDegrees"], degrees)
    assert mesh.cell_data["body"].tolist() == [int(name == "second") for name, _, _ in spans_of(model)]


def test_neighbours_share_their_points(tmp_path):
    patch = block_patch(degree=(1, 2, 3), spans=(2, 3, 2))
    write_bezier(tmp_path / "bezier.vtu", posed(model_of(patch), waved))
    mesh = pyvista.read(tmp_path / "bezier.vtu")
    assert mesh.n_points == 3 * 7 * 7
    assert len(np.unique(mesh.points.round(9), axis=0)) == mesh.n_points
    first, *others = (set(mesh.get_cell(k).point_ids) for k in (0, 1, 2, 6))  # steps along w, v, u
    assert [len(first & other) for other in others] == [2 * 3, 2 * 4, 3 * 4]


@settings(max_examples=30, deadline=None)
@given(open_knot_vectors())
def test_extraction_gives_bernstein_coefficients_of_partition_one(knots_and_degree):
    knots, degree = knots_and_degree
    matrix = extraction(knots, degree)
    assert matrix.shape == (degree * (len(np.unique(knots)) - 1) + 1, len(knots) - degree - 1)
    np.testing.assert_allclose(matrix.sum(axis=1), 1, atol=1e-13)
    assert matrix.data.min() >= -1e-15


def test_one_element_is_its_own_patch():
    patch = hollow_cylinder()
    values, weights = extracted(patch, patch.control_points)
    np.testing.assert_allclose(values, patch.control_points.reshape(-1, 3), atol=1e-15)
    np.testing.assert_array_equal(weights, patch.weights.ravel())


def test_a_quarter_of_a_pipe_of_one_span_is_drawn_round():
    grid = pyvista.wrap(bezier_grid(posed(model_of(hollow_cylinder(1.0, 2.0, 3.0)), waved)))
    skin = grid.extract_surface(nonlinear_subdivision=4, algorithm="dataset_surface")  # in single precision
    x, y, z = skin.points.T.astype(float)
    radius = np.hypot(x, y)
    off = np.abs([radius - 1, radius - 2, x, y, z, z - 3]).min(axis=0)
    assert off.max() <= 1e-6
    outside = (np.abs(radius - 2) <= 1e-6) & (z > 0.1) & (z < 2.9)
    angles = np.unique(np.degrees(np.arctan2(y, x))[outside].round(3))
    assert len(angles) == 2**4 + 1
    assert np.diff(angles).max() < 7


def test_warped_by_its_displacement_it_is_the_deformed_body():
    model = MODELS["mixed and rational"]
    result = posed(model, waved)
    warped = pyvista.wrap(bezier_grid(result)).warp_by_vector("displacement")
    name, low, high = next(spans_of(model))
    place, _, _ = located(warped.GetCell(0), (0.3, 0.6, 0.9))
    expected = sample_at(result, name, (low + [0.3, 0.6, 0.9] * (high - low))[None])
    np.testing.assert_allclose(place, (expected.points + expected.displacement)[0], atol=EXACT * warped.length)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    class FullDisk(bezier.vtkXMLUnstructuredGridWriter):
        def Write(self):  # noqa: N802
            return 0

    monkeypatch.setattr(bezier, "vtkXMLUnstructuredGridWriter", FullDisk)
    path = tmp_path / "bezier.vtu"
    path.write_text("old")
    with pytest.raises(OSError, match=r"bezier\.vtu could not be written"):
        write_bezier(path, posed(MODELS["linear"], waved))
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
