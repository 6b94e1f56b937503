from dataclasses import replace

import meshio
import numpy as np
import pytest

from geom2iga.errors import CaseError
from post.fields import Samples
from post.meshes import as_mesh
from post.vtu import write_bodies
from tests.post.test_vtu import ignored


def test_a_mesh_is_what_the_vtu_file_holds(bent, tmp_path):
    write_bodies(tmp_path / "bodies.vtu", Samples(bent, 3), ignored)
    file, mesh = meshio.read(tmp_path / "bodies.vtu"), as_mesh(bent, 3)
    np.testing.assert_array_equal(mesh.points, file.points)
    np.testing.assert_array_equal(mesh.get_cells_type("hexahedron"), file.get_cells_type("hexahedron"))
    for name, values in file.point_data.items():
        np.testing.assert_array_equal(mesh.point_data[name], values)
    np.testing.assert_array_equal(mesh.get_cell_data("body", "hexahedron"), file.get_cell_data("body", "hexahedron"))


@pytest.mark.parametrize("ending", ["xdmf", "vtk"])
def test_other_formats_hold_the_stress_to_the_last_bit(bent, tmp_path, ending):
    mesh = as_mesh(bent, 2)
    mesh.write(tmp_path / f"bodies.{ending}")
    again = meshio.read(tmp_path / f"bodies.{ending}")
    np.testing.assert_array_equal(again.point_data["von_mises"].ravel(), mesh.point_data["von_mises"])


def test_a_result_that_has_not_converged_is_no_mesh(bent):
    with pytest.raises(CaseError, match="no result"):
        as_mesh(replace(bent, states=()))
