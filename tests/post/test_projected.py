import numpy as np
import pytest
from hypothesis import given, settings

import geom2iga
import solve
from geom2iga.patch import evaluate
from post import projected
from post.gauss import gauss_bricks
from post.projected import Sampled, project, project_stress
from solve.rules import full_rules
from solve.space import number_control_points
from tests.cases import block_patch, hollow_cylinder, model_of, turned
from tests.oracles import assert_order, volume_quadrature
from tests.post.test_gauss import SLOPE, posed, shape_of, stretched
from tests.strategies import bent_patches, rotations
from tests.verification.glued_bodies import glued_model, star, wall

YOUNG, POISSON = 1000.0, 0.3


def parametric(brick):
    """Parametric points (q, 3) of a brick."""
    return np.stack(np.meshgrid(*[piece.points for piece in brick.pieces], indexing="ij"), axis=-1).reshape(-1, 3)


def field_of(result, function):
    """A field from a function of the name of a patch, parametric points and places."""
    rules = full_rules(result.space)

    def field(name):
        for brick, at in gauss_bricks(result, name, rules[name]):
            yield Sampled(brick, at.weight, function(name, parametric(brick), at.points))

    return field


def waves(name, xi, points):
    """Two smooth fields."""
    return np.stack([np.sin(points @ [1.0, 0.7, -0.4]), np.cos(points @ [0.2, 1.1, 0.9])], axis=1)


def glued_bodies():
    """Two bodies of several patches."""
    return glued_model({"lower": wall("l", degree=2, shift=(0.1, -0.05)), "upper": star("u", 5, (0, 0, 3), degree=2)})


def uniform(result, body):
    """The stress (6,) under `stretched`."""
    return result.materials[body].stress(SLOPE[None])[0]


@pytest.mark.parametrize(
    "model",
    [
        glued_bodies(),
        shape_of("cylinder", radius=2.0, height=3.0),
        shape_of("pipe", inner=1.0, outer=2.0, height=3.0, spans=(3, 2, 1), degree=3),
        shape_of("block", size=[1.0, 2.0, 3.0], degree=[1, 2, 3]),
    ],
    ids=["glued", "cylinder", "pipe", "block"],
)
def test_a_uniform_stress_is_reproduced_and_those_of_two_materials_do_not_mix(model):
    result = posed(model, stretched)
    found = project_stress(result)
    assert list(found) == [name for names in model.bodies.values() for name in names]
    for name, values in found.items():
        expected = uniform(result, model.body_of(name))
        np.testing.assert_allclose(values, np.tile(expected, (len(values), 1)), atol=1e-12 * np.abs(expected).max())


def test_the_smooth_stress_is_finite_where_the_map_is_singular():
    model = shape_of("sphere", radius=2.0, degree=4, spans=(1, 1, 1))
    result = posed(model, stretched)
    expected = uniform(result, "body")
    for values in project_stress(result).values():
        np.testing.assert_allclose(values, np.tile(expected, (len(values), 1)), atol=1e-8 * np.abs(expected).max())


def test_the_contact_patch_test_stays_uniform(patch_test):
    for values in project_stress(patch_test).values():
        np.testing.assert_allclose(values, np.tile([0, 0, -1, 0, 0, 0], (len(values), 1)), atol=1e-11)


@settings(max_examples=15, deadline=None)
@given(bent_patches(), rotations())
def test_a_field_of_the_space_is_reproduced(patch, turn):
    patch = turned(patch, turn)
    result = posed(model_of(patch), stretched)
    coefficients = np.random.default_rng(0).normal(size=(patch.weights.size, 3))
    field = field_of(result, lambda name, xi, points: evaluate(patch, xi, 0, coefficients)[0])
    np.testing.assert_allclose(project(result.space, patch.name, field)[patch.name], coefficients, atol=1e-9)


def test_glued_patches_share_values_and_a_field_of_their_space_is_reproduced():
    model = glued_bodies()
    result, space = posed(model, stretched), number_control_points(model)
    coefficients = np.random.default_rng(0).normal(size=(space.size, 2))

    def spline(name, xi, points):
        return evaluate(model.patches[name], xi, 0, coefficients[space.numbers[name]])[0]

    for body, names in model.bodies.items():
        found = project(space, body, field_of(result, spline))
        assert list(found) == list(names)
        for name, values in found.items():
            np.testing.assert_allclose(values, coefficients[space.numbers[name]], atol=1e-10)


def test_what_is_left_is_orthogonal_to_the_space():
    model = glued_bodies()
    result, space = posed(model, stretched), number_control_points(model)
    for body in model.bodies:
        found = project(space, body, field_of(result, waves))
        rest, whole = np.zeros((space.size, 2)), np.zeros((space.size, 2))
        for name, values in found.items():
            patch = model.patches[name]
            for part in volume_quadrature(patch, space.point_counts[name]):
                points = np.einsum("eqa,eak->eqk", part.values, patch.control_points.reshape(-1, 3)[part.indices])
                field = waves(name, None, points.reshape(-1, 3)).reshape(*points.shape[:2], 2)
                left = np.einsum("eqa,eak->eqk", part.values, values[part.indices]) - field
                for sums, integrand in ((rest, left), (whole, np.abs(field))):
                    local = np.einsum("eqa,eqk,eq->eak", part.values, integrand, part.volume)
                    np.add.at(sums, space.numbers[name][part.indices], local)
        assert np.abs(rest).max() <= 1e-12 * whole.max()
        assert np.abs(rest).max() > 0


@pytest.mark.parametrize(
    ("coarse", "degree", "spans"),
    [(block_patch("body"), 1, (5, 8)), (hollow_cylinder(name="body"), 2, (6, 9)), (block_patch("body"), 3, (3, 5))],
    ids=["block 1", "ring 2", "block 3"],
)
def test_smooth_fields_are_met_with_order_degree_plus_one(coarse, degree, spans):
    errors = []
    for count in spans:
        patch = geom2iga.refined(geom2iga.elevated(coarse, (degree,) * 3), spans=count)
        result = posed(model_of(patch), stretched)
        values, square = project(result.space, "body", field_of(result, waves))["body"], 0.0
        for part in volume_quadrature(patch, (degree + 3,) * 3):  # not where it was projected, which is nearer
            points, found = (
                np.einsum("eqa,eak->eqk", part.values, each[part.indices]).reshape(part.volume.size, -1)
                for each in (patch.control_points.reshape(-1, 3), values)
            )
            square += part.volume.ravel() @ ((found - waves("body", None, points)) ** 2).sum(axis=1)
        errors.append(np.sqrt(square))
    assert_order(errors, 1 / np.array(spans), degree + 1)


def test_the_smooth_stress_is_nearer_to_the_exact_one_by_half_an_order_or_more():
    raw, smooth, sizes = [], [], (1 / 4, 1 / 8)
    for size in sizes:
        result = ring_under_pressure(2, round(1 / size))
        found, squares = project_stress(result), np.zeros(2)
        for name, patch in result.model.patches.items():
            for brick, at in gauss_bricks(result, name, full_rules(result.space)[name]):
                nodal = evaluate(patch, parametric(brick), 0, found[name])[0]
                exact = lame_stress(at.points)
                squares += [at.weight @ ((part - exact) ** 2).sum(axis=1) for part in (at.stress, nodal)]
        raw.append(np.sqrt(squares[0]))
        smooth.append(np.sqrt(squares[1]))
    assert_order(raw, sizes, 2)
    assert_order(smooth, sizes, 2.5)
    assert smooth[-1] < raw[-1] / 3


def ring_under_pressure(degree, spans):
    """A quarter of a ring of radii 1 and 2 under a pressure of 1 from inside, in plane strain."""
    ring = {"name": "ring", "inner": 1.0, "outer": 2.0, "height": 0.5, "angle": 90.0, "spans": [spans, spans, 1]}
    case = {
        "geometry": {"degree": degree, "pipe": [ring]},
        "solve": {
            "material": [{"young": YOUNG, "poisson": POISSON}],
            "support": [{"on": f"ring/{side}", "normal": 0.0} for side in ("start", "end", "bottom", "top")],
            "load": [{"on": "ring/inner", "pressure": 1.0}],
        },
    }
    return solve.solve(geom2iga.build(case), case)


def lame_stress(points):
    """Lamé's stress (q, 6) in that ring: radial 1/3 - 4/(3 r²), hoop 1/3 + 4/(3 r²), axial nu times their sum."""
    x, y, _ = points.T
    square = x**2 + y**2
    radial, hoop, none = 1 / 3 - 4 / (3 * square), 1 / 3 + 4 / (3 * square), np.zeros(len(x))
    xx, yy = (radial * x**2 + hoop * y**2) / square, (radial * y**2 + hoop * x**2) / square
    return np.stack([xx, yy, POISSON * (radial + hoop), (radial - hoop) * x * y / square, none, none], axis=1)


@pytest.mark.parametrize(("degree", "spans"), [(1, 12), (2, 12), (4, 6)])
def test_iterations_are_few_and_on_a_straight_patch_one_is_enough(degree, spans, monkeypatch):
    monkeypatch.setattr(projected, "MOST_ITERATIONS", 2)
    project_stress(posed(model_of(block_patch(degree=degree, spans=(spans, 2, 1))), lambda points: points**2))
    monkeypatch.setattr(projected, "MOST_ITERATIONS", 25)
    ring = geom2iga.refined(geom2iga.elevated(hollow_cylinder(), (degree, max(degree, 2), degree)), spans=4)
    project_stress(posed(model_of(ring), lambda points: points**2))


def test_iterations_that_do_not_end_are_told(monkeypatch):
    monkeypatch.setattr(projected, "MOST_ITERATIONS", 1)
    with pytest.raises(geom2iga.GeometryError, match='body "ring": the smooth stress was not found in 1 iteration'):
        project_stress(posed(model_of(hollow_cylinder()), lambda points: points**2))


def test_glued_patches_share_the_preconditioner_so_that_iterations_stay_few(monkeypatch):
    monkeypatch.setattr(projected, "MOST_ITERATIONS", 11)  # twice as many without shares
    project_stress(posed(glued_bodies(), lambda points: points**2))
