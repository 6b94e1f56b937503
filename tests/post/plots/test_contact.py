from dataclasses import replace

import numpy as np
import pytest

import geom2iga
import solve
from geom2iga.patch import evaluate
from geom2iga.tables import Units
from post import plots
from post.case import PostCase
from post.fields import Samples, sample_contact
from post.plots import contact, deformation, plane, style
from post.probes import Probes

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
    parts = [part for c in result.pairs for part in sample_contact(result, c, 9)]
    found = np.concatenate([part.initial_gap + scale * (part.gap - part.initial_gap) for part in parts])
    return found[~np.isnan(found)]


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
    points, whole = seen
    zone = np.ptp(points, axis=0).max()
    assert whole is None
    assert zone < 0.8
    (part,) = samples.secondary
    assert zone >= np.ptp(part.points[part.pressure > 0], axis=0).max()


@pytest.fixture(scope="module")
def far_apart():
    """Three spheres on a long block, of which the last does not touch; the second one has two passes."""
    places = {"first": 0.0, "second": 6.0, "third": 12.0}
    sphere = {"size": [1, 1, 1], "radius": 2.0, "spans": [5, 5, 1]}
    held = {"ux": 0.0, "uy": 0.0}
    tables = {
        "geometry": {
            "degree": 2,
            "domed_block": [{**sphere, "name": name, "origin": [x, 0, 0]} for name, x in places.items()],
            "block": [{"name": "plate", "origin": [-1, -1, -1], "size": [14, 2, 1], "spans": [28, 4, 1]}],
        },
        "solve": {
            "material": [{"young": 1000.0, "poisson": 0.3}],
            "support": [{"on": "plate/bottom", "uz": 0.0, **held}]
            + [{"on": f"{name}/top", "uz": 0.01 if name == "third" else -0.01, **held} for name in places],
            "contact": [
                {"secondary": f"{name}/bottom", "primary": "plate/top", "two_pass": name == "second"} for name in places
            ],
        },
    }
    return solve.solve(geom2iga.build(tables), tables)


def test_contacts_that_are_far_apart_have_a_picture_each_where_they_press(far_apart):
    samples = Samples(far_apart, 3)
    apart = contact.pairs_apart(samples)
    assert {number: len(pair) for number, pair in apart.items()} == {1: 1, 2: 2}
    names = list(plots.pictures_of(samples, PostCase(), Probes({}, {})))
    assert names[2:5] == ["contact_pressure_1", "contact_pressure_2", "contact_plane"]


def test_the_picture_of_a_contact_shows_it_alone_and_names_it(far_apart, monkeypatch):
    seen = []
    monkeypatch.setattr(contact, "draw_page", lambda *given: seen.append(given))
    samples = Samples(far_apart, 3)
    for pair in contact.pairs_apart(samples).values():
        plots.draw_contact(samples, "pressure", UNITS, pair)
    for (layers, _, _, _, remarks, points), name, x in zip(seen, ("first", "second"), (0.0, 6.0), strict=True):
        assert remarks.below == f"detail around {name}/bottom on plate/top"
        assert np.abs(points[:, 0] - x).max() < 0.8
        assert len(layers) == 2  # no outlines, which the picture would cut off
    assert np.ptp(np.asarray(seen[0][0][0].mesh.points)[:, 0]) < 1.01


def test_a_single_contact_and_contacts_that_fill_the_model_have_one_picture(pressed, bent):
    for result in (pressed, bent):
        assert contact.pairs_apart(Samples(result, 2)) == {}


def test_a_face_is_named_as_in_the_case_and_one_of_several_by_its_own_name_too(bent):
    (face,) = bent.model.faces("upper/bottom")
    assert plane._name_of(bent, face) == "upper/bottom"
    side = bent.model.faces("upper/left")
    several = replace(bent, model=replace(bent.model, groups={**bent.model.groups, "upper/bottom": (face, *side)}))
    assert plane._name_of(several, side[0]) == "upper/bottom: upper/left"
    assert plane._name_of(several, face) == "upper/bottom: upper axis 2 side 0"


def test_the_legend_tells_of_the_edge_of_contact_only_where_it_is_drawn(patch_test, pressed):
    for result, has_edge in ((patch_test, False), (pressed, True)):
        (legend,) = plots.draw_contact_plane(Samples(result, 3)).legends
        assert ("edge of contact" in [text.get_text() for text in legend.get_texts()]) == has_edge


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


@pytest.mark.parametrize("spans", [1, 3, 4])
def test_the_lowest_point_of_a_round_face_limits_the_factor_wherever_it_lies_in_a_span(spans):
    dome = {"name": "dome", "radius": 3.0, "size": [1, 1, 1], "origin": [1, 1, 1], "spans": [spans, spans, 2]}
    case = {
        "geometry": {"degree": 2, "block": [{"name": "base", "size": [2, 2, 1], "spans": 3}], "domed_block": [dome]},
        "solve": {
            "material": [{"young": 1000.0, "poisson": 0.3}],
            "support": [
                {"on": "base/bottom", "ux": 0.0, "uy": 0.0, "uz": 0.0},
                {"on": "dome/top", "ux": 0.0, "uy": 0.0, "uz": -0.02},
            ],
            "contact": [{"secondary": "dome/bottom", "primary": "base/top"}],
        },
    }
    result = solve.solve(geom2iga.build(case), case)
    scale, size = plots.deformation_scale(result), deformation.size_of(result)
    assert drawn_gaps(result, scale).min() >= -1.1 * deformation.OVERLAP * size or scale == 1
