"""What holds with sparse factors holds by conjugate gradients that store no matrix, and both find the same."""

import numpy as np
import pytest

import geom2iga
from solve import Status
from tests.cases import converged, largest_stress_error, patch_test_case
from tests.solve.test_methods import METHODS, WAYS, patch_test, rounded_punch, with_steps
from tests.verification.glued_bodies import glued_model, pressed
from tests.verification.test_multipatch import PAIRS

UNIFORM = (0.0, 0.0, -1.0, 0.0, 0.0, 0.0)

SLOW = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def superlu():
    """Factors by SuperLU, which is sooner ready for small problems than PARDISO."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("solve.linear.find_spec", lambda name: None)
        yield


def usual(names, *wanted):
    """Names of cases, of which all others are slow ones."""
    return [name if name in wanted else pytest.param(name, marks=SLOW) for name in names]


def iteratively(case):
    return {**case, "solve": {**case["solve"], "linear": {"method": "iterative"}}}


def directly(case):
    return {**case, "solve": {**case["solve"], "linear": {"method": "direct"}}}


def assert_same_states(found, expected, tolerance):
    """Two results agree in all load steps, displacements and the forces of all contacts."""
    assert len(found.states) == len(expected.states)
    for one, other in zip(found.states, expected.states, strict=True):
        assert one.load_factor == other.load_factor
        size = np.abs(other.displacement).max()
        np.testing.assert_allclose(one.displacement, other.displacement, rtol=0, atol=tolerance * size)
        for contact, reference in zip(one.contacts, other.contacts, strict=True):
            force = np.abs(reference.force).max()
            np.testing.assert_allclose(contact.force, reference.force, rtol=0, atol=tolerance * force)


@pytest.mark.parametrize("degree", [pytest.param(1, marks=SLOW), 2, pytest.param(3, marks=SLOW)])
@pytest.mark.parametrize("name", usual(METHODS, "penalty", "very stiff penalty", "Lagrange", "KTS", "two passes"))
def test_every_method_passes_the_patch_test(name, degree):
    if degree == 1 and "p-2" in name:
        return
    case = iteratively(patch_test(degree, **METHODS[name]))
    result = converged(geom2iga.build(case), case)
    assert result.statistics["linear_solver"] == "conjugate gradients"
    assert largest_stress_error(result, UNIFORM, 200) < 1e-10
    for contact, sign in zip(result.contacts, (1, -1), strict=False):
        np.testing.assert_allclose(contact.force, [0, 0, sign], rtol=0, atol=1e-10)
    if "Lagrange" in name:
        assert max(contact.penetration for contact in result.contacts) < 1e-9


HARDER = {
    "turned by 33, hanging over": {"angle": 33.0, "upper_origin": (1.3, 0.4, 1.0)},
    "lower side secondary": {"swap": True, "angle": 17.0},
    "apart": {"upper_origin": (0.5, 0.5, 1.01)},
    "overlapping": {"upper_origin": (0.5, 0.5, 0.99)},
    "degree 4": {"degree": 4, "lower_spans": (3, 2, 1), "upper_spans": (2, 3, 1)},
    "turned in space": {"turn": {"axis": [1.0, 2.0, -0.7], "angle": 77.0, "about": [0.3, -2.0, 1.0]}},
    "by element": {"integration": "element", "lower_spans": (2, 2, 2), "upper_spans": (2, 2, 2)},
}


@pytest.mark.parametrize("name", HARDER)
def test_the_patch_test_holds_wherever_the_blocks_lie(name):
    case = patch_test_case(**{"degree": 2, "lower_spans": (3, 3, 2), "upper_spans": (5, 4, 2), **HARDER[name]})
    model = geom2iga.build(case)
    found, expected = converged(model, iteratively(case)), converged(model, directly(case))
    assert_same_states(found, expected, 1e-9)
    assert found.statistics["equilibrium_error"] < 1e-10
    if name != "turned in space":
        assert largest_stress_error(found, UNIFORM) < 1e-10


MULTIPLIERS = pytest.param({"penalty": "auto", "enforcement": "lagrange"}, marks=SLOW)


@pytest.mark.parametrize(
    "pair", [PAIRS[0], pytest.param(PAIRS[1], marks=SLOW), PAIRS[2], pytest.param(PAIRS[3], marks=SLOW)]
)
@pytest.mark.parametrize("contact", [{"penalty": 1e5}, MULTIPLIERS], ids=str)
def test_the_patch_test_holds_between_bodies_of_several_patches(pair, contact):
    lower, upper, held = pair(1)
    case = pressed(held, **contact)
    result = converged(glued_model({"lower": lower, "upper": upper}), iteratively(case))
    assert largest_stress_error(result, UNIFORM) < 1e-10
    assert result.statistics["equilibrium_error"] < 1e-10


@pytest.mark.parametrize("name", usual(WAYS, "penalty", "augmented Lagrange", "Lagrange"))
def test_load_steps_of_all_methods_lead_through_the_same_states(name):
    """A rounded punch is pressed down, harder, and let go again."""
    model, case = rounded_punch(**WAYS[name])
    case = with_steps(case, 0.3, 1.0, -0.5)
    expected, found = converged(model, directly(case)), converged(model, iteratively(case))
    assert_same_states(found, expected, 1e-9)
    assert found.contacts[0].active.sum() == expected.contacts[0].active.sum() == 0
    assert found.states[1].contacts[0].active.any()


COARSE = [0.0, 0.0124, 0.0248, 0.0372, 0.0496, 0.062, 0.0744, 0.0868, 0.0992, 0.1116, 0.124, 0.18, 0.38, 1.0]
DEEP = [0.0, 0.014, 0.028, 0.056, 0.12, 0.32, 1.0]


@pytest.mark.parametrize(
    "contact", [{"penalty": "auto"}, pytest.param({"enforcement": "lagrange"}, marks=SLOW)], ids=str
)
def test_two_cylinders_press_each_other_as_hertz_has_it(contact):
    """On strips one span deep, graded towards the contact: Johnson 1985, sec. 4.2."""
    width, radius, young, poisson, pressure = 6.25, 8.0, 200.0, 0.3, 0.8
    block = {"size": [width, 0.1, width], "radius": radius, "bottom": "cylinder", "quarter": True}
    block["breaks"] = [COARSE, [0.0, 1.0], DEEP]
    turned = {"origin": [0.0, 0.1, 0.0], "rotate": {"axis": [1, 0, 0], "angle": 180}}
    held = ("lower/left", "upper/left", "lower/front", "lower/back", "upper/front", "upper/back")
    case = {
        "geometry": {"degree": 2, "domed_block": [{"name": "upper", **block}, {"name": "lower", **block, **turned}]},
        "solve": {
            "material": [{"young": young, "poisson": poisson}],
            "support": [{"on": "lower/top", "uz": 0.0}, *({"on": face, "normal": 0.0} for face in held)],
            "load": [{"on": "upper/top", "pressure": pressure}],
            "contact": [{"secondary": "upper/bottom", "primary": "lower/bottom", **contact}],
        },
    }
    model = geom2iga.build(case)
    found, expected = converged(model, iteratively(case)), converged(model, directly(case))
    assert_same_states(found, expected, 1e-8)
    force, effective = 2 * pressure * width, young / (2 * (1 - poisson**2))  # per length
    largest = np.sqrt(force * effective / (np.pi * radius / 2))
    assert found.contacts[0].pressure.max() == pytest.approx(largest, rel=0.02)
    assert found.status is Status.CONVERGED
