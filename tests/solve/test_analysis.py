import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import geom2iga
import solve
from geom2iga.errors import CaseError, GeometryError
from geom2iga.model import Model
from solve.case import Solve
from solve.problem import prepare
from tests.cases import (
    bent_patch,
    block_patch,
    converged,
    displacement_at,
    largest_stress_error,
    model_of,
    moved,
    patch_test_case,
    stress_at,
    turned,
)

STEEL = {"young": 1000.0, "poisson": 0.3}
FIXED = {"ux": 0.0, "uy": 0.0, "uz": 0.0}
ANYWHERE = np.random.default_rng(0).random((50, 3))


def case_of(support, load=(), contact=(), material=(STEEL,), body_force=(), **more):
    tables = {"material": material, "support": support, "load": load, "contact": contact, "body_force": body_force}
    return {"solve": {**{key: list(entries) for key, entries in tables.items()}, **more}}


def upright(name):
    """Supports that let a body move along z alone."""
    return [{"on": f"{name}/left", "ux": 0.0}, {"on": f"{name}/front", "uy": 0.0}]


def on_top(upper, lower, **values):
    return {"secondary": f"{upper}/bottom", "primary": f"{lower}/top", "penalty": 1e6, **values}


@pytest.mark.parametrize("height", [0.0, 0.2])
def test_without_load_nothing_moves(height):
    model = model_of(block_patch("lower", size=(2, 2, 1)), block_patch("upper", (0.5, 0.5, 1 + height)))
    supports = [{"on": "lower/bottom", **FIXED}, *upright("upper")]
    result = converged(model, case_of(supports, contact=[on_top("upper", "lower")]))
    np.testing.assert_array_equal(result.state.displacement, 0)
    np.testing.assert_array_equal(result.state.pressure, 0)
    assert result.statistics["strain_energy"] == 0
    assert not result.history


@pytest.mark.parametrize("seed", range(3))
def test_a_prescribed_rigid_displacement_moves_the_body_and_strains_nothing(seed):
    patch = bent_patch(seed, spans=(1, 1, 1))
    shift = dict(zip(("ux", "uy", "uz"), (0.3, -0.2, 0.1), strict=True))
    result = converged(model_of(patch), case_of([{"on": "bent/left", **shift}]))
    np.testing.assert_allclose(displacement_at(result, "bent", ANYWHERE), [[0.3, -0.2, 0.1]] * 50, rtol=0, atol=1e-10)
    assert largest_stress_error(result, np.zeros(6), 100) < 1e-7


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_block_that_is_compressed_between_plates_has_the_stress_of_a_bar(degree):
    model = model_of(block_patch("bar", size=(1, 2, 4), degree=degree, spans=(2, 1, 3)))
    supports = [{"on": "bar/bottom", "uz": 0.0}, {"on": "bar/top", "uz": -0.04}, *upright("bar")]
    result = converged(model, case_of(supports))
    assert largest_stress_error(result, [0, 0, -1000 * 0.01, 0, 0, 0]) < 1e-10
    expected = ANYWHERE * [1, 2, 4] * [0.003, 0.003, -0.01]
    np.testing.assert_allclose(displacement_at(result, "bar", ANYWHERE), expected, rtol=0, atol=1e-13)
    assert result.statistics["strain_energy"] == pytest.approx(1000 * 0.01**2 / 2 * 8, rel=1e-12)


def test_where_all_is_prescribed_nothing_is_left_to_solve():
    model = model_of(block_patch("bar"))
    supports = [{"on": "bar/bottom", **FIXED}, {"on": "bar/top", "ux": 0.0, "uy": 0.0, "uz": 0.1}]
    result = converged(model, case_of(supports, material=[{"young": 10.0, "poisson": 0.0}]))
    assert result.statistics["dofs"] == 0
    assert largest_stress_error(result, [0, 0, 1, 0, 0, 0]) < 1e-14


def test_each_body_is_as_stiff_as_its_own_material():
    """Two bars in series: the contact passes the force, the softer one is strained more."""
    model = model_of(block_patch("lower", spans=(2, 2, 1)), block_patch("upper", (0, 0, 1), spans=(3, 3, 1)))
    materials = [
        {"bodies": ["lower"], "young": 1000.0, "poisson": 0.3},
        {"bodies": ["upper"], "young": 100.0, "poisson": 0.2},
    ]
    supports = [{"on": "lower/bottom", "uz": 0.0}, *upright("lower"), *upright("upper")]
    case = case_of(supports, [{"on": "upper/top", "pressure": 2.0}], [on_top("upper", "lower")], materials)
    result = converged(model, case)
    assert largest_stress_error(result, [0, 0, -2, 0, 0, 0]) < 1e-9
    corner = np.ones((1, 3))
    lower, upper = (displacement_at(result, name, corner)[0] for name in ("lower", "upper"))
    overlap = 2 / 1e6
    np.testing.assert_allclose(lower, [0.3 * 2 / 1000, 0.3 * 2 / 1000, -2 / 1000], rtol=0, atol=1e-12)
    np.testing.assert_allclose(upper, [0.2 * 2 / 100, 0.2 * 2 / 100, -2 / 1000 - overlap - 2 / 100], rtol=0, atol=1e-12)


def test_three_blocks_in_a_stack_pass_the_load_on_and_add_their_weight():
    names = ("low", "middle", "high")
    size = {"low": 3.0, "middle": 2.0, "high": 1.0}
    model = model_of(
        *(
            block_patch(
                name, (-size[name] / 2, -size[name] / 2, level), (size[name], size[name], 1), 2, (3 - level + 1, 2, 2)
            )
            for level, name in enumerate(names)
        )
    )
    supports = [{"on": "low/bottom", **FIXED}, *upright("middle"), *upright("high")]
    contacts = [on_top("middle", "low", penalty=1e4), on_top("high", "middle", penalty=1e5)]
    case = case_of(supports, [{"on": "high/top", "pressure": 3.0}], contacts, body_force=[{"force": [0.0, 0.0, -0.5]}])
    result = converged(model, case)
    forces = [contact.force for contact in result.contacts]
    np.testing.assert_allclose(forces, [[0, 0, 3 + 0.5 * (1 + 4)], [0, 0, 3 + 0.5]], rtol=0, atol=1e-9)
    assert result.statistics["equilibrium_error"] < 1e-12


def test_one_block_on_two_others_is_carried_by_both():
    model = model_of(
        block_patch("one", (0, 0, 0), spans=(3, 2, 1)),
        block_patch("two", (2, 0, 0), spans=(2, 3, 1)),
        block_patch("beam", (0, 0, 1), (3, 1, 1), 2, (5, 2, 2)),
    )
    supports = [*({"on": f"{name}/bottom", **FIXED} for name in ("one", "two")), *upright("beam")]
    contacts = [on_top("beam", name, penalty=1e4) for name in ("one", "two")]
    result = converged(model, case_of(supports, [{"on": "beam/top", "pressure": 1.0}], contacts))
    one, two = (contact.force for contact in result.contacts)
    np.testing.assert_allclose(one + two, [0, 0, 3], rtol=0, atol=1e-9)
    assert one[2] > 0.5
    assert two[2] > 0.5


def test_a_block_lies_on_another_by_its_weight_alone():
    model = model_of(
        block_patch("lower", size=(2, 2, 1), spans=(3, 3, 1)), block_patch("upper", (0.5, 0.5, 1), degree=2)
    )
    supports = [{"on": "lower/bottom", **FIXED}, *upright("upper")]
    weight = {"bodies": ["upper"], "force": [0.0, 0.0, -7.0]}
    result = converged(model, case_of(supports, contact=[on_top("upper", "lower")], body_force=[weight]))
    np.testing.assert_allclose(result.contacts[0].force, [0, 0, 7], rtol=0, atol=1e-9)


@pytest.mark.parametrize("integration", ["segment", "element"])
def test_the_pressure_field_of_the_patch_test_is_the_applied_pressure(integration):
    case = patch_test_case(degree=2, integration=integration)
    result = converged(geom2iga.build(case), case)
    (contact,) = result.contacts
    np.testing.assert_allclose(contact.pressure, 1, rtol=0, atol=1e-10)
    np.testing.assert_allclose(contact.control_gap, -1 / 1e5, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(result.state.pressure, contact.pressure)
    assert contact.active.all()
    assert contact.area == pytest.approx(1.0, rel=1e-12)
    (face,) = result.model.faces("upper/bottom")
    np.testing.assert_allclose(result.pressure_at(contact, face, ANYWHERE[:, :2]), 1, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(contact.rows, np.sort(result.space.face_numbers(face)))


@pytest.mark.parametrize("gap", [0.0, 0.05, -0.02], ids=["touching", "apart", "overlapping"])
@pytest.mark.parametrize("tilt", [0.0, 2.0], ids=["parallel", "tilted"])
def test_blocks_that_start_anywhere_end_in_few_steps_and_in_balance(gap, tilt):
    """Neither how far apart they are nor that some control points touch and others do not makes the set cycle."""
    lower = block_patch("lower", size=(2, 2, 1), degree=2, spans=(3, 3, 2))
    punch = block_patch("upper", (-0.5, -0.5, 0), degree=2, spans=(4, 3, 2))
    upper = moved(turned(punch, Rotation.from_rotvec([0, tilt, 0], degrees=True)), (1.1, 1, 1 + gap))
    supports = [{"on": "lower/bottom", **FIXED}, {"on": "upper/top", "ux": 0.0, "uy": 0.0, "uz": -0.08}]
    result = converged(model_of(lower, upper), case_of(supports, contact=[on_top("upper", "lower", penalty="auto")]))
    assert len(result.history) <= 10
    energies = [step.energy for step in result.history]
    assert np.all(np.diff(energies) <= 1e-12 * np.abs(energies).max())
    assert result.statistics["equilibrium_error"] < 1e-10
    (contact,) = result.contacts
    assert contact.force[2] > 0
    np.testing.assert_array_equal(contact.pressure > 0, contact.control_gap < 0)
    assert np.all(contact.pressure >= 0)


def test_a_body_that_is_lifted_away_takes_no_pressure():
    model = model_of(block_patch("lower", size=(2, 2, 1)), block_patch("upper", (0.5, 0.5, 1)))
    supports = [{"on": "lower/bottom", **FIXED}, {"on": "upper/top", "ux": 0.0, "uy": 0.0, "uz": 0.1}]
    result = converged(model, case_of(supports, contact=[on_top("upper", "lower")]))
    (contact,) = result.contacts
    assert not contact.active.any()
    assert contact.area == 0
    np.testing.assert_array_equal(contact.force, 0)
    np.testing.assert_allclose(contact.control_gap, 0.1, rtol=0, atol=1e-12)


def test_doubling_all_loads_doubles_the_answer_of_bodies_that_touch():
    case = patch_test_case(degree=2, upper_spans=(3, 5, 2), angle=20.0)
    model = geom2iga.build(case)
    single = converged(model, case)
    for load in case["solve"]["load"]:
        load["pressure"] *= 2
    double = converged(model, case)
    np.testing.assert_allclose(double.state.displacement, 2 * single.state.displacement, rtol=0, atol=1e-12)


def test_a_stiff_penalty_lets_bodies_overlap_less_and_the_force_stays():
    overlaps = []
    for penalty in (1e3, 1e4, 1e5):
        case = patch_test_case(penalty=penalty)
        result = converged(geom2iga.build(case), case)
        np.testing.assert_allclose(result.contacts[0].force, [0, 0, 1], rtol=0, atol=1e-12)
        overlaps.append(-result.contacts[0].control_gap.mean())
    np.testing.assert_allclose(overlaps, [1e-3, 1e-4, 1e-5], rtol=1e-9)


def test_too_few_steps_leave_no_state():
    lower = block_patch("lower", size=(2, 2, 1), degree=2, spans=(3, 3, 2))
    punch = turned(block_patch("upper", (-0.5, -0.5, 0), spans=(6, 3, 2)), Rotation.from_rotvec([0, 0.05, 0]))
    supports = [{"on": "lower/bottom", **FIXED}, {"on": "upper/top", "ux": 0.0, "uy": 0.0, "uz": -0.03}]
    case = case_of(supports, contact=[on_top("upper", "lower")], newton={"max_steps": 1})
    result = solve.solve(model_of(lower, moved(punch, (1, 1, 1))), case)
    assert result.status is solve.Status.MAX_STEPS
    assert result.states == ()
    assert len(result.history) == 1


def test_the_steps_are_reported_as_they_happen():
    case = patch_test_case()
    told = []
    result = solve.solve(geom2iga.build(case), case, told.append)
    assert tuple(told) == result.history


def test_statistics_tell_the_size_of_the_problem_and_where_the_time_went():
    case = patch_test_case()
    model = geom2iga.build(case)
    result = converged(model, case)
    statistics = result.statistics
    assert statistics["dofs"] == prepare(model, Solve.model_validate(case["solve"])).allowed.size
    assert statistics["newton_iterations"] == len(result.history)
    assert set(statistics["seconds"]) == {"contact", "assembly", "newton"}
    assert "CONVERGED" in repr(result)


@pytest.mark.parametrize(
    ("supports", "load", "names"),
    [
        ([{"on": "lower/bottom", **FIXED}], 1.0, ['"upper"', "slide along x and y", "turn about z"]),
        ([{"on": "lower/bottom", **FIXED}, *upright("upper")], -1.0, ['"upper"', "pull"]),
        (upright("upper"), 1.0, ['"lower"', "slide"]),
    ],
    ids=["not held sideways", "pulled off", "nothing stands on the ground"],
)
def test_a_body_that_can_move_freely_is_named(supports, load, names):
    model = model_of(block_patch("lower", size=(2, 2, 1)), block_patch("upper", (0.5, 0.5, 1)))
    case = case_of(supports, [{"on": "upper/top", "pressure": load}], [on_top("upper", "lower")])
    with pytest.raises(CaseError) as error:
        solve.solve(model, case)
    assert all(name in str(error.value) for name in names)


def test_a_body_that_nothing_touches_is_refused_even_without_load():
    model = model_of(block_patch("lower"), block_patch("astray", (5, 5, 5)))
    with pytest.raises(CaseError, match='"astray" can slide along x, y and z and turn about x, y and z'):
        solve.solve(model, case_of([{"on": "lower/bottom", **FIXED}]))


def test_a_folded_patch_is_a_geometry_error():
    patch = bent_patch(0)
    inside_out = patch.control_points * [1, 1, -1]
    with pytest.raises(GeometryError, match='"bent"'):
        solve.solve(model_of(replaced(patch, inside_out)), case_of([{"on": "bent/left", **FIXED}]))


def replaced(patch, control_points):
    return geom2iga.Patch(patch.name, patch.degrees, patch.knots, control_points, patch.weights)


def test_the_whole_result_turns_with_the_assembly():
    turn = Rotation.from_rotvec([0.3, -0.5, 0.9])
    patches = [
        block_patch("lower", size=(2, 2, 1), degree=2, spans=(2, 3, 1)),
        block_patch("upper", (0.4, 0.6, 1), spans=(3, 2, 1)),
    ]
    results = []
    for by in (None, turn):
        model = model_of(*(turned(patch, by) for patch in patches))
        down = [0.1, 0.2, -1.0] if by is None else list(by.apply([0.1, 0.2, -1.0]))
        supports = [{"on": "lower/bottom", **FIXED}]
        supports += [{"on": f"upper/{side}", "normal": 0.0} for side in ("left", "front")]
        case = case_of(supports, [{"on": "upper/top", "traction": down}], [on_top("upper", "lower", penalty=1e4)])
        results.append(converged(model, case))
    straight, tilted = results
    np.testing.assert_allclose(tilted.state.displacement, turn.apply(straight.state.displacement), rtol=0, atol=1e-12)
    np.testing.assert_allclose(tilted.state.pressure, straight.state.pressure, rtol=0, atol=1e-8)
    np.testing.assert_allclose(tilted.contacts[0].force, turn.apply(straight.contacts[0].force), rtol=0, atol=1e-10)
    xx, yy, zz, xy, yz, xz = stress_at(straight, "lower", ANYWHERE).T
    tensors = np.moveaxis(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), 2, 0)
    matrix = turn.as_matrix()
    expected = matrix @ tensors @ matrix.T
    found = stress_at(tilted, "lower", ANYWHERE)
    np.testing.assert_allclose(found[:, 2], expected[:, 2, 2], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[:, 3], expected[:, 0, 1], rtol=0, atol=1e-9)


def test_a_left_handed_patch_is_refused_with_its_remedy():
    mirrored = geom2iga.reversed_along(block_patch("bar"), 0)
    with pytest.raises(GeometryError, match=r'"bar" is left-handed.*reversed_along'):
        solve.solve(model_of(mirrored), case_of([{"on": "bar/bottom", **FIXED}]))


def test_the_force_on_a_secondary_side_of_several_bodies_is_that_on_all_of_them():
    patches = [
        block_patch("lower", size=(3, 1, 1)),
        *(block_patch(name, (x, 0, 1)) for name, x in (("a", 0), ("b", 2))),
    ]
    apart = model_of(*patches)
    groups = {**apart.groups, "feet": (*apart.faces("a/bottom"), *apart.faces("b/bottom"))}
    supports = [{"on": "lower/bottom", **FIXED}, *upright("a"), *upright("b")]
    load = [{"on": "a/top", "pressure": 1.0}, {"on": "b/top", "pressure": 2.0}]
    contact = {"secondary": "feet", "primary": "lower/top", "penalty": 1e6}
    result = converged(Model(apart.patches, apart.bodies, groups), case_of(supports, load, [contact]))
    np.testing.assert_allclose(result.contacts[0].force, [0, 0, 3], rtol=0, atol=1e-9)


def blunt_punch(spans, **contact):
    """A punch that sinks by 0.02 into a block."""
    block = {"name": "lower", "origin": [-2.0, -2.0, -1.0], "size": [4.0, 4.0, 1.0]}
    punch = {"name": "upper", "size": [2.0, 2.0, 1.0], "radius": 3.0, "bottom": "paraboloid", "spans": spans}
    model = geom2iga.build({"geometry": {"degree": 2, "block": [block], "domed_block": [punch]}})
    supports = [{"on": "lower/bottom", **FIXED}, {"on": "upper/top", **FIXED, "uz": -0.02}]
    case = case_of(supports, [], [{"secondary": "upper/bottom", "primary": "lower/top", **contact}])
    (found,) = converged(model, case).contacts
    return found


def test_an_overlap_that_a_coarse_mesh_averages_away_is_not_hidden():
    coarse, fine = blunt_punch(1), blunt_punch(12)
    np.testing.assert_array_equal(coarse.force, 0)
    assert len(coarse.warnings) == 1
    assert "points overlap by up to 0.02, averaged gaps by 0 at most" in coarse.warnings[0]
    assert fine.force[2] > 0.1
    assert fine.warnings == ()


def test_a_reach_that_cuts_off_contact_is_told():
    """Contact ends where the gap was nearly 0.02 before."""
    assert "the reach of 0.005 cuts off: raise it" in blunt_punch(12, reach=0.005).warnings[-1]
    assert blunt_punch(12, reach=0.1).warnings == ()


@pytest.mark.parametrize(("height", "told"), [(1.0, False), (0.9, False), (0.3, True)])
def test_bodies_that_start_deep_in_each_other_are_told(height, told):
    model = model_of(block_patch("lower", size=(2, 2, 1)), block_patch("upper", (0.5, 0.5, height)))
    supports = [{"on": "lower/bottom", **FIXED}, {"on": "upper/top", **FIXED}]
    (found,) = converged(model, case_of(supports, [], [on_top("upper", "lower")])).contacts
    assert any("a good part of their size" in warning for warning in found.warnings) == told
