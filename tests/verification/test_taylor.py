"""Taylor's patch test in plane strain: a punch of 2 x 2 on a foundation of 8 x 5, pressure 10, E = 1000, nu = 0.4.

The stress is uniform, so the vertical strain is -p (1 - nu²) / E: the interface settles by 5 p (1 - nu²) / E = 0.042,
the top of the punch by 7 p (1 - nu²) / E = 0.0588, and the penalty adds its overlap p / eps to the latter.
"""

import numpy as np
import pytest

import geom2iga
from tests.cases import converged, displacement_at, largest_stress_error

YOUNG, POISSON, PRESSURE = 1000.0, 0.4, 10.0


def taylor_case(degree, penalty):
    symmetric = [{"on": f"{body}/{side}", "uy": 0.0} for body in ("lower", "upper") for side in ("front", "back")]
    return {
        "geometry": {
            "degree": degree,
            "block": [
                {"name": "lower", "size": [8.0, 1.0, 5.0], "spans": [4, 1, 2]},
                {"name": "upper", "origin": [4.0, 0.0, 5.0], "size": [2.0, 1.0, 2.0], "spans": [3, 1, 3]},
            ],
        },
        "solve": {
            "material": [{"young": YOUNG, "poisson": POISSON}],
            "support": [
                {"on": "lower/bottom", "uz": 0.0},
                {"on": "lower/left", "ux": 0.0},
                {"on": "upper/left", "ux": 0.0},
                *symmetric,
            ],
            "load": [
                {"on": "upper/top", "pressure": PRESSURE},
                {"on": "lower/top", "pressure": PRESSURE, "exposed": True},
            ],
            "contact": [{"secondary": "upper/bottom", "primary": "lower/top", "penalty": penalty}],
        },
    }


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("penalty", [1e4, 1e7])
def test_interface_and_punch_settle_as_the_closed_form_says(degree, penalty):
    case = taylor_case(degree, penalty)
    result = converged(geom2iga.build(case), case)
    strain, overlap = PRESSURE * (1 - POISSON**2) / YOUNG, PRESSURE / penalty
    xi = np.random.default_rng(0).random((50, 3))
    for body, end, settled in [
        ("lower", 1, 5 * strain),
        ("upper", 0, 5 * strain + overlap),
        ("upper", 1, 7 * strain + overlap),
    ]:
        xi[:, 2] = end
        np.testing.assert_allclose(displacement_at(result, body, xi)[:, 2], -settled, rtol=0, atol=1e-10)
    assert largest_stress_error(result, [0, -POISSON * PRESSURE, -PRESSURE, 0, 0, 0]) < 1e-8
    np.testing.assert_allclose(result.contacts[0].force, [0, 0, 2 * PRESSURE], rtol=0, atol=1e-8)


def test_with_a_stiff_penalty_these_are_the_published_numbers():
    case = taylor_case(1, 1e9)
    result = converged(geom2iga.build(case), case)
    at = np.array([[0.5, 0.5, 1.0]])
    assert displacement_at(result, "lower", at)[0, 2] == pytest.approx(-0.042, abs=1e-7)
    assert displacement_at(result, "upper", at)[0, 2] == pytest.approx(-0.0588, abs=1e-7)
