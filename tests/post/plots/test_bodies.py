import ctypes

import matplotlib.image
import numpy as np
import pytest

from geom2iga import CaseError, UserError
from geom2iga.picture import scene
from geom2iga.picture.skin import outer_faces
from geom2iga.tables import Units, checked
from post import plots
from post.case import Cut, Look, Picture, PostCase
from post.fields import Samples
from post.plots import bodies, lines, page, style
from post.plots import cut as cutting
from post.quantities import QUANTITIES

UNITS = Units(length="UL", force="F")
ACROSS = Look(cut=Cut(origin=(1.0, 1.0, 0.5), normal=(0.0, -1.0, 0.0)))


def pixels(figure, path):
    """Colours (h, w, 3) of a figure written as PNG."""
    scene.save(figure, path)
    return (matplotlib.image.imread(path)[..., :3] * 255).round().astype(int)


def image_of(figure):
    """The rendered image alone."""
    return figure.axes[0].images[0].get_array().astype(int)


def test_displacement_of_the_patch_test_shows_the_whole_colour_range(tmp_path, patch_test):
    figure = plots.draw_bodies(Samples(patch_test, 5), "uz", UNITS)
    image = pixels(figure, tmp_path / "u.png")
    assert image.shape[0] >= 800
    assert len({tuple(colour) for colour in image[::4, ::4].reshape(-1, 3).tolist()}) > 200
    low, high = figure.axes[1].get_ylim()
    assert (low, high) == pytest.approx((-2.01, 0.0), abs=1e-9)
    assert figure.axes[1].get_ylabel() == "displacement along z $u_z$ [$10^{-3}$ UL]"


@pytest.mark.parametrize("field", ["ux", "von_mises", "principal_3", "hydrostatic_pressure"])
def test_every_field_bears_its_title_and_its_unit(bent, field):
    label = plots.draw_bodies(Samples(bent, 2), field, UNITS).axes[1].get_ylabel()
    assert QUANTITIES[field].title in label
    assert label.endswith("UL]" if field == "ux" else "F/UL²]")


def test_a_uniform_stress_is_drawn_in_one_colour_and_said_to_be_uniform(patch_test):
    figure = plots.draw_bodies(Samples(patch_test, 5), "stress_zz")
    assert any("uniform, −1 ±" in text.get_text() for text in figure.axes[0].texts)


def test_a_rounding_error_of_one_component_is_not_drawn_as_a_field(patch_test):
    figure = plots.draw_bodies(Samples(patch_test, 3), "stress_xy")
    assert any("uniform" in text.get_text() for text in figure.axes[0].texts)


def test_nothing_is_cut_off_at_the_edges_of_the_page(tmp_path, bent):
    image = pixels(plots.draw_bodies(Samples(bent, 3), "von_mises", UNITS), tmp_path / "all.png")
    assert all((edge == 255).all() for edge in (image[0], image[-1], image[:, 0], image[:, -1]))


def test_the_inside_is_seen_on_the_face_that_a_plane_cuts(patch_test, monkeypatch):
    """The displacement along x of the patch test is linear: νp/E x, and only the cut shows it without light."""
    seen = []
    monkeypatch.setattr(bodies, "draw_page", lambda layers, direction, scale, *rest: seen.append((layers, scale)))
    plots.draw_bodies(Samples(patch_test, 4), "ux", scale=1.0, look=ACROSS)
    (surface, edges), _ = seen[0]
    at, field = np.asarray(surface.mesh.points), np.asarray(surface.mesh["field"])
    on_plane = np.abs(at[:, 1] - 1.0) < 1e-3
    np.testing.assert_allclose(field, 0.3 / 1000 * (at[:, 0] - 0.5 * (at[:, 2] > 1.0001)), atol=2e-4)
    assert {(0.0, 0.0), (2.0, 1.0), (0.5, 2.0)} <= {(round(x, 1), round(z, 1)) for x, _, z in at[on_plane]}
    assert at[:, 1].min() > 0.999
    assert np.asarray(edges.mesh.points)[:, 1].min() > 0.999


def test_the_pixels_of_a_cut_have_the_colours_of_the_values_inside(bent, monkeypatch):
    product = QUANTITIES["ux"]._replace(values=lambda part: part.points[:, 0] * part.points[:, 1])
    monkeypatch.setitem(bodies.QUANTITIES, "ux", product)
    lower = ACROSS.model_copy(update={"bodies": ("lower",)})
    image = image_of(plots.draw_bodies(Samples(bent, 5), "ux", scale=0.0, look=lower))
    points = np.array([[x, y, z] for x in (0.0, 2.0) for y in (1.0, 2.0) for z in (0.0, 1.0)])
    camera = scene.aimed(points, cutting.view_of(ACROSS.cut.normal), page.ROOM)
    assert camera.size == image.shape[1::-1]
    inner = np.array([[x, 1.0, z] for x in np.arange(0.1, 2.0, 0.25) for z in (0.1, 0.35, 0.9)])  # off the knot lines
    right, down = camera.pixels(inner).round().astype(int).T
    light = image[down, right] / style.SEQUENTIAL(inner[:, 0] / 4.0)[:, :3] / 255
    assert 0.8 < light.mean() < 1.05  # on a plane it is the same everywhere
    np.testing.assert_allclose(light, light.mean(), rtol=0.06)


def test_a_plane_through_sample_points_keeps_all_its_knot_lines(bent):
    cut = cutting.moved_back(Cut(origin=(0, 0, 0), normal=(1.0, -1.0, 0.0)), 3.0)
    _, edges = cutting.cut_faces(Samples(bent, 5), ["lower"], QUANTITIES["uz"], cut)
    (mesh,) = edges
    length = sum(np.linalg.norm(np.diff(np.asarray(cell.points), axis=0)) for cell in mesh.cell)
    crossed = (2 * 5 - 2) * 1.0 + 5 * 2 * 2**0.5  # by x = y: knots of x and y, in two corners one of both, and of z
    assert length == pytest.approx(crossed, rel=1e-3)


def test_the_normal_of_a_cut_may_have_any_length(bent):
    tiny = Cut(origin=(1.0, 1.0, 0.5), normal=(0.0, -1e-200, 0.0))
    plain, same = (
        image_of(plots.draw_bodies(Samples(bent, 2), "uz", look=Look(cut=cut))) for cut in (ACROSS.cut, tiny)
    )
    np.testing.assert_array_equal(plain, same)


def test_a_cut_is_looked_at_from_its_front():
    for normal in np.vstack([np.eye(3), -np.eye(3), [[1, 1, 0], [-1, 2, 5]]]):
        view = cutting.view_of(normal)
        assert np.dot(view, normal) > 0.6 * np.linalg.norm(view) * np.linalg.norm(normal)
        assert sorted(np.abs(view)) == sorted(np.abs(scene.ABOVE))
    assert cutting.view_of((0, -1, 0)) == scene.ABOVE


def test_bodies_and_fields_that_there_are_not_and_planes_before_everything_are_refused(bent):
    samples = Samples(bent, 2)
    with pytest.raises(CaseError, match='did you mean "von_mises"'):
        plots.draw_bodies(samples, "von_mise")
    with pytest.raises(CaseError, match='did you mean "upper"'):
        plots.draw_bodies(samples, "uz", look=Look(bodies=("uper",)))
    with pytest.raises(CaseError, match="nothing lies behind the plane"):
        plots.draw_bodies(samples, "uz", look=Look(cut=Cut(origin=(0, 0, -1), normal=(0, 0, 1))))


def test_knot_lines_lie_on_the_faces_deformed_or_not(bent):
    from geom2iga import Face

    points, moved = zip(*lines.families(Samples(bent, 5), Face("lower", 2, 1)), strict=True)
    assert [len(family) for family in points] == [5, 5]
    assert all(np.allclose(family[..., 2], 1.0) for family in points)
    assert all(family.shape == other.shape for family, other in zip(points, moved, strict=True))


def test_knot_lines_are_thinner_where_they_are_dense_and_left_out_where_they_would_hide_the_colours(bent, monkeypatch):
    samples, faces = Samples(bent, 3), outer_faces(bent.model)
    found, width = lines.knot_lines(samples, faces, 3.0)
    assert width == lines.WIDEST
    monkeypatch.setattr(lines, "DENSITY", lines.DENSITY / 20)
    same, thinner = lines.knot_lines(samples, faces, 3.0)
    assert lines.THINNEST <= thinner < width
    assert [len(f[0]) for f in same] == [len(f[0]) for f in found]
    monkeypatch.setattr(lines, "DENSITY", lines.DENSITY / 20)
    assert sum(len(family[0]) for family in lines.knot_lines(samples, faces, 3.0)[0]) == 4 * len(faces)


def test_samples_at_hand_are_drawn_where_they_are_fine_and_others_where_they_are_not(bent, monkeypatch):
    coarse, fine = Samples(bent, 2), Samples(bent, 8)
    assert plots.drawn(coarse).count == bodies.SAMPLES
    monkeypatch.setattr(bodies, "FINE", 1000)
    assert plots.drawn(fine) is fine
    spans = 2 * 16 + 4 * 16 + 2 * (3 * 2 + 3 * 2 + 2 * 2)  # of the outer faces
    for quads in (1, 3):
        monkeypatch.setattr(bodies, "FINE", spans * quads**2 - 1)
        monkeypatch.setattr(bodies, "FINEST", spans * quads**2 + 1)
        assert plots.drawn(fine).count == quads + 1


def test_a_result_is_plotted_without_files(bent):
    figure = plots.plot(bent, units=UNITS)
    assert "von Mises" in figure.axes[1].get_ylabel()


@pytest.mark.parametrize("view", [(0, 0, 1), (0, 0, -3), (1, 0, 0), (-2, 1, 1e-9), (1e-9, 0, 1), (0, -1e-200, 0)])
def test_any_direction_can_be_looked_from(view):
    """What is further up in the image is further along z, seen from above or below along y; right-handed."""
    right, down, towards = axes = scene.screen(scene.aimed(np.eye(3), view, (100, 100)).direction)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(towards, np.array(view) / np.hypot(np.hypot(*view[:2]), view[2]))
    np.testing.assert_allclose(np.cross(right, -down), towards, atol=1e-12)
    assert -down[1 if view[2] in (1, -3) else 2] > 0.99


def test_a_picture_from_above_shows_what_is_above(patch_test):
    """The lower block is two by two; from above and from below it is seen as a square, of uz of its own side."""
    for sign in (1, -1):
        look = Look(view=(0, 0, sign), bodies=("lower",), knot_lines=False)
        image = image_of(plots.draw_bodies(Samples(patch_test, 2), "uz", scale=0.0, look=look))
        assert image.shape[0] == pytest.approx(image.shape[1], abs=2)
        ratio = image[image.shape[0] // 2, image.shape[1] // 2] / style.SEQUENTIAL(0.0 if sign > 0 else 1.0)[:3] / 255
        np.testing.assert_allclose(ratio, ratio.mean(), rtol=0.06)


def test_the_box_fills_the_picture_and_what_is_around_is_cut_off(bent, monkeypatch):
    """Seen from the front, half a length of a box is half of the picture; the bodies go on beyond it."""
    seen = []
    page_of = bodies.draw_page
    monkeypatch.setattr(bodies, "draw_page", lambda *given: seen.append(given[-1]) or page_of(*given))
    corners = ((0.5, 0.0, 0.2), (1.5, 1.0, 0.7))
    figure = plots.draw_bodies(Samples(bent, 2), "uz", scale=0.0, look=Look(view=(0, -1, 0), box=corners[::-1]))
    assert {tuple(point) for point in seen[0].tolist()} >= set(corners)
    image = image_of(figure)
    assert np.array(image.shape[1::-1]) == pytest.approx(np.array([page.ROOM[0], page.ROOM[0] / 2]), rel=0.02)
    assert (image < 255).any(axis=2).all()
    assert len(figure.axes[0].patches) == 1 + len(plots.draw_bodies(Samples(bent, 2), "uz").axes[0].patches)


def test_what_is_far_in_front_of_a_small_part_hides_it():
    wall = np.array([[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]])
    layers = [
        scene.Layer(
            scene.quadrilaterals(wall + np.array([0, y, 0]), np.arange(4)[None]), {"color": colour, "lighting": False}
        )
        for y, colour in ((0.0, "red"), (-5.0, "blue"))
    ]
    image = scene.seen(layers, scene.aimed(1e-4 * wall, (0, -1, 0), (60, 60)))
    assert {tuple(colour) for colour in image.reshape(-1, 3).tolist()} == {(0, 0, 255)}


def test_limits_end_the_colours_and_values_beyond_have_those_of_the_ends(patch_test):
    look = Look(limits=(-0.001, 0.0), view=(0, -1, 0), bodies=("upper",), knot_lines=False)
    figure = plots.draw_bodies(Samples(patch_test, 3), "uz", scale=0.0, look=look)
    assert figure.axes[1].get_ylim() == (-1.0, 0.0)
    assert "values from −0.00201 to −0.00101" in figure.axes[0].texts[-2].get_text()
    image = image_of(figure)[20:-20, 20:-20]
    assert np.ptp(image.reshape(-1, 3), axis=0).max() <= 2


def test_without_knot_lines_the_edges_of_patches_are_left(bent):
    look = ACROSS.model_copy(update={"knot_lines": False})
    drawn = []
    for each in (ACROSS, look):
        found, _ = lines.knot_lines(Samples(bent, 2), outer_faces(bent.model), 3.0, each.knot_lines)
        _, edges = cutting.cut_faces(Samples(bent, 5), ["lower"], QUANTITIES["uz"], each.cut, each.knot_lines)
        (mesh,) = edges
        length = sum(np.linalg.norm(np.diff(np.asarray(cell.points), axis=0)) for cell in mesh.cell)
        drawn.append((sum(len(family[0]) for family in found), length))
    assert drawn[1][0] == 4 * len(outer_faces(bent.model)) < drawn[0][0]
    assert drawn[1][1] == pytest.approx(2 * (2.0 + 1.0), rel=1e-3)
    assert drawn[0][1] > drawn[1][1]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"view": [0, 0, 0]}, "view: has no length"),
        ({"box": [[0, 0, 0], [1, 0, 1]]}, "box: is empty"),
        ({"limits": [1.0, 1.0]}, "limits: the first should be below the second"),
    ],
)
def test_looks_that_show_nothing_are_refused(wrong, message):
    with pytest.raises(CaseError, match=rf"post.picture\[0\]: {message}"):
        checked({"post": {"picture": [{"name": "a", "field": "uz", **wrong}]}}, PostCase)


def test_a_picture_of_the_case_is_the_look_that_draws_it(bent):
    picture = Picture(name="a", field="uz", view=(0, 0, 1), limits=(-1.0, 1.0))
    assert plots.draw_bodies(Samples(bent, 2), picture.field, UNITS, 1.0, picture).axes[1].get_ylim() == (-1, 1)


def test_missing_drawing_libraries_are_named(monkeypatch):
    def missing(name):
        raise OSError(name)

    monkeypatch.setattr(scene.sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", missing)
    with pytest.raises(UserError, match=r"libegl1.*or draw nothing"):
        scene.check_renderer("draw nothing")
