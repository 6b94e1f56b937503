import meshio
import numpy as np
import pytest
import pyvista

from post.fields import Samples, sample_contact, sample_patch
from post.vtu import body_columns, write_bodies, write_contact


def ignored(name, part):
    """Look at samples, and keep nothing."""


def test_bodies_hold_the_fields_of_the_samples_bit_for_bit(tmp_path, bent):
    write_bodies(tmp_path / "bodies.vtu", Samples(bent, 3), ignored)
    mesh = meshio.read(tmp_path / "bodies.vtu")
    parts = [sample_patch(bent, name, 3) for name in bent.model.patches]
    fields = {"displacement", "stress", "von_mises", "principal_stress", "hydrostatic_pressure"}
    assert set(mesh.point_data) == fields
    np.testing.assert_array_equal(mesh.points, np.concatenate([part.points for part in parts]))
    for name, values in mesh.point_data.items():
        np.testing.assert_array_equal(values, np.concatenate([getattr(part, name) for part in parts]))
    (body,) = mesh.cell_data["body"]
    assert np.bincount(body).tolist() == [len(part.cells) for part in parts]


def test_vtk_itself_opens_the_files_and_finds_the_volume_and_area(tmp_path, bent):
    write_bodies(tmp_path / "bodies.vtu", Samples(bent, 3), ignored)
    write_contact(tmp_path / "contact.vtu", Samples(bent, 3))
    bodies, contact = pyvista.read(tmp_path / "bodies.vtu"), pyvista.read(tmp_path / "contact.vtu")
    assert bodies.volume == pytest.approx(5.0, rel=1e-10)
    assert contact.area == pytest.approx(1.0, rel=1e-10)
    assert bodies.point_data["stress"].shape[1] == 6


def test_contact_file_names_pressure_gap_and_normal(tmp_path, bent):
    write_contact(tmp_path / "contact.vtu", Samples(bent, 3))
    mesh = meshio.read(tmp_path / "contact.vtu")
    (part,) = sample_contact(bent, bent.contacts[0], 3)
    for name in ("pressure", "gap", "normal"):
        np.testing.assert_array_equal(mesh.point_data[name], getattr(part, name))
    assert mesh.cell_data["face"][0].tolist() == [0] * len(part.cells)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, bent):
    path = tmp_path / "bodies.vtu"
    path.write_text("old")

    def full_disk(*_):
        raise OSError("no space left on device")

    with pytest.raises(OSError, match="no space"):
        write_bodies(path, Samples(bent, 3), full_disk)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("samples", range(2, 9))
def test_meshio_finds_every_array_whatever_their_lengths(tmp_path, bent, samples):
    columns = body_columns(bent.model, samples)
    offsets = np.cumsum([column.size for column in columns])[:-1]
    assert (offsets % 4 != 0).all()  # those that meshio makes of them are
    write_contact(tmp_path / "contact.vtu", Samples(bent, samples))
    mesh = meshio.read(tmp_path / "contact.vtu")
    (part,) = sample_contact(bent, bent.contacts[0], samples)
    np.testing.assert_array_equal(mesh.cells_dict["quad"], part.cells)
    np.testing.assert_array_equal(mesh.point_data["displacement"], part.displacement)
    assert mesh.field_data["samples"].tolist() == [samples]


def test_the_length_of_the_file_is_known_before_it_is_written(tmp_path, bent):
    write_bodies(tmp_path / "bodies.vtu", Samples(bent, 3), ignored)
    arrays = sum(column.size for column in body_columns(bent.model, 3))
    assert 0 < (tmp_path / "bodies.vtu").stat().st_size - arrays < 3000
