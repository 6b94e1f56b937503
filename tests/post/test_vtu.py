import meshio
import numpy as np
import pytest
import pyvista

from post.fields import sample_contact, sample_patch
from post.vtu import write_bodies, write_contact


def test_bodies_hold_the_fields_of_the_samples_bit_for_bit(tmp_path, bent):
    write_bodies(tmp_path / "bodies.vtu", bent, 3)
    mesh = meshio.read(tmp_path / "bodies.vtu")
    parts = [sample_patch(bent, name, 3) for name in bent.model.patches]
    assert set(mesh.point_data) == {"displacement", "stress", "von_mises"}
    np.testing.assert_array_equal(mesh.points, np.concatenate([part.points for part in parts]))
    for name, values in mesh.point_data.items():
        np.testing.assert_array_equal(values, np.concatenate([getattr(part, name) for part in parts]))
    (body,) = mesh.cell_data["body"]
    assert np.bincount(body).tolist() == [len(part.cells) for part in parts]


def test_vtk_itself_opens_the_files_and_finds_the_volume_and_area(tmp_path, bent):
    write_bodies(tmp_path / "bodies.vtu", bent, 3)
    write_contact(tmp_path / "contact.vtu", bent, 3)
    bodies, contact = pyvista.read(tmp_path / "bodies.vtu"), pyvista.read(tmp_path / "contact.vtu")
    assert bodies.volume == pytest.approx(5.0, rel=1e-10)
    assert contact.area == pytest.approx(1.0, rel=1e-10)
    assert bodies.point_data["stress"].shape[1] == 6


def test_contact_file_names_pressure_gap_and_normal(tmp_path, bent):
    write_contact(tmp_path / "contact.vtu", bent, 3)
    mesh = meshio.read(tmp_path / "contact.vtu")
    (part,) = sample_contact(bent, bent.contacts[0], 3)
    for name in ("pressure", "gap", "normal"):
        np.testing.assert_array_equal(mesh.point_data[name], getattr(part, name))
    assert mesh.cell_data["face"][0].tolist() == [0] * len(part.cells)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, bent, monkeypatch):
    path = tmp_path / "bodies.vtu"
    path.write_text("old")

    def full_disk(name, *_, **__):
        name.write_text("half")
        raise OSError("no space left on device")

    monkeypatch.setattr(meshio, "write", full_disk)
    with pytest.raises(OSError, match="no space"):
        write_bodies(path, bent, 3)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
