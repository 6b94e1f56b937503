import ctypes

import matplotlib.image
import numpy as np
import pytest

import geom2iga
import solve
from geom2iga import UserError
from geom2iga.picture import scene
from geom2iga.picture.skin import outer_faces
from post import plots
from post.fields import Samples
from solve.newton import Step


def colours_of(figure, path):
    scene.save(figure, path)
    image = matplotlib.image.imread(path)
    assert image.shape[0] >= 800
    return {tuple(colour) for colour in (image[::4, ::4, :3].reshape(-1, 3) * 255).astype(int).tolist()}


def test_displacement_of_the_patch_test_shows_the_whole_colour_range(tmp_path, patch_test):
    figure = plots.draw_displacement(Samples(patch_test, 5), "UL")
    assert len(colours_of(figure, tmp_path / "u.png")) > 200
    assert "[UL]" in figure.axes[1].get_ylabel()
    low, high = figure.axes[1].get_ylim()
    assert (low, high) == pytest.approx((-2.01e-3, 0.0), abs=1e-12)


def test_a_uniform_stress_is_drawn_in_one_colour_and_said_to_be_uniform(tmp_path, patch_test):
    figure = plots.draw_stress(Samples(patch_test, 5))
    assert "uniform, -1 ±" in figure.get_suptitle()
    colours_of(figure, tmp_path / "s.png")


def test_pressure_picture_spans_the_pressure(tmp_path, bent):
    figure = plots.draw_pressure(Samples(bent, 5), "MPa")
    assert len(colours_of(figure, tmp_path / "p.png")) > 100
    assert "MPa" in figure.axes[1].get_ylabel()


def test_a_tall_scene_is_drawn_whole(tmp_path, case):
    import geom2iga
    import solve

    apart = case.changed({"geometry.block.1.origin": [0.5, 0.5, 4.0]})
    result = solve.solve(geom2iga.build(apart), apart)
    scene.save(plots.draw_pressure(Samples(result, 5)), tmp_path / "tall.png")
    image = matplotlib.image.imread(tmp_path / "tall.png")[..., :3]
    assert (image[0] == 1).all()
    assert (image[-1] == 1).all()


def test_rounding_errors_of_one_component_are_not_drawn_as_a_field(tmp_path, patch_test):
    noise = np.array([1e-13, -1e-13])
    (low, high), remark = plots._limits(noise, size=1.0)
    assert high - low > 0.05
    assert "uniform" in remark


def test_knot_lines_lie_on_the_deformed_faces(bent):
    from geom2iga import Face

    lines = list(plots._knot_lines(Samples(bent, 5), Face("lower", 2, 1), 0.0))
    assert len(lines) == 5 + 5
    assert all(np.allclose(line[:, 2], 1.0) for line in lines)


def test_displacements_are_enlarged_by_a_round_factor(patch_test, bent):
    for result in (patch_test, bent):
        scale = plots.deformation_scale(result)
        size = np.linalg.norm(np.ptp(result.space.control_points, axis=0))
        drawn = scale * np.linalg.norm(result.state.displacement, axis=1).max() / size
        assert plots.VISIBLE / 3 < drawn <= plots.VISIBLE
        assert scale / 10 ** np.floor(np.log10(scale)) == pytest.approx(round(scale / 10 ** np.floor(np.log10(scale))))


def test_newton_picture_shows_every_step(tmp_path):
    history = [Step(n, 10.0 ** (-4 * n), 10 + n, n, 1.0, -1.0, 0.1) for n in range(1, 5)]
    figure = plots.draw_newton(history)
    np.testing.assert_allclose(figure.axes[0].lines[0].get_ydata(), [s.residual for s in history])
    colours_of(figure, tmp_path / "n.png")


def test_missing_drawing_libraries_are_named(monkeypatch):
    def missing(name):
        raise OSError(name)

    monkeypatch.setattr(scene.sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", missing)
    with pytest.raises(UserError, match=r"libegl1.*or draw nothing"):
        scene.check_renderer("draw nothing")


def test_the_force_of_each_contact_is_drawn_over_the_share_of_the_loads(case):
    stepped = case.changed({"solve.steps": {"factors": [0.2, 0.6, 1.0]}})
    result = solve.solve(geom2iga.build(stepped), stepped)
    (line,) = plots.draw_load_steps(result, "F").axes[0].lines
    np.testing.assert_allclose(line.get_xdata(), [0.2, 0.6, 1.0])
    np.testing.assert_allclose(line.get_ydata(), [0.2, 0.6, 1.0], rtol=1e-9)


def test_samples_at_hand_are_drawn_where_they_are_fine_and_fewer_where_there_are_too_many(bent, monkeypatch):
    coarse, fine = Samples(bent, 2), Samples(bent, 8)
    assert plots.drawn(coarse).count == plots.SAMPLES
    monkeypatch.setattr(plots, "FINE", 1000)
    assert plots.drawn(fine) is fine
    spans = 2 * 16 + 4 * 16 + 2 * (3 * 2 + 3 * 2 + 2 * 2)  # of the outer faces
    for quads in (1, 3):
        monkeypatch.setattr(plots, "FINEST", spans * quads**2 + 1)
        assert plots.drawn(fine).count == quads + 1


def test_knot_lines_are_thinner_where_they_are_dense_and_left_out_where_they_would_hide_the_colours(bent, monkeypatch):
    samples, faces = Samples(bent, 3), outer_faces(bent.model)
    lines, width = plots._visible_lines(samples, faces, 0.0)
    assert width == plots.WIDEST
    monkeypatch.setattr(plots, "DENSITY", plots.DENSITY / 20)
    same, thinner = plots._visible_lines(samples, faces, 0.0)
    assert plots.THINNEST <= thinner < width
    assert len(same) == len(lines)
    monkeypatch.setattr(plots, "DENSITY", plots.DENSITY / 20)
    assert len(plots._visible_lines(samples, faces, 0.0)[0]) == 4 * len(faces)
