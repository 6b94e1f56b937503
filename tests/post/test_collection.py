from xml.etree import ElementTree

import numpy as np
import pytest
import pyvista

import geom2iga
import solve
from post.bezier import write_bezier
from post.collection import results_of_steps, write_collection

STEPS = ((0.25, "bezier_1.vtu"), (1 / 3, 'a & "b" <c>.vtu'), (1.0, "bezier_ü.vtu"))


def test_a_collection_names_times_and_files_in_sequence(tmp_path):
    write_collection(tmp_path / "steps.pvd", STEPS)
    root = ElementTree.parse(tmp_path / "steps.pvd").getroot()
    assert (root.tag, root.get("type")) == ("VTKFile", "Collection")
    entries = root.findall("./Collection/DataSet")
    assert [(float(entry.get("timestep")), entry.get("file")) for entry in entries] == list(STEPS)
    assert list(tmp_path.iterdir()) == [tmp_path / "steps.pvd"]


@pytest.fixture(scope="module")
def stepped(case):
    steps = case.changed({"solve.steps": {"factors": [0.25, 0.5, 1.0]}})
    return solve.solve(geom2iga.build(steps), steps)


def test_every_load_step_is_a_result_of_its_own(stepped):
    results = list(results_of_steps(stepped))
    assert [result.state.load_factor for result in results] == [0.25, 0.5, 1.0]
    for result, state in zip(results, stepped.states, strict=True):
        assert result.state is state
        assert result.contacts is state.contacts
    assert results[-1].states == stepped.states


def test_a_reader_of_collections_finds_the_load_steps(stepped, tmp_path):
    steps = []
    for result in results_of_steps(stepped):
        steps.append((result.state.load_factor, f"bezier_{len(steps)}.vtu"))
        write_bezier(tmp_path / steps[-1][1], result)
    write_collection(tmp_path / "bezier.pvd", steps)
    reader = pyvista.get_reader(tmp_path / "bezier.pvd")
    assert reader.time_values == [0.25, 0.5, 1.0]
    for factor in reader.time_values:
        reader.set_active_time_value(factor)
        (mesh,) = reader.read()
        np.testing.assert_allclose(mesh.point_data["stress"][:, 2], -factor, rtol=1e-10)
