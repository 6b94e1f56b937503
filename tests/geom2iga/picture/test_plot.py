import os
import subprocess
import sys
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.text import Text
from scipy.spatial.transform import Rotation

from geom2iga import Face, Glued, Model, build, evaluate, refined
from geom2iga.model import SIDES
from geom2iga.picture import plot, scene, sheet
from geom2iga.picture.labels import arranged, find_anchors, regions
from geom2iga.picture.scene import aimed, seen_numbers
from geom2iga.picture.skin import moved_apart, outer_faces, sample_skin
from geom2iga.projection import closest_points
from tests.cases import block_patch, hollow_cylinder, model_of, turned
from tests.strategies import SEEDS, bent_patches

ROOT = Path(__file__).parents[2]


def pipe():
    """A hollow cylinder of four glued quarters; one outer face has two names."""
    quarter = refined(hollow_cylinder(), 2)
    names = [f"pipe/{k}" for k in range(4)]
    patches = {
        name: replace(turned(quarter, Rotation.from_euler("z", 90 * k, degrees=True)), name=name)
        for k, name in enumerate(names)
    }
    sides = {"pipe/inner": (0, 0), "pipe/outer": (0, 1), "pipe/bottom": (2, 0), "pipe/top": (2, 1)}
    groups = {group: tuple(Face(name, *side) for name in names) for group, side in sides.items()}
    glued = [Glued(Face(names[k], 1, 1), Face(names[(k + 1) % 4], 1, 0), 0) for k in range(4)]
    return Model(patches, {"pipe": tuple(names)}, groups | {"clamp": (Face("pipe/1", 0, 1),)}, tuple(glued))


def blocks():
    """A block on a block: their common faces are hidden."""
    return model_of(block_patch("lower", size=(2, 2, 1), spans=(2, 2, 2)), block_patch("upper", (0.5, 0.5, 1)))


def anchors_of(model, directions=(plot.ABOVE, plot.BELOW)):
    """Anchors of the regions of a model, seen from several directions."""
    named = regions(model)
    skins = [sample_skin(model, face) for face in outer_faces(model)]
    number = {face: k for k, region in enumerate(named) for face in region.faces}
    owners = np.repeat(
        [number[s.face] if s.face in number else len(named) for s in skins], [len(s.cells) for s in skins]
    )
    mesh = plot._surface(skins, ["white"] * len(skins)).mesh
    cameras = [aimed(mesh.points, direction, (400, 400)) for direction in directions]
    samples = [np.concatenate([sample_skin(model, f).points.reshape(-1, 3) for f in r.faces]) for r in named]
    return named, find_anchors(samples, cameras, [seen_numbers(mesh, owners, camera) for camera in cameras])


def texts(figure):
    return {text.get_text() for text in figure.findobj(Text)}


CASE = {"geometry": {"block": [{"name": "lower", "size": [2, 2, 1]}, {"name": "upper", "size": [1, 1, 1]}]}}
DRAW = f"""
import sys, pathlib, geom2iga, geom2iga.__main__
assert not {{"pyvista", "vtk", "matplotlib"}} & set(sys.modules)
model = geom2iga.build({CASE})
from geom2iga.picture.plot import draw_geometry
print(*draw_geometry(model, pathlib.Path(sys.argv[1]), "mm"))
"""


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """A folder of pictures drawn by a process that has no display, and that imports pyvista only to draw."""
    folder = tmp_path_factory.mktemp("drawn")
    bare = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-c", DRAW, str(folder)]
    run = subprocess.run(command, cwd=ROOT, env=bare, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert sorted(run.stdout.split()) == sorted(path.name for path in folder.iterdir())
    return folder


@pytest.fixture(scope="module")
def faces():
    """Named faces of two blocks."""
    return plot.draw_faces(build(CASE), "mm")


def test_pictures_show_something_and_nothing_is_cut_off(drawn):
    paths = list(drawn.iterdir())
    assert len(paths) == 3
    for path in paths:
        image = matplotlib.image.imread(path)[..., :3]
        assert image.shape[1] >= 1600
        assert len(np.unique((image[::4, ::4].reshape(-1, 3) * 255).astype(int), axis=0)) > 100
        assert (image[[0, -1]] == 1).all()
        assert (image[:, [0, -1]] == 1).all()


def test_a_picture_is_the_same_each_time(drawn, faces, tmp_path):
    scene.save(faces, tmp_path / "faces.png")
    assert (tmp_path / "faces.png").read_bytes() == (drawn / "faces.png").read_bytes()


def test_every_name_is_on_a_label_and_bodies_drawn_apart_are_said_to_be(faces):
    assert {f"{body}/{side}" for body in ("lower", "upper") for side in SIDES} <= texts(faces)
    assert "Named faces; bodies drawn apart" in texts(faces)
    assert "size 2 x 2 x 1 mm" in texts(faces)


def test_faces_of_two_groups_bear_both_names_and_faces_without_a_name_are_counted():
    model = pipe()
    model = replace(model, groups={group: model.groups[group] for group in ("pipe/outer", "clamp", "pipe/top")})
    assert {"pipe/outer, clamp", "pipe/outer", "pipe/top", "without a name: 8 faces"} <= texts(plot.draw_faces(model))


def test_names_are_no_formulas():
    figure, axes = sheet.sheet(400, 100)
    sheet.write(axes, 10, 50, r"a$b$^2")
    figure.canvas.draw()
    assert axes.texts[0].get_window_extent().width == pytest.approx(sheet.text_width(r"a$b$^2"), rel=0.1)
    assert sheet.text_width("a$b$^2") > sheet.text_width("ab^2")


def test_regions_split_the_named_faces():
    model = pipe()
    found = regions(model)
    faces = [face for region in found for face in region.faces]
    assert sorted(faces, key=str) == sorted({face for group in model.groups.values() for face in group}, key=str)
    for region in found:
        for face in region.faces:
            assert region.names == tuple(group for group, members in model.groups.items() if face in members)


def test_labels_point_to_their_faces():
    model = pipe()
    named, views = anchors_of(model)
    assert {anchor.region for view in views for anchor in view} == set(range(len(named)))
    for anchor in (anchor for view in views for anchor in view):
        surfaces = [model.surface(face) for face in named[anchor.region].faces]
        assert min(np.abs(closest_points(s, anchor.point[None]).points - anchor.point).max() for s in surfaces) < 1e-9


def test_each_view_of_a_block_points_to_the_three_faces_that_it_shows():
    named, (above, below) = anchors_of(model_of(block_patch("block")))
    assert {named[a.region].text for a in above} == {"block/right", "block/front", "block/top"}
    assert {named[a.region].text for a in below} == {"block/left", "block/back", "block/bottom"}
    for anchor in (*above, *below):
        assert anchor.seen
        assert np.sort(np.abs(anchor.point - 0.5)) == pytest.approx([0, 0, 0.5], abs=0.05)


def test_a_hidden_face_is_pointed_at_and_said_to_be_hidden():
    named, views = anchors_of(blocks())
    hidden = [named[anchor.region].text for view in views for anchor in view if not anchor.seen]
    assert hidden == ["upper/bottom"]


def test_faces_in_contact_are_seen_when_bodies_are_drawn_apart():
    _, views = anchors_of(moved_apart(blocks()))
    assert all(anchor.seen for view in views for anchor in view)


def test_glued_faces_are_not_drawn():
    model = pipe()
    assert len(outer_faces(model)) == 4 * 6 - 8
    assert all(face.axis != 1 for face in outer_faces(model))


def test_a_body_inside_another_comes_out_of_it():
    apart = moved_apart(
        model_of(block_patch("hull", (-2, -2, -2), (4, 4, 4)), block_patch("core", (-1, -1, -1), (2, 2, 2)))
    )
    hull, core = (patch.control_points.reshape(-1, 3) for patch in apart.patches.values())
    assert np.any(core.min(axis=0) > hull.max(axis=0)) or np.any(core.max(axis=0) < hull.min(axis=0))


@given(SEEDS, st.integers(2, 6))
def test_boxes_of_bodies_drawn_apart_are_clear_and_bodies_keep_their_shape(seed, count):
    random = np.random.default_rng(seed)
    places, sizes = random.uniform(-1, 1, (count, 3)), random.uniform(0.2, 2, (count, 3))
    model = model_of(*(block_patch(f"b{k}", *both) for k, both in enumerate(zip(places, sizes, strict=True))))
    apart = moved_apart(model)
    boxes = []
    for name, patch in apart.patches.items():
        move = patch.control_points - model.patches[name].control_points
        np.testing.assert_allclose(move, np.broadcast_to(move[0, 0, 0], move.shape), atol=1e-12)
        points = patch.control_points.reshape(-1, 3)
        boxes.append((points.min(axis=0), points.max(axis=0)))
    for k, (low, high) in enumerate(boxes):
        assert all(np.any(low > other[1]) or np.any(high < other[0]) for other in boxes[:k])


@given(bent_patches())
def test_samples_and_knot_lines_lie_on_the_face(patch):
    model = model_of(patch)
    skin = sample_skin(model, Face(patch.name, 2, 1))
    surface = model.surface(skin.face)
    corners = surface.control_points[[0, 0, -1, -1], [0, -1, 0, -1]]
    np.testing.assert_allclose(skin.points[[0, 0, -1, -1], [0, -1, 0, -1]], corners, atol=1e-12)
    assert [len(k) for k in skin.knots] == [len(at) for at in surface.breaks]
    for axis in (0, 1):
        xi = np.full((len(surface.breaks[axis]), 2), surface.breaks[1 - axis][0])
        xi[:, axis] = surface.breaks[axis]
        border = skin.points[skin.knots[0], 0] if axis == 0 else skin.points[0, skin.knots[1]]
        np.testing.assert_allclose(border, evaluate(surface, xi)[0], atol=1e-12)
    inner = list(skin.lines(borders=False))
    assert len(inner) == sum(len(at) - 2 for at in surface.breaks)
    assert len(list(skin.lines(borders=True))) == 4
    for line in inner:
        assert np.abs(closest_points(surface, line[::8]).points - line[::8]).max() < 1e-8


@given(SEEDS, st.integers(1, 20), st.sampled_from([0.0, 300.0]), st.sampled_from([[20.0], [20.0, 34.0]]))
def test_labels_in_a_column_neither_overlap_nor_cross_their_lines(seed, count, x, tall):
    random = np.random.default_rng(seed)
    points = random.uniform([50, 100], [250, 300], (count, 2))
    heights = random.choice(tall, count)
    room = heights.sum() + random.uniform(0, 200)
    sequence, places = arranged(points, heights, x, 10.0, room)
    assert sorted(sequence) == list(range(count))
    upper, lower = places - heights[sequence] / 2, places + heights[sequence] / 2
    assert (upper[1:] >= lower[:-1] - 1e-9).all()
    assert upper[0] >= 10 - 1e-9
    assert lower[-1] <= 10 + room + 1e-9
    lines = [((x, place), points[number]) for number, place in zip(sequence, places, strict=True)]
    if len(tall) == 1:  # else the last shift, to make room for tall labels, may make two lines cross
        assert not any(crossing(*first, *second) for first, second in combinations(lines, 2))


def crossing(a, b, c, d):
    """Two segments cross inside of both."""

    def side(p, q, r):
        return np.sign((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0


def test_labels_with_room_stand_where_they_point():
    points = np.array([[50.0, 200.0], [60.0, 100.0]])
    sequence, places = arranged(points, np.array([20.0, 20.0]), 0.0, 0.0, 400.0)
    assert (sequence.tolist(), places.tolist()) == ([1, 0], [100.0, 200.0])


@given(SEEDS)
def test_a_camera_sees_all_points_in_its_room(seed):
    random = np.random.default_rng(seed)
    points = random.normal(size=(20, 3)) * random.uniform(0.1, 10, 3) + random.uniform(-1e3, 1e3, 3)
    camera = aimed(points, random.normal(size=3), (300, 200))
    pixels = camera.pixels(points)
    assert (pixels >= scene.MARGIN - 1).all()
    assert (pixels <= np.array(camera.size) - scene.MARGIN + 1).all()
    assert camera.size[0] <= 301
    assert camera.size[1] <= 201


def test_points_are_drawn_where_the_camera_says():
    model = model_of(block_patch("block", origin=(1e4, -2e4, 5e3), size=(3, 1, 2)))
    camera = aimed(model.patches["block"].control_points.reshape(-1, 3), plot.ABOVE, (300, 300))
    skins = [sample_skin(model, face) for face in outer_faces(model)]
    owners = np.repeat(np.arange(6), [len(skin.cells) for skin in skins])
    image = seen_numbers(plot._surface(skins, ["white"] * 6).mesh, owners, camera)
    for number, skin in enumerate(skins):
        shown = np.argwhere(image == number)[:, ::-1]
        if len(shown):
            expected = camera.pixels(skin.points[12, 12])
            assert np.abs(shown.mean(axis=0) + 0.5 - expected).max() < 1.5


@pytest.mark.parametrize(("text", "lines"), [("lower/top", 1), ("lower/top, upper/bottom", 1), ("a" * 30 + "/top", 2)])
def test_long_labels_are_broken_after_slashes_and_spaces(text, lines):
    found = sheet.wrapped(text).split("\n")
    assert len(found) == lines
    assert all(line.endswith(("/", ",")) for line, _ in pairwise(found))
    assert "".join(found).replace(" ", "") == text.replace(" ", "")
