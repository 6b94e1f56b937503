import base64
import io
import json
import re
import zipfile
from dataclasses import replace

import numpy as np
import pytest

import geom2iga
import solve
from geom2iga.picture.skin import outer_faces
from post.fields import Samples
from post.report import scene
from tests.cases import patch_test_case


@pytest.fixture
def samples(bent):
    return Samples(bent, 3)


def area(piece):
    """Area of the quadrilaterals of a piece, each as two triangles."""
    corners = piece.points.reshape(-1, 3)[piece.cells]
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    return float(np.linalg.norm(np.cross(first, second), axis=1).sum() / 2)


def unpacked(page):
    """The scene that a page holds, as vtk.js reads it."""
    packed = base64.b64decode(re.search(r'base64Str = "([^"]*)"', page)[1])
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        return json.loads(archive.read("index.json"), parse_constant=lambda name: pytest.fail(f"{name} in JSON"))


def fields(description):
    """The arrays that the meshes of a scene refer to."""
    for entry in description.get("dependencies", description.get("scene", {}).get("dependencies", [])):
        yield from entry["properties"].get("fields", [])
        yield from fields(entry)


def test_all_outer_faces_are_shown_whole(samples):
    pieces = scene.sample_pieces(samples, 0.0)
    assert len(pieces) == len(outer_faces(samples.result.model)) == 12
    assert sum(map(area, pieces)) == pytest.approx(16.0 + 6.0, rel=1e-12)


@pytest.mark.parametrize("most", [1, 7, 50])
def test_a_fine_mesh_is_thinned_but_still_whole(samples, most, monkeypatch):
    monkeypatch.setattr(scene, "MOST", most)
    pieces = scene.sample_pieces(samples, 0.0)
    assert sum(map(area, pieces)) == pytest.approx(16.0 + 6.0, rel=1e-12)
    assert sum(len(piece.cells) for piece in pieces) <= max(2 * most, len(pieces))


def test_places_are_displaced_as_often_as_asked(samples):
    at_rest, moved, twice = (scene.sample_pieces(samples, scale) for scale in (0.0, 1.0, 2.0))
    for still, once, more in zip(at_rest, moved, twice, strict=True):
        np.testing.assert_allclose(more.points - still.points, 2 * (once.points - still.points), atol=1e-14)
    assert max(np.abs(piece.points - rest.points).max() for piece, rest in zip(moved, at_rest, strict=True)) > 1e-4


def test_knot_lines_are_drawn_between_spans_and_borders_alone_where_they_are_dense(samples, monkeypatch):
    model = samples.result.model
    for face, piece in zip(outer_faces(model), scene.sample_pieces(samples, 0.0), strict=True):
        assert [len(knots) for knots in piece.knots] == [len(at) for at in model.surface(face).breaks]
    monkeypatch.setattr(scene, "DENSEST", 1)
    assert {len(knots) for piece in scene.sample_pieces(samples, 0.0) for knots in piece.knots} == {2}


def test_no_cell_bridges_a_line_across_which_stress_jumps():
    case = patch_test_case(degree=1, lower_spans=(2, 2, 2), upper_spans=(2, 2, 2))
    result = solve.solve(geom2iga.build(case), case)
    for piece in scene.sample_pieces(Samples(result, 3), 0.0):
        corners = piece.points.reshape(-1, 3)[piece.cells]
        assert np.linalg.norm(corners[:, 2] - corners[:, 0], axis=1).min() > 1e-3


def test_the_page_holds_von_mises_stress_in_single_precision(samples):
    drawn = scene.draw_scene(samples, 1.0)
    arrays = {entry["name"]: entry for entry in fields(unpacked(drawn.page))}
    pieces = scene.sample_pieces(samples, 1.0)
    expected = np.concatenate([piece.field.ravel() for piece in pieces])
    assert arrays["von_mises"]["dataType"] == "Float32Array"
    assert arrays["von_mises"]["ranges"][0]["min"] == pytest.approx(expected.min(), rel=1e-6)
    assert arrays["von_mises"]["ranges"][0]["max"] == pytest.approx(expected.max(), rel=1e-6)
    assert (drawn.low, drawn.high) == (expected.min(), expected.max())
    assert len(set(drawn.colours)) == len(drawn.colours)


def test_stress_that_is_not_defined_somewhere_leaves_the_scene_readable(samples):
    samples = Samples(samples.result, scene.FINEST)
    face = outer_faces(samples.result.model)[0]
    part = samples.face(face)
    stress = part.stress.copy()
    stress[0] = np.nan
    samples._faces[face] = replace(part, stress=stress)
    assert np.isnan(scene.sample_pieces(samples, 1.0)[0].field[0, 0])
    assert unpacked(scene.draw_scene(samples, 1.0).page)
