import logging
import shutil
from collections import Counter

import numpy as np
import pytest

from geom2iga import CaseError
from post import export, fields, grid
from post.fields import Samples, sample_patch
from post.grid import count_points


def test_every_sample_point_is_evaluated_and_every_contact_searched_once(bent, tmp_path, monkeypatch):
    seen = Counter()

    def counted(name):
        original = getattr(fields, name)

        def call(*arguments):
            found = original(*arguments)
            seen[name] += found[0].shape[-1] if name == "_evaluate_brick" else 1
            return found

        monkeypatch.setattr(fields, name, call)

    counted("_evaluate_brick")
    counted("nearest_feet")
    checks = [
        {"quantity": "von_mises", "value": 1.0, "tolerance": 9.0},
        {"quantity": "stress_zz", "on": "lower", "value": 0.0, "tolerance": 9.0},
        {"quantity": "gap", "value": 0.0, "tolerance": 9.0},
    ]
    export(bent, {"post": {"samples": 3, "pictures": False, "report": False}, "verify": checks}, tmp_path)
    assert seen["_evaluate_brick"] == sum(count_points(patch, 3)[0] for patch in bent.model.patches.values())
    assert seen["nearest_feet"] == 1


def test_fewer_samples_than_usual_are_said(bent, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(grid, "MANY", 2000)  # 13³ + 10 x 7 x 7 are 2687
    with caplog.at_level(logging.INFO):
        export(bent, {"post": {"pictures": False}}, tmp_path)
    assert "3 sample points per span and direction, as 4 would make 0.0027 million" in caplog.text


def test_a_file_that_the_disk_has_no_room_for_is_refused_before_it_is_begun(bent, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: shutil._ntuple_diskusage(10**6, 10**6 - 10, 10))
    with pytest.raises(CaseError, match=r"post\.samples: 4 points .* take fewer"):
        export(bent, {"post": {"pictures": False}}, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_extremes_and_worst_values_are_those_of_all_slabs(bent, tmp_path, monkeypatch):
    parts = {body: sample_patch(bent, body, 3) for body in bent.model.bodies}
    values = np.concatenate([part.stress[:, 2] for part in parts.values()])
    monkeypatch.setattr(grid, "LONG", 1)
    monkeypatch.setattr(grid, "SLAB", 1)
    check = {"quantity": "stress_zz", "value": -1.0, "tolerance": 9.0}
    summary = export(bent, {"post": {"samples": 3, "pictures": False}, "verify": [check]}, tmp_path)
    worst = values[np.abs(values + 1).argmax()]
    assert summary["verify"][0]["found"] == pytest.approx(worst, rel=1e-12)
    assert summary["verify"][0]["difference"] == pytest.approx(abs(worst + 1), rel=1e-12)
    for body, part in parts.items():
        found = summary["bodies"][body]
        largest = np.linalg.norm(part.displacement, axis=1).max()
        assert found["displacement_max"] == pytest.approx(largest, rel=1e-12)
        np.testing.assert_allclose(found["stress_min"], part.stress.min(axis=0), rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(found["stress_max"], part.stress.max(axis=0), rtol=1e-11, atol=1e-13)


def test_all_pictures_share_the_samples_of_faces_and_contacts(bent):
    samples = Samples(bent, 3)
    (face,) = bent.model.faces("upper/bottom")
    assert samples.face(face) is samples.face(face)
    assert samples.secondary is samples.secondary
    assert samples.secondary[0] is samples.contacts[bent.contacts[0]][0]


def test_a_file_in_the_place_of_the_folder_or_of_its_summary_is_refused(bent, bent_case, tmp_path):
    (tmp_path / "a_file").write_text("mine")
    (tmp_path / "summary.json").write_text("mine")
    with pytest.raises(CaseError, match="a_file: a file, not a folder"):
        export(bent, bent_case, tmp_path / "a_file")
    with pytest.raises(CaseError, match=r"summary\.json: not written by this program"):
        export(bent, bent_case, tmp_path)
    assert {path.read_text() for path in tmp_path.iterdir()} == {"mine"}
