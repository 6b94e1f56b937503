import zlib
from dataclasses import replace
from math import nan

import numpy as np
import pytest
from matplotlib.colors import to_rgb

import geom2iga
import solve
from geom2iga.picture import scene
from geom2iga.tables import Units
from post import plots
from post.case import PostCase
from post.fields import Samples
from post.plots import Curve, Label, style
from post.probes import sample_probes
from solve.newton import Step

UNITS = Units(length="mm", force="N")
SIZES = 0.5 ** np.arange(1, 5)


def steps(count, load_steps=1):
    """A history that converges in each load step."""
    each = count // load_steps
    return [
        Step(n, 10.0 ** (-4 * (1 + (n - 1) % each)), 10 + n, n, 1.0, -1.0, 0.1, load_step=1 + (n - 1) // each)
        for n in range(1, count + 1)
    ]


def convergence():
    return plots.draw_convergence(
        [Curve(f"degree {p}", SIZES, 0.1 * SIZES**p) for p in (1, 2)], error=Label("error of the pressure", "%")
    )


def lightness(colour):
    """CIE L* of a colour (3,), as a print without colours shows it."""
    linear = np.where(np.array(colour) > 0.04045, ((np.array(colour) + 0.055) / 1.055) ** 2.4, np.array(colour) / 12.92)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    return 116 * np.cbrt(luminance) - 16


def test_slopes_are_those_of_the_errors():
    for order in (1.0, 2.5):
        assert plots.observed_slope(Curve("", SIZES, 3 * SIZES**order)) == pytest.approx(order)
    assert plots.observed_slope(Curve("", SIZES**-3.0, SIZES**2)) == pytest.approx(-2 / 3)


def test_triangles_have_the_slope_that_is_written_on_them():
    axes = convergence().axes[0]
    for triangle, order in zip(axes.patches, (1, 2), strict=True):
        (x0, y0), (x1, y1) = triangle.get_xy()[:2]
        assert np.log(y1 / y0) / np.log(x1 / x0) == pytest.approx(order)
    assert [text.get_text() for text in axes.texts] == ["1", "2"]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == [
        f"degree {p}, observed slope {p}.00" for p in (1, 2)
    ]
    assert axes.get_ylabel() == "error of the pressure [%]"


def test_expected_slopes_are_drawn_beside_observed_ones():
    axes = plots.draw_convergence([Curve("", SIZES**-3.0, SIZES**2)], Label("unknowns"), expected=[-0.5]).axes[0]
    assert [text.get_text() for text in axes.texts] == ["−0.5"]


def test_newton_picture_shows_every_step_and_what_is_active():
    above, below = plots.draw_newton(steps(4), "points").axes
    np.testing.assert_allclose(above.lines[0].get_ydata(), [step.residual for step in steps(4)])
    np.testing.assert_allclose(below.lines[0].get_ydata(), [11, 12, 13, 14])
    assert below.get_ylabel() == "active\npoints"


def test_a_single_newton_step_has_the_only_tick():
    above, below = plots.draw_newton(steps(1)).axes
    for axes in (above, below):
        low, high = axes.get_xlim()
        assert [tick for tick in axes.get_xticks() if low <= tick <= high] == [1]
    assert all(tick == round(tick) for tick in below.get_yticks())


def test_load_steps_are_set_apart_in_the_newton_picture_and_numbered_while_there_is_room():
    above, _ = plots.draw_newton(steps(12, 3)).axes
    assert [text.get_text() for text in above.texts] == ["load step", "1", "2", "3"]
    assert [len(line.get_xdata()) for line in above.lines[:3]] == [4, 4, 4]
    many, _ = plots.draw_newton(steps(400, 100)).axes
    assert len(many.texts) <= 13


def test_what_is_active_depends_on_the_method(patch_test, case):
    kts = case.changed({"solve.contact.0.method": "kts", "solve.contact.0.penalty": "auto"})
    assert plots.what_is_active(patch_test) == "control points"
    assert plots.what_is_active(solve.solve(geom2iga.build(kts), kts)) == "points"


def test_the_force_of_each_contact_is_drawn_over_the_share_of_the_loads(case):
    stepped = case.changed({"solve.steps": {"factors": [0.2, 0.6, 1.0]}})
    result = solve.solve(geom2iga.build(stepped), stepped)
    force, area = plots.draw_load_steps(result, UNITS).axes
    np.testing.assert_allclose(force.lines[0].get_xdata(), [0.2, 0.6, 1.0])
    np.testing.assert_allclose(force.lines[0].get_ydata(), [0.2, 0.6, 1.0], rtol=1e-9)
    np.testing.assert_allclose(area.lines[0].get_ydata(), 1.0)
    assert (force.get_ylabel(), area.get_ylabel()) == ("contact force [N]", "contact area [mm²]")
    assert "load_steps" in plots.pictures_of(Samples(result, 2), PostCase(), {})


def test_lines_have_a_curve_for_each_body_with_gaps_outside_it_and_a_panel_for_each_dimension():
    distance, values = np.array([0.0, 1, 1, 2, 3, 4]), np.array([1.0, 2, 5, 6, nan, 8])
    fields = {"uz": values, "von_mises": values, "stress_zz": -values}
    figure = plots.draw_line(distance, fields, UNITS, ("a", "a", "b", "b", "", "b"))
    above, below = figure.axes
    assert above.get_ylabel() == "displacement along z $u_z$ [mm]"
    assert below.get_ylabel() == "stress [N/mm²]"
    assert below.get_xlabel() == "distance along the line [mm]"
    np.testing.assert_array_equal(above.lines[0].get_ydata(), [1, 2, nan, nan, nan, nan])
    np.testing.assert_array_equal(above.lines[1].get_ydata(), [nan, nan, 5, 6, nan, 8])
    assert [text.get_text() for text in above.get_legend().get_texts()] == ["a", "b"]
    told = [text.get_text() for text in below.get_legend().get_texts()]
    assert [text.rsplit(", ")[1] for text in told] == ["a", "b", "a", "b"]
    assert ["von Mises" in text for text in told] == [True, True, False, False]


def test_a_line_through_a_single_body_needs_no_legend():
    axes = plots.draw_line(np.arange(3.0), {"uz": np.array([1.0, nan, 2.0])}, UNITS, ("a", "", "a")).axes[0]
    assert axes.get_legend() is None
    assert len(axes.lines) == 1


def test_fields_at_a_point_are_drawn_over_the_share_of_the_loads():
    axes = plots.draw_point(np.array([0.5, 1.0]), {"uz": np.array([1.0, 2.0])}, UNITS).axes[0]
    assert axes.get_xlabel() == "share of the loads"
    assert axes.lines[0].get_xdata().tolist() == [0.5, 1.0]


def test_a_sweep_has_mean_and_range_of_each_curve():
    curves = [Curve("degree 1", np.arange(3.0), np.array([1.0, 2.0, 3.0]))]
    axes = plots.draw_sweep(curves, Label("position", "mm"), Label("force", "N")).axes[0]
    assert axes.get_legend().get_texts()[0].get_text() == "degree 1: mean 2, range 2 (1e+02 %)"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("position [mm]", "force [N]")
    logarithmic = plots.draw_sweep(curves, Label("penalty"), Label("error"), log="xy").axes[0]
    assert (logarithmic.get_xscale(), logarithmic.get_yscale()) == ("log", "log")


def test_errors_against_a_closed_form_have_a_panel_of_their_own():
    points = np.array([0.0, 1.0, 2.0])
    figure = plots.draw_profile([Curve("computed", points, 4 - points)], lambda x: 4 - x**2, UNITS, errors=True)
    np.testing.assert_allclose(figure.axes[1].lines[0].get_ydata(), [0, 0, 50])
    assert "[%]" in figure.axes[1].get_ylabel()
    assert figure.axes[1].get_xlabel() == "distance from the middle of contact [mm]"
    along = plots.draw_profile([Curve("computed", points, points)], np.abs, UNITS, along="arc length")
    assert along.axes[0].get_xlabel() == "arc length [mm]"


def test_lines_differ_in_more_than_colour():
    found = [look for look, _ in zip(style.line_styles(), range(7), strict=False)]
    for key in ("color", "linestyle", "marker"):
        assert len({str(look[key]) for look in found}) == 7


def test_sequential_colours_get_steadily_lighter_and_black_lines_show_on_all():
    light = np.array([lightness(colour[:3]) for colour in style.SEQUENTIAL(np.linspace(0, 1, 50))])
    assert (np.diff(light) > 0).all()
    assert light[0] > 20
    diverging = np.array([lightness(colour[:3]) for colour in style.DIVERGING(np.linspace(0, 1, 51))])
    assert (np.diff(diverging[:26]) > 0).all()
    assert (np.diff(diverging[25:]) < 0).all()
    assert 30 < diverging[0] < diverging[-1] - 10  # so that print without colours tells the ends apart


def test_colours_diverge_from_white_at_zero_as_strongly_on_both_sides():
    scale = style.scale_of(np.array([-4.0, 1.0]), 4.0, True)
    assert scale.limits == (-4.0, 1.0)
    assert min(scale.colours(0.8)[:3]) > 0.94  # zero is white
    assert scale.colours(0.0)[:3] == pytest.approx(to_rgb("#1f5a94"), abs=0.01)
    assert scale.colours(1.0)[:3] == pytest.approx(style.DIVERGING(0.625)[:3], abs=0.01)
    assert style.scale_of(np.array([-4.0, 0.1]), 4.0, True).colours is style.SEQUENTIAL
    assert style.scale_of(np.array([-4.0, 4.0]), 4.0, False).colours is style.SEQUENTIAL


def test_limits_of_colours_are_those_given_and_values_beyond_are_told():
    values = np.array([-1.0, 0.5, nan, 2.0])
    assert style.scale_between((-3.0, 3.0), values, True).remark == ""
    beyond = style.scale_between((0.0, 1.0), values, True)
    assert beyond.limits == (0.0, 1.0)
    assert beyond.remark == "values from −1 to 2"
    assert beyond.colours is style.SEQUENTIAL


def test_powers_of_ten_of_very_small_and_large_fields_stand_in_the_unit():
    for size, power in {3e-7: -9, 2e-3: -3, 0.5: 0, 9000.0: 0, 2e5: 3}.items():
        assert style.scale_of(np.array([0.0, size]), size, False).power == power
    assert Label("gap", "mm").text(-3) == "gap [$10^{-3}$ mm]"
    assert Label("gap").text() == "gap"


@pytest.mark.parametrize(("ending", "draw"), [("png", convergence), ("svg", None), ("pdf", convergence)])
def test_the_same_picture_has_the_same_bytes(tmp_path, ending, draw, bent):
    for number in (1, 2):
        figure = draw() if draw else plots.draw_contact_plane(Samples(bent, 3))
        scene.save(figure, tmp_path / f"{number}.{ending}")
    assert (tmp_path / f"1.{ending}").read_bytes() == (tmp_path / f"2.{ending}").read_bytes()


def test_text_stays_text_in_svg_and_fonts_are_in_pdf(tmp_path):
    scene.save(convergence(), tmp_path / "c.svg")
    assert "error of the pressure [%]" in (tmp_path / "c.svg").read_text()
    scene.save(convergence(), tmp_path / "c.pdf")
    written = (tmp_path / "c.pdf").read_bytes()
    streams = [part.split(b"stream")[0].rstrip(b"\r\nend") for part in written.split(b"stream\n")[1:]]
    assert b"/FontFile2" in written
    assert b"/Type3" not in written
    assert any(b"BT" in zlib.decompressobj().decompress(part) for part in streams if part[:1] == b"x")


def test_the_pictures_of_a_run_are_the_usual_ones_and_those_of_the_case(bent):
    wanted = {
        "post": {
            "picture": [{"name": "shear", "field": "stress_xz"}],
            "line": [{"name": "axis", "start": [1.0, 1.0, 0.0], "end": [1.0, 1.0, 1.0], "points": 5}],
            "point": [{"name": "inside", "at": [0.5, 0.5, 0.5], "field": "uz"}],
        },
        "units": {"length": "mm", "force": "N"},
    }
    case = PostCase.model_validate(wanted)
    usual = ("displacement", "stress", "contact_pressure", "contact_plane")
    found = plots.pictures_of(Samples(bent, 2), case, sample_probes(bent, case.post))
    assert list(found) == [*usual, "newton", "picture_shear", "line_axis"]
    assert found["line_axis"]().axes[0].get_ylabel() == r"von Mises stress $\sigma_\mathrm{vM}$ [N/mm²]"
    twice = replace(bent, states=bent.states * 2)
    found = plots.pictures_of(Samples(twice, 2), case, sample_probes(twice, case.post))
    assert list(found) == [*usual, "load_steps", "newton", "picture_shear", "line_axis", "point_inside"]
    assert found["point_inside"]().axes[0].get_ylabel().endswith("[mm]")


def test_a_picture_shows_itself_in_a_notebook(bent):
    picture = plots.plot(bent, "uz")
    assert picture._repr_png_().startswith(b"\x89PNG")
