import ctypes

import matplotlib.image
import numpy as np
import pytest

from geom2iga import CaseError, UserError
from geom2iga.picture import scene
from geom2iga.picture.skin import outer_faces
from geom2iga.tables import Units
from post import plots
from post.case import Cut
from post.fields import Samples
from post.plots import bodies, lines, page, style
from post.plots import cut as cutting
from post.quantities import QUANTITIES

UNITS = Units(length="UL", force="F")
ACROSS = Cut(origin=(1.0, 1.0, 0.5), normal=(0.0, -1.0, 0.0))


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
    plots.draw_bodies(Samples(patch_test, 4), "ux", scale=1.0, cut=ACROSS)
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
    image = image_of(plots.draw_bodies(Samples(bent, 5), "ux", scale=0.0, bodies=["lower"], cut=ACROSS))
    points = np.array([[x, y, z] for x in (0.0, 2.0) for y in (1.0, 2.0) for z in (0.0, 1.0)])
    camera = scene.aimed(points, cutting.view_of(ACROSS.normal), page.ROOM)
    assert camera.size == image.shape[1::-1]
    inner = np.array([[x, 1.0, z] for x in np.arange(0.1, 2.0, 0.25) for z in (0.1, 0.35, 0.9)])  # off the knot lines
    right, down = camera.pixels(inner).round().astype(int).T
    light = image[down, right] / style.SEQUENTIAL(inner[:, 0] / 4.0)[:, :3] / 255
    assert 0.8 < light.mean() < 1.05  # on a plane it is the same everywhere
    np.testing.assert_allclose(light, light.mean(), rtol=0.06)


def test_a_plane_through_sample_points_keeps_all_its_knot_lines(bent):
    cut = cutting.moved_back(Cut(origin=(0, 0, 0), normal=(1.0, -1.0, 0.0)), 3.0)
    _, edges = cutting.cut_faces(bent, ["lower"], QUANTITIES["uz"], cut)
    (mesh,) = edges
    length = sum(np.linalg.norm(np.diff(np.asarray(cell.points), axis=0)) for cell in mesh.cell)
    crossed = (2 * 5 - 2) * 1.0 + 5 * 2 * 2**0.5  # by x = y: knots of x and y, in two corners one of both, and of z
    assert length == pytest.approx(crossed, rel=1e-3)


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
        plots.draw_bodies(samples, "uz", bodies=["uper"])
    with pytest.raises(CaseError, match="nothing lies behind the plane"):
        plots.draw_bodies(samples, "uz", cut=Cut(origin=(0, 0, -1), normal=(0, 0, 1)))


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


def test_missing_drawing_libraries_are_named(monkeypatch):
    def missing(name):
        raise OSError(name)

    monkeypatch.setattr(scene.sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", missing)
    with pytest.raises(UserError, match=r"libegl1.*or draw nothing"):
        scene.check_renderer("draw nothing")
