import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import geom2iga
import solve
from geom2iga.patch import elevated, refined
from solve.case import Solve
from solve.elasticity import assemble_stiffness
from solve.iterative import Iterated
from solve.linear import SuperLU
from solve.problem import prepare
from solve.system import reduced_system
from solve.tangents import Factorised
from tests.cases import bent_patch, block_patch, hollow_cylinder, model_of, moved, patch_test_case
from tests.strategies import SEEDS

STEEL = {"young": 1000.0, "poisson": 0.3}
FIXED = {"ux": 0.0, "uy": 0.0, "uz": 0.0}
CLAMPED = [{"on": "body/bottom", **FIXED}]
PULLED = [{"on": "body/top", "traction": [0.3, -0.2, 1.0]}]
SCALE = 1000.0 * 3  # E/h of the stacked blocks


@pytest.fixture(scope="module", autouse=True)
def superlu():
    """Factors by SuperLU, which is sooner ready for small problems than PARDISO."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("solve.linear.find_spec", lambda name: None)
        yield


def case_of(support=CLAMPED, load=PULLED, contact=(), material=(STEEL,), **more):
    tables = {"material": material, "support": support, "load": load, "contact": contact}
    return {"solve": {**{key: [dict(entry) for entry in entries] for key, entries in tables.items()}, **more}}


def tangents_of(model, case):
    """The problem in its free unknowns, its law, and both ways to solve with its tangents."""
    problem = prepare(model, Solve.model_validate(case["solve"]))
    stiffness = assemble_stiffness(problem.space, problem.materials)
    system = reduced_system(
        stiffness, problem.load, problem.mortar, problem.law.springs, problem.allowed, problem.rigid
    )
    return system, problem.law, Factorised(system.tangent, SuperLU()), Iterated(problem)


def norm(system, active, error):
    """The energy norm of a displacement (free,)."""
    return np.sqrt(error @ (system.tangent(active) @ error))


def both(model, case):
    """Solved with factors and by conjugate gradients."""
    for method in ("direct", "iterative"):
        result = solve.solve(model, {"solve": {**case["solve"], "linear": {"method": method}}})
        assert result.status is solve.Status.CONVERGED, f"{method}: {result.status.value}"
        yield result


def assert_agree(model, case, tolerance=1e-9):
    """Both ways lead to the same displacements, and to the same pressures."""
    direct, iterative = both(model, case)
    assert iterative.statistics["linear_solver"] == "conjugate gradients"
    for one, other in zip(direct.states, iterative.states, strict=True):
        scale = np.abs(one.displacement).max(initial=0.0)
        np.testing.assert_allclose(other.displacement, one.displacement, rtol=0, atol=tolerance * scale)
        scale = np.abs(one.pressure).max(initial=0.0)
        np.testing.assert_allclose(other.pressure, one.pressure, rtol=0, atol=10 * tolerance * scale)
    return iterative


def stacked(degree=2, lower=(4, 4, 2), upper=(3, 3, 2), gap=0.0):
    """A block on a larger one."""
    return model_of(
        block_patch("lower", size=(2, 2, 1), degree=degree, spans=lower),
        block_patch("upper", (0.5, 0.5, 1 + gap), degree=degree, spans=upper),
    )


UPRIGHT = [{"on": "lower/bottom", **FIXED}, {"on": "upper/left", "ux": 0.0}, {"on": "upper/front", "uy": 0.0}]
PRESSED = [{"on": "upper/top", "pressure": 1.0}, {"on": "upper/right", "pressure": 0.5}]


def pressed(support=UPRIGHT, load=PRESSED, **contact):
    return case_of(support, load, [{"secondary": "upper/bottom", "primary": "lower/top", **contact}])


LAWS = {
    "springs": {"penalty": 100.0},
    "stiff springs": {"penalty": 900 * SCALE},
    "a compliance": {"penalty": 1e9 * SCALE},
    "multipliers": {"enforcement": "lagrange"},
    "p-2": {"enforcement": "lagrange", "multiplier": "p-2"},
    "two passes": {"two_pass": True},
    "KTS": {"method": "kts"},
}
SLOW = pytest.mark.slow
NAMES = [pytest.param(n, marks=SLOW) if n in ("stiff springs", "p-2", "two passes") else n for n in LAWS]


@pytest.mark.parametrize("name", NAMES)
def test_it_solves_with_the_springs_of_any_active_gaps_as_exactly_as_it_is_asked_to(name):
    system, _, factorised, iterated = tangents_of(stacked(), pressed(**LAWS[name]))
    random = np.random.default_rng(0)
    for share in (0.4, 0.8, 1.0):
        active, right = random.random(len(system.area)) < share, random.normal(size=len(system.load))
        assert system.holds(active)
        exact = factorised.solved(active, right)
        for tolerance in (1e-2, 1e-4):
            error = norm(system, active, iterated.solved(active, right, tolerance) - exact)
            assert error <= 5 * tolerance * norm(system, active, exact)


@pytest.mark.parametrize("name", NAMES)
def test_with_multipliers_it_finds_displacement_and_pressure_to_rounding(name):
    system, law, factorised, iterated = tangents_of(stacked(), pressed(**LAWS[name]))
    active = np.ones(len(system.area), dtype=bool)
    free, pressure = iterated.equalised(system, law, active, np.zeros(len(active)))
    assert_solved(system, law, active, free, pressure)
    if law.compliance.any() or name == "multipliers":  # of others the pressure need not be unique
        expected, _ = factorised.equalised(system, law, active, np.zeros(len(active)))
        np.testing.assert_allclose(free, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def assert_solved(system, law, active, free, pressure, tolerance=1e-10):
    """Forces balance, and the gaps that press are as the law says."""
    forces = system.stiffness @ free, system.gap_operator.T @ pressure
    scale = max(np.abs(force).max() for force in forces)
    assert np.abs(system.load - forces[0] + forces[1]).max() <= tolerance * scale
    gap = system.control_gaps(free) + law.compliance * pressure
    assert np.abs(gap[active]).max() <= tolerance * np.abs(free).max()
    np.testing.assert_array_equal(pressure[~active], 0)


@pytest.mark.parametrize("load", [PRESSED, []])
@pytest.mark.parametrize("name", ["a compliance", "multipliers"])
def test_bodies_that_overlap_are_pushed_apart_with_and_without_loads(name, load):
    held = [{"on": "lower/bottom", **FIXED}, {"on": "upper/top", **FIXED}]
    system, law, _, iterated = tangents_of(stacked(gap=-0.01), pressed(held, load, **LAWS[name]))
    active = np.ones(len(system.area), dtype=bool)
    free, pressure = iterated.equalised(system, law, active, np.zeros(len(active)))
    assert_solved(system, law, active, free, pressure)


def iterations(model, case, tolerance=1e-4):
    """How many a random right-hand side takes, all gaps closed."""
    system, _, _, iterated = tangents_of(model, case)
    random = np.random.default_rng(0)
    iterated.solved(np.ones(len(system.area), dtype=bool), random.normal(size=len(system.load)), tolerance)
    return iterated.iterations


@pytest.mark.parametrize(("degree", "spans"), [(1, 1), (1, 8), (2, 1), (2, 8), (3, 2), (3, 6), (4, 1), (4, 4)])
def test_a_clamped_cube_takes_a_few_iterations_whatever_its_mesh_and_degree(degree, spans):
    assert iterations(model_of(block_patch("body", degree=degree, spans=(spans,) * 3)), case_of()) <= 25


@pytest.mark.parametrize("method", ["springs", "multipliers"])
@pytest.mark.parametrize("penalty", [1e-3, 1e3, 1e12])
@pytest.mark.parametrize(("degree", "spans"), [(1, 2), (3, 4)])
def test_contact_takes_a_few_iterations_whatever_penalty_mesh_and_degree(method, penalty, degree, spans):
    model = stacked(degree, (spans + 1, spans + 1, 2), (spans, spans, 2))
    system, law, _, iterated = tangents_of(model, pressed(penalty=penalty * 1000))
    active = np.ones(len(system.area), dtype=bool)
    if method == "springs":
        iterated.solved(active, system.load, 1e-4)
        assert iterated.iterations <= 25
    else:
        iterated.equalised(system, law, active, np.zeros(len(active)))
        assert iterated.iterations <= 100  # four to five corrections


def graded(ratio, degree=2, spans=8):
    sizes = np.geomspace(1, ratio, spans)
    knots = np.cumsum(sizes)[:-1] / sizes.sum()
    return refined(block_patch("body", degree=degree), knots=[knots] * 3)


def repeated(degree=3):
    return refined(block_patch("body", degree=degree), knots=[[0.3, 0.3, 0.7], [0.5, 0.5, 0.5], [0.2, 0.9, 0.9]])


HARD = {
    "degrees 1, 3, 2": (block_patch("body", degree=(1, 3, 2), spans=(3, 2, 4)), 25),
    "plate": (block_patch("body", size=(1, 1, 0.01), degree=2, spans=(6, 6, 1)), 25),
    "graded by 1000": (graded(1e3, 2, 7), 25),
    "graded by 1000, degree 3": (graded(1e3, 3, 5), 25),
    "repeated knots": (repeated(), 25),
    "bent": (bent_patch(2, (3, 2, 3), (3, 3, 3), name="body"), 30),
    "turned": (block_patch("body", degree=2, spans=(4, 4, 4), turn=Rotation.from_rotvec([1, 2, 3])), 45),
    "far from the origin": (moved(block_patch("body", degree=2, spans=(4, 4, 4)), (1e4, -1e4, 1e4)), 25),
    "quarter of a hollow cylinder": (refined(elevated(hollow_cylinder(name="body"), (2, 2, 2)), spans=4), 35),
}

ALONG_AXES = [{"on": "body/bottom", "ux": 0.0}, {"on": "body/left", "uy": 0.0}, {"on": "body/front", "uz": 0.0}]


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=SLOW) if n in ("graded by 1000, degree 3", "repeated knots") else n for n in HARD]
)
def test_graded_curved_and_thin_bodies_take_hardly_more_iterations_and_have_the_same_solution(name):
    patch, most = HARD[name]
    case = case_of(ALONG_AXES if name == "turned" else CLAMPED)
    assert iterations(model_of(patch), case) <= most
    assert_agree(model_of(patch), case, 1e-8)


@pytest.mark.parametrize(("poisson", "most"), [(0.0, 25), (0.45, 35), (0.49, 65), (-0.5, 35)])
def test_iterations_grow_slowly_towards_the_incompressible(poisson, most):
    material = [{"young": 1000.0, "poisson": poisson}]
    model, case = model_of(block_patch("body", degree=2, spans=(4, 4, 4))), case_of(material=material)
    assert iterations(model, case) <= most
    assert_agree(model, case)


@pytest.mark.parametrize("ratio", [1e-4, 1e4])
def test_bodies_may_differ_in_stiffness_ten_thousand_times(ratio):
    model, case = stacked(), pressed(penalty=1e4)
    case["solve"]["material"] = [
        {"bodies": ["lower"], "young": 1000.0, "poisson": 0.3},
        {"bodies": ["upper"], "young": 1000.0 * ratio, "poisson": 0.2},
    ]
    assert iterations(model, case) <= 60
    assert_agree(model, case, 1e-8)


SUPPORTS = {
    "oblique": (
        block_patch("body", degree=2, spans=(3, 3, 3), turn=Rotation.from_rotvec([0.3, 0.5, 0.7])),
        [{"on": "body/bottom", "normal": 0.0}, {"on": "body/left", "normal": 0.1}, {"on": "body/front", "normal": 0.0}],
    ),
    "a curved face": (
        refined(elevated(hollow_cylinder(name="body"), (2, 2, 2)), spans=2),
        [{"on": "body/left", "ux": 0.1, "uy": -0.2, "uz": 0.3}],
    ),
    "the symmetry of a ring": (
        refined(elevated(hollow_cylinder(name="body"), (2, 2, 2)), spans=2),
        [{"on": "body/front", "normal": 0.0}, {"on": "body/back", "normal": 0.0}, {"on": "body/bottom", "uz": 0.0}],
    ),
    "a displacement that differs from face to face": (
        block_patch("body", degree=2, spans=(3, 3, 3)),
        [*CLAMPED, {"on": "body/top", "ux": 0.1, "uy": 0.3, "uz": -0.2}],
    ),
    "around a corner": (
        block_patch("body", degree=3, spans=(2, 2, 2)),
        [{"on": "body/left", **FIXED}, {"on": "body/bottom", **FIXED}],
    ),
}


@pytest.mark.parametrize("load", [[], PULLED], ids=["no load", "load"])
@pytest.mark.parametrize("name", SUPPORTS)
def test_supports_of_all_kinds_lead_to_the_same_solution(name, load):
    patch, support = SUPPORTS[name]
    assert_agree(model_of(patch), case_of(support, load))


def test_a_contact_face_may_be_held_in_part():
    held = [{"on": "lower/bottom", **FIXED}, {"on": "upper/left", **FIXED}]
    for name in ("springs", "multipliers"):
        assert_agree(stacked(), pressed(held, **LAWS[name]), 1e-8)


@pytest.mark.parametrize("face", ["lower/top", "upper/bottom"])
def test_a_contact_face_may_be_held_altogether(face):
    support = [{"on": face, **FIXED}, *UPRIGHT]
    for name in ("springs", "multipliers"):
        assert_agree(stacked(), pressed(support, **LAWS[name]), 1e-8)


@pytest.mark.parametrize("gap", [0.0, 0.1, -0.01])
@pytest.mark.parametrize("name", ["springs", "multipliers"])
def test_a_floating_body_comes_to_rest_on_its_contact(name, gap):
    upright = [{"on": "upper/top", "pressure": 1.0}]
    assert_agree(stacked(gap=gap), pressed(load=upright, **LAWS[name]), 1e-8)


@pytest.mark.parametrize("dense", [0, 5000])
@pytest.mark.parametrize("name", ["springs", "multipliers", "two passes", "KTS"])
def test_bodies_that_stay_apart_do_not_feel_each_other(monkeypatch, name, dense):
    monkeypatch.setattr("solve.iterative.DENSE", dense)
    held = [{"on": "lower/bottom", **FIXED}, {"on": "upper/top", **FIXED}]
    result = assert_agree(stacked(gap=0.1), pressed(held, [{"on": "lower/top", "pressure": 1.0}], **LAWS[name]))
    np.testing.assert_array_equal(result.state.pressure, 0)


def test_without_load_nothing_moves():
    result = assert_agree(model_of(block_patch("body", degree=2)), case_of(load=[]))
    np.testing.assert_array_equal(result.state.displacement, 0)
    assert result.statistics["linear_iterations"] == 0


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("top", [FIXED, {"uz": 0.1}], ids=["all", "one axis"])
def test_two_opposite_faces_may_be_held(degree, top):
    """On one span of degree 1 nothing is left between them."""
    assert_agree(model_of(block_patch("body", degree=degree)), case_of([*CLAMPED, {"on": "body/top", **top}]))


@pytest.mark.parametrize("degree", [4, 5])
def test_one_span_of_high_degree_is_solved(degree):
    assert_agree(model_of(block_patch("body", degree=degree)), case_of(), 1e-8)


@pytest.mark.parametrize("degree", [5, pytest.param(6, marks=SLOW)])
def test_smooth_splines_of_high_degree_are_solved(degree):
    assert_agree(model_of(block_patch("body", degree=degree, spans=(4, 3, 2))), case_of(), 1e-8)


@settings(max_examples=6)
@given(SEEDS, st.tuples(*[st.integers(1, 3)] * 3), st.booleans())
def test_bent_bodies_of_any_degrees_have_the_same_solution(seed, degrees, rational):
    patch = bent_patch(seed, degrees, (2, 1, 2), name="body", rational=rational)
    assert_agree(model_of(patch), case_of(), 1e-8)


@pytest.mark.parametrize(("length", "stress"), [(1e-3, 1.0), (1e3, 1e6), (1e-9, 1e9), (1.0, 1e-9)])
def test_units_do_not_matter(length, stress):
    patch = block_patch("body", size=(length,) * 3, degree=2, spans=(2, 2, 2))
    material = [{"young": 1000.0 * stress, "poisson": 0.3}]
    load = [{"on": "body/top", "traction": [0.3 * stress, -0.2 * stress, stress]}]
    assert_agree(model_of(patch), case_of(load=load, material=material), 1e-8)


def test_factors_of_the_contact_part_are_used_again_while_the_gaps_stay():
    system, _, _, iterated = tangents_of(stacked(), pressed())
    active, right = np.ones(len(system.area), dtype=bool), system.load
    iterated.solved(active, right, 1e-4)
    iterated.solved(active, 2 * right, 1e-4)
    assert iterated.factorisations == 1
    iterated.solved(active & (np.arange(len(active)) > 0), right, 1e-4)
    assert iterated.factorisations == 2


@pytest.mark.parametrize("name", NAMES[2:])
def test_too_many_gaps_for_a_dense_complement_are_solved_for_by_iterations(monkeypatch, name):
    monkeypatch.setattr("solve.iterative.DENSE", 0)
    result = assert_agree(stacked(), pressed(**LAWS[name]), 1e-7)
    assert result.statistics["factorisations"] == 0


def test_the_patch_test_takes_few_steps_and_iterations():
    case = patch_test_case(2, lower_spans=(5, 4, 2), upper_spans=(3, 3, 2))
    _, result = both(geom2iga.build(case), case)
    assert result.statistics["newton_iterations"] <= 6
    assert result.statistics["linear_iterations"] <= 25 * result.statistics["newton_iterations"]
