import numpy as np
import pytest

import geom2iga
import solve
from geom2iga.patch import evaluate
from geom2iga.tables import Units
from post import plots
from post.fields import Samples
from post.plots import contact, deformation, plane, style

UNITS = Units(length="mm", force="N")
SPHERE = {
    "geometry": {
        "degree": 2,
        "domed_block": [{"name": "sphere", "size": [1, 1, 1], "radius": 2.0, "quarter": True, "spans": [6, 6, 2]}],
        "block": [{"name": "block", "origin": [0, 0, -1], "size": [1, 1, 1], "spans": [6, 6, 2]}],
    },
    "solve": {
        "material": [{"young": 1000.0, "poisson": 0.3}],
        "support": [{"on": "block/bottom", "uz": 0.0}]
        + [{"on": f"{body}/{side}", "normal": 0.0} for body in ("block", "sphere") for side in ("left", "front")],
        "load": [{"on": "sphere/top", "pressure": 3.0}],
        "contact": [{"secondary": "sphere/bottom", "primary": "block/top"}],
    },
}


@pytest.fixture(scope="module")
def pressed():
    """A quarter of a sphere on a block, which it touches near its lowest point alone."""
    return solve.solve(geom2iga.build(SPHERE), SPHERE)


def drawn_gaps(result, scale):
    """Gaps of the contact where displacements are drawn some times."""
    pairs = [pair for c in result.pairs for pair in deformation._gaps(result, c)]
    return np.concatenate([before + scale * (after - before) for before, after in pairs])


def test_pressure_and_gap_bear_their_units_and_the_pressure_begins_at_zero(bent):
    samples = Samples(bent, 4)
    pressure, gap = (plots.draw_contact(samples, field, UNITS).axes[1] for field in ("pressure", "gap"))
    assert pressure.get_ylabel() == "contact pressure $p$ [N/mm²]"
    assert "mm]" in gap.get_ylabel()
    largest = max(part.pressure.max() for part in samples.secondary)
    assert pressure.get_ylim() == pytest.approx((0.0, largest))


def test_where_contact_is_small_it_fills_the_picture(pressed, monkeypatch):
    seen = []
    monkeypatch.setattr(contact, "draw_page", lambda *given: seen.append(given[-1]))
    samples = Samples(pressed, 3)
    for field in ("pressure", "gap"):
        plots.draw_contact(samples, field)
    zone, whole = (np.ptp(points, axis=0).max() for points in seen)
    assert zone < 0.8 * whole
    (part,) = samples.secondary
    assert zone >= np.ptp(part.points[part.pressure > 0], axis=0).max()


def test_a_surface_that_stands_upright_is_seen_from_its_side(bent):
    from types import SimpleNamespace

    view = contact._direction([SimpleNamespace(normal=np.array([[2.0, 1.0, 0.0]]))])
    assert np.dot(view, [2.0, 1.0, 0.0]) > 2
    assert contact._direction([SimpleNamespace(normal=np.array([[0.0, 0.0, -1.0]]))]) == contact.ABOVE


def test_the_parameter_plane_shows_pressure_and_gap_around_the_contact_zone(pressed):
    figure = plots.draw_contact_plane(Samples(pressed, 4), UNITS)
    left, right, *bars = figure.axes
    assert left.get_xlabel() == r"$\xi_1$"
    assert left.get_title() == "sphere/bottom"
    assert [bar.get_ylabel().split("[")[0].strip() for bar in bars] == ["contact pressure $p$", "gap $g$"]
    assert left.get_xlim() == right.get_xlim()
    assert 0 == left.get_xlim()[0] < left.get_xlim()[1] <= 1
    (image,) = left.images
    assert np.asarray(image.get_array()).max() == pytest.approx(
        Samples(pressed, 4).secondary[0].pressure.max(), rel=1e-2
    )


def test_knot_lines_of_both_sides_are_drawn_where_they_are(bent):
    figure = plots.draw_contact_plane(Samples(bent, 3))
    axes = figure.axes[0]
    own = {round(line.get_xdata()[0], 6) for line in axes.lines if len(set(line.get_xdata())) == 1}
    assert own == {0, round(1 / 3, 6), round(2 / 3, 6), 1}
    (surface,) = (bent.model.surface(face) for face in bent.model.faces("upper/bottom"))
    drawn = 0
    for line in axes.lines[7:]:  # the others are those of the lower block, on multiples of a half of x or y
        xi = np.column_stack(line.get_data())
        at = evaluate(surface, xi[~np.isnan(xi[:, 0])])[0][:, :2]
        drawn += len(at) > 0
        assert len(at) == 0 or np.abs(2 * at - np.round(2 * at)).max(axis=0).min() < 1e-9
    assert drawn >= 4


def test_values_between_sample_points_are_those_of_a_bilinear_field(pressed):
    grid = plane.sample_grid(pressed.model.surface(pressed.model.faces("sphere/bottom")[0]), 3)
    first, second = (line.rule.points for line in grid.lines)
    places = [np.linspace(0.1, 0.9, 7), np.linspace(0, 1, 5)]
    found = plane._between(2 * first[:, None] + first[:, None] * second, grid.lines, places)
    np.testing.assert_allclose(found, 2 * places[0][:, None] + np.outer(*places), atol=1e-12)


def test_a_gap_of_rounding_errors_is_uniform_and_one_of_penetrations_is_not():
    assert contact.contact_scale(np.array([1e-17, -1e-17]), "gap", 1.0).remark
    assert not contact.contact_scale(np.array([-1e-6, -2e-6, np.nan]), "gap", 1.0).remark
    assert contact.contact_scale(np.array([np.nan]), "gap", 1.0).colours is style.SEQUENTIAL


def test_displacements_are_enlarged_by_a_round_factor(patch_test, bent):
    for result in (patch_test, bent):
        scale = plots.deformation_scale(result)
        drawn = scale * np.linalg.norm(result.state.displacement, axis=1).max() / deformation.size_of(result)
        assert deformation.VISIBLE / 3 < drawn <= deformation.VISIBLE
        assert round(scale / 10 ** np.floor(np.log10(scale)), 9) in (1, 2, 5)


def test_bodies_in_contact_do_not_run_through_each_other_where_displacements_are_enlarged(pressed):
    scale, size = plots.deformation_scale(pressed), deformation.size_of(pressed)
    visible = deformation.VISIBLE * size / np.linalg.norm(pressed.state.displacement, axis=1).max()
    assert 1 <= scale < visible / 2.5  # contact is what limits it
    assert drawn_gaps(pressed, scale).min() >= -deformation.OVERLAP * size or scale == 1
    following = scale * (2.5 if str(scale)[0] == "2" else 2)
    assert drawn_gaps(pressed, following).min() < -deformation.OVERLAP * size


def test_factors_are_one_two_or_five_times_a_power_of_ten_and_at_least_one():
    limits = {0.3: 1, 1.0: 1, 1.99: 1, 2.0: 2, 4.9: 2, 5.0: 5, 99.0: 50, 100.0: 100, 123456.0: 100000}
    assert {limit: deformation._round_below(limit) for limit in limits} == limits
