from dataclasses import replace

import numpy as np
import pytest

import geom2iga
import solve
from geom2iga import Face, Patch, evaluate
from post.fields import Samples, sample_at, sample_contact, sample_face, sample_patch
from post.grid import sample_grid
from tests.cases import model_of
from tests.post.test_gauss import posed, stretched


@pytest.mark.parametrize("samples", [2, 3, 5])
def test_cells_of_a_sample_grid_fill_the_body_once(bent, samples):
    for name, patch in bent.model.patches.items():
        part = sample_patch(bent, name, samples)
        corners = part.points[part.cells]
        edges = corners[:, [1, 3, 4]] - corners[:, :1]
        assert np.linalg.det(edges).sum() == pytest.approx(2 * 2 * 1 if name == "lower" else 1, rel=1e-12)
        spans = np.prod([len(at) - 1 for at in patch.breaks])
        assert len(part.cells) == spans * (samples - 1) ** 3


def test_displacement_gradient_behind_the_stress_agrees_with_differences(bent):
    patch, step = bent.model.patches["upper"], 1e-6
    xi = np.random.default_rng(1).uniform(0.1, 0.9, (20, 3))
    position, jacobian = evaluate(patch, xi, 1)
    gradient = np.empty((20, 3, 3))
    for d in range(3):
        ahead, behind = (sample_at(bent, "upper", xi + s * step * np.eye(3)[d]).displacement for s in (1, -1))
        gradient[:, :, d] = (ahead - behind) / (2 * step)
    stress = bent.materials["upper"].stress(gradient @ np.linalg.inv(jacobian))
    part = sample_at(bent, "upper", xi)
    np.testing.assert_allclose(part.stress, stress, atol=1e-6)
    np.testing.assert_allclose(part.points, position)


def test_values_at_the_end_of_a_span_are_those_from_inside(case):
    linear = case.changed({"geometry.degree": 1, "solve.load.0": {"on": "upper/top", "traction": [0.0, 0.3, -1.0]}})
    result = solve.solve(geom2iga.build(linear), linear)
    grid = sample_grid(result.model.patches["upper"], 2)
    at_ends = sample_at(result, "upper", grid.xi, grid.spans).stress
    knots = result.model.patches["upper"].knots[0]
    left, right = knots[grid.spans[:, 0]], knots[grid.spans[:, 0] + 1]
    inside = grid.xi.copy()
    inside[:, 0] = np.clip(inside[:, 0], left + 1e-9, right - 1e-9)
    np.testing.assert_allclose(at_ends, sample_at(result, "upper", inside, grid.spans).stress, atol=1e-6)
    assert np.abs(at_ends - sample_at(result, "upper", grid.xi).stress).max() > 1e-2  # the stress does jump


def test_where_the_map_is_singular_there_is_a_place_and_a_displacement_but_no_stress(bent):
    patch = bent.model.patches["upper"]
    flat = patch.control_points.copy()
    flat[-1] = flat[-1, :1, :1]
    model = replace(bent.model, patches={**bent.model.patches, "upper": replace(patch, control_points=flat)})
    part = sample_at(replace(bent, model=model), "upper", np.array([[0.5, 0.5, 0.5], [1.0, 0.5, 0.5]]))
    assert np.isfinite(part.points).all()
    assert np.isfinite(part.displacement).all()
    assert np.isnan(part.stress).all(axis=1).tolist() == [False, True]


def test_a_face_is_sampled_where_the_body_ends(bent):
    patch = bent.model.patches["lower"]
    for axis, low, high in ((0, 0.0, 2.0), (1, 0.0, 2.0), (2, 0.0, 1.0)):
        for side, place in ((0, low), (1, high)):
            part = sample_face(bent, Face(patch.name, axis, side), 3)
            np.testing.assert_allclose(part.points[:, axis], place, atol=1e-14)


def test_pressure_and_gap_obey_the_penalty_law_in_the_uniform_case(patch_test):
    (part,) = sample_contact(patch_test, patch_test.contacts[0], 4)
    np.testing.assert_allclose(part.pressure, 1.0, atol=1e-11)
    np.testing.assert_allclose(part.gap, -1.0 / patch_test.contacts[0].penalty, rtol=1e-6)
    np.testing.assert_allclose(part.normal, np.broadcast_to([0, 0, -1], part.normal.shape), atol=1e-14)


def test_what_hangs_over_has_no_gap_and_no_pressure(bent):
    (part,) = sample_contact(bent, bent.contacts[0], 4)
    beyond = (part.points[:, :2] > 2 + 1e-9).any(axis=1) | (part.points[:, :2] < -1e-9).any(axis=1)
    assert beyond.any()
    assert not beyond.all()
    assert np.isnan(part.gap[beyond]).all()
    assert (part.pressure[beyond] == 0).all()
    assert not np.isnan(part.gap[~beyond]).any()


def test_a_face_on_two_others_shows_the_pressure_of_both():
    sides = {"west": 0.0, "east": 3.0}
    piers = [{"name": name, "origin": [x, 0.0, 0.0], "size": [1, 1, 1]} for name, x in sides.items()]
    beam = {"name": "beam", "origin": [0.0, 0.0, 1.0], "size": [4, 1, 1], "spans": [8, 1, 1]}
    case = {
        "geometry": {"degree": 2, "block": [*piers, beam]},
        "solve": {
            "material": [{"young": 100.0, "poisson": 0.0}],
            "support": [{"on": f"{name}/bottom", "ux": 0.0, "uy": 0.0, "uz": 0.0} for name in sides]
            + [{"on": "beam/left", "ux": 0.0}, {"on": "beam/front", "uy": 0.0}],
            "load": [{"on": "beam/top", "pressure": 1.0}],
            "contact": [{"secondary": "beam/bottom", "primary": f"{name}/top"} for name in sides],
        },
    }
    result = solve.solve(geom2iga.build(case), case)
    (part,) = Samples(result, 3).secondary
    for x in sides.values():
        over = (part.points[:, 0] > x + 0.01) & (part.points[:, 0] < x + 0.99)
        assert part.pressure[over].max() > 1
        assert not np.isnan(part.gap[over]).any()
    between = (part.points[:, 0] > 1.01) & (part.points[:, 0] < 2.99)
    assert np.isnan(part.gap[between]).all()
    assert (part.pressure[between] == 0).all()


def test_where_two_contacts_of_a_face_meet_their_pressures_do_not_add_up():
    sides = {"l": ("left", 0.0), "r": ("right", 1.0)}
    lower = [{"name": name, "origin": [x, 0.0, 0.0], "size": [1.0, 2.0, 1.0]} for name, (_, x) in sides.items()]
    case = {
        "geometry": {"degree": 2, "block": [*lower, {"name": "u", "origin": [0, 0, 1], "size": [2, 2, 1], "spans": 4}]},
        "solve": {
            "material": [{"young": 1000.0, "poisson": 0.0}],
            "support": [
                {"on": f"{name}/{face}", "normal": 0.0}
                for name, faces in {"l": "left front bottom", "r": "right front bottom", "u": "left front"}.items()
                for face in faces.split()
            ],
            "load": [{"on": "u/top", "pressure": 1.0}],
            "contact": [{"secondary": "u/bottom", "primary": f"{name}/top"} for name in sides],
        },
    }
    (part,) = Samples(solve.solve(geom2iga.build(case), case), 4).secondary
    assert (np.abs(part.points[:, 0] - 1.0) < 1e-12).any()
    np.testing.assert_allclose(part.pressure, 1.0, atol=1e-10)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_stress_is_no_number_at_the_corners_of_a_disc_of_one_patch(size):
    """There the map folds flat, and its Jacobian is rounding: half a turn of the border lies on each side."""
    half = 0.5**0.5
    corners = np.array([[(-1, -1), (-2, 0), (-1, 1)], [(0, -2), (0, 0), (0, 2)], [(1, -1), (2, 0), (1, 1)]]) * half
    points = np.stack([np.concatenate([size * corners, np.full((3, 3, 1), z * size)], axis=-1) for z in (0, 1)], axis=2)
    weights = np.array([[1, half, 1], [half, 1, half], [1, half, 1]])[:, :, None].repeat(2, axis=2)
    knots = (*([np.repeat([0.0, 1.0], 3)] * 2), np.repeat([0.0, 1.0], 2))
    result = posed(model_of(Patch("disc", (2, 2, 1), knots, points, weights)), stretched)
    part = sample_patch(result, "disc", 3)
    on_corner = (np.abs(np.abs(part.points[:, :2]) - half * size) < 1e-9 * size).all(axis=1)
    assert on_corner.sum() == 4 * 3
    np.testing.assert_array_equal(np.isnan(part.stress).any(axis=1), on_corner)
    assert np.isnan(sample_at(result, "disc", np.array([[0.0, 0.0, 0.5]])).stress).all()
