import meshio
import numpy as np
import pytest
import pyvista

import geom2iga
from post.fields import sample_at
from post.gauss import FIELDS, gauss_samples, write_gauss
from solve.material import Material
from solve.newton import Status
from solve.result import Result, State
from solve.rules import full_rules
from solve.space import number_control_points
from tests.cases import bent_patch, model_of

SLOPE = np.array([[2.0, -1.0, 0.5], [0.25, 1.0, 3.0], [-0.5, 1.5, 4.0]]) * 1e-3


def posed(model, move, young=1000.0):
    """A result that nobody computed: control points displaced by a function of their places; poisson 0.3."""
    displacement = move(number_control_points(model).control_points)
    materials = {body: Material(young * 2**number, 0.3) for number, body in enumerate(model.bodies)}
    return Result(Status.CONVERGED, model, materials, (State(displacement),), (), {})


def stretched(points):
    """The same strain and turn everywhere."""
    return points @ SLOPE.T


def shape_of(kind, spans=(2, 1, 1), degree=2, **sizes):
    """A model of one body."""
    body = {"name": "body", "spans": list(spans), **sizes}
    return geom2iga.build({"geometry": {"degree": degree, kind: [body]}})


@pytest.mark.parametrize(
    ("model", "volume"),
    [
        (shape_of("block", size=[1.0, 2.0, 3.0], degree=[1, 2, 3]), 6),
        (shape_of("pipe", inner=1.0, outer=2.0, height=3.0), 9 * np.pi),
        (shape_of("cylinder", radius=2.0, height=3.0), 12 * np.pi),
        (shape_of("sphere", radius=2.0, degree=4, spans=(1, 1, 1)), 32 / 3 * np.pi),
    ],
    ids=["block", "pipe", "cylinder", "sphere"],
)
def test_weights_add_up_to_the_volume_and_a_uniform_stress_is_found_at_all_points(model, volume):
    result = posed(model, stretched)
    parts = [gauss_samples(result, name) for name in model.patches]
    assert sum(part.weight.sum() for part in parts) == pytest.approx(volume, rel=1e-11)
    expected = result.materials["body"].stress(SLOPE[None])
    for part in parts:
        np.testing.assert_allclose(part.stress, np.repeat(expected, len(part.stress), axis=0), atol=1e-9)
        np.testing.assert_allclose(part.displacement, stretched(part.points), atol=1e-15)


def test_energy_at_the_points_is_that_of_the_analysis(bent):
    energy = 0.0
    for name in bent.model.patches:
        part, material = gauss_samples(bent, name), bent.materials[bent.model.body_of(name)]
        trace = part.stress[:, :3].sum(axis=1, keepdims=True) * np.array([1, 1, 1, 0, 0, 0])
        strain = ((1 + material.poisson) * part.stress - material.poisson * trace) / material.young
        energy += 0.5 * part.weight @ np.sum(part.stress * strain * [1, 1, 1, 2, 2, 2], axis=1)
    assert energy == pytest.approx(bent.statistics["strain_energy"], rel=1e-10)


@pytest.mark.parametrize("rational", [True, False])
def test_fields_are_those_at_the_points_of_the_rule(rational):
    patch = bent_patch(3, (2, 1, 3), (3, 2, 1), rational=rational)
    result = posed(model_of(patch), lambda points: np.sin(points[:, [1, 2, 0]]))
    axes = [rule.points for rule in full_rules(result.space)[patch.name]]
    found = gauss_samples(result, patch.name)
    expected = sample_at(result, patch.name, np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3))
    for name in ("points", "displacement", "stress", "von_mises"):
        scale = np.abs(getattr(expected, name)).max()
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-12 * scale)


def test_the_file_holds_every_point_as_a_vertex_with_its_fields(bent, tmp_path):
    write_gauss(tmp_path / "gauss.vtu", bent)
    parts = [gauss_samples(bent, name) for name in bent.model.patches]
    for mesh in (meshio.read(tmp_path / "gauss.vtu"), pyvista.read(tmp_path / "gauss.vtu")):
        np.testing.assert_array_equal(mesh.points, np.concatenate([part.points for part in parts]))
        assert set(mesh.point_data.keys()) == set(FIELDS)
        for name in FIELDS:
            np.testing.assert_array_equal(mesh.point_data[name], np.concatenate([getattr(p, name) for p in parts]))
    assert set(mesh.celltypes) == {pyvista.CellType.VERTEX}
    np.testing.assert_array_equal(mesh.cells.reshape(-1, 2)[:, 1], np.arange(mesh.n_points))
    assert np.bincount(mesh.cell_data["body"]).tolist() == [len(part.points) for part in parts]
