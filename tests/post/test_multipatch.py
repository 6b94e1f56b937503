"""What people look at of bodies of several glued patches."""

from dataclasses import replace

import meshio
import numpy as np
import pytest

import solve
from geom2iga import Model
from geom2iga.picture.skin import outer_faces
from post import export, verify
from post.fields import Samples, sample_contact, sample_patch
from post.vtu import write_bodies, write_contact
from solve.files import read_result, write_result
from tests.verification.glued_bodies import glued_model, pressed, wall


@pytest.fixture(scope="module")
def glued():
    """The contact patch test with four patches in either body."""
    lower = wall("l", (0, 0, 0), (2, 2, 1), 2)
    upper = wall("u", (0.5, 0.4, 1), (1, 1, 1), 1, ((1, 2), (3, 1), (1,)))
    model = glued_model({"lower": lower, "upper": upper})
    return solve.solve(model, pressed(("lower/left", "lower/front", "upper/left", "upper/front")))


@pytest.mark.parametrize(
    ("quantity", "on", "value"),
    [
        ("stress", None, [0.0, 0.0, -1.0, 0.0, 0.0, 0.0]),
        ("stress_zz", "lower", -1.0),
        ("stress_zz", "upper/top", -1.0),
        ("uz", "lower/top", -1e-3),
        ("pressure", None, 1.0),
        ("contact_force", "upper/bottom", [0.0, 0.0, 1.0]),
    ],
)
def test_bodies_and_groups_of_faces_are_verified_by_name(glued, quantity, on, value):
    given = {"quantity": quantity, "value": value, "tolerance": 1e-10} | ({} if on is None else {"on": on})
    (check,) = verify(glued, {"verify": [given]})
    assert check.passed, check


def test_the_gap_is_that_to_the_nearest_primary_face_that_looks_back(glued):
    (contact,) = glued.contacts
    faces = (*glued.model.faces("lower/top"), *glued.model.faces("upper/bottom"))
    groups = {**glued.model.groups, "lower/top": faces}  # the second half lies nearer and looks the other way
    more = replace(glued, model=Model(glued.model.patches, glued.model.bodies, groups, glued.model.glued))
    for part, expected in zip(*(sample_contact(result, contact, 3) for result in (more, glued)), strict=True):
        np.testing.assert_array_equal(part.gap, expected.gap)
        np.testing.assert_allclose(part.gap, -1 / contact.penalty, rtol=1e-6)


def test_files_hold_every_patch_once_and_number_bodies_not_patches(glued, tmp_path):
    write_bodies(tmp_path / "bodies.vtu", Samples(glued, 3), lambda name, part: None)
    write_contact(tmp_path / "contact.vtu", Samples(glued, 3))
    bodies, contact = (meshio.read(tmp_path / name) for name in ("bodies.vtu", "contact.vtu"))
    cells = [sum(len(sample_patch(glued, name, 3).cells) for name in names) for names in glued.model.bodies.values()]
    assert np.bincount(bodies.cell_data["body"][0]).tolist() == cells
    assert set(contact.cell_data["face"][0]) == {0, 1, 2, 3}
    np.testing.assert_allclose(contact.point_data["pressure"], 1, atol=1e-9)


def test_the_summary_lists_bodies_not_patches(glued, tmp_path):
    summary = export(glued, {"post": {"pictures": False}}, tmp_path)
    assert list(summary["bodies"]) == ["lower", "upper"]
    assert summary["contact"][0]["area"] == pytest.approx(1, rel=1e-12)


def test_glued_faces_are_not_drawn(glued):
    drawn = outer_faces(glued.model)
    assert len(drawn) == 2 * 4 * 4
    assert not {face for pair in glued.model.glued for face in (pair.first, pair.second)} & set(drawn)


def test_numbers_are_the_same_after_the_result_is_written_and_read(glued, tmp_path):
    write_result(tmp_path / "solution.h5", glued)
    again = read_result(tmp_path / "solution.h5")
    for name in glued.model.patches:
        np.testing.assert_array_equal(again.displacement_of(name), glued.displacement_of(name))
