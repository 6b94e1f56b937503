"""A column under its own weight: u = b (L z - z² / 2) / E, a polynomial of degree 2."""

import numpy as np
import pytest

from tests.cases import block_patch, converged, displacement_at, model_of, stress_at
from tests.oracles import assert_order

YOUNG, LENGTH, WEIGHT = 500.0, 3.0, -2.0


def column(degree, spans):
    model = model_of(block_patch("column", size=(1, 1, LENGTH), degree=degree, spans=(1, 1, spans)))
    case = {
        "material": [{"young": YOUNG, "poisson": 0.0}],
        "support": [
            {"on": "column/bottom", "uz": 0.0},
            {"on": "column/left", "ux": 0.0},
            {"on": "column/front", "uy": 0.0},
        ],
        "body_force": [{"force": [0.0, 0.0, WEIGHT]}],
    }
    return converged(model, {"solve": case})


def settlement(z):
    return WEIGHT * (LENGTH * z - z**2 / 2) / YOUNG


POINTS = np.random.default_rng(0).random((200, 3))


@pytest.mark.parametrize("spans", [1, 3])
@pytest.mark.parametrize("degree", [2, 3])
def test_from_degree_two_on_displacement_stress_and_energy_are_exact(degree, spans):
    result = column(degree, spans)
    z = LENGTH * POINTS[:, 2]
    expected = settlement(z)[:, None] * [0, 0, 1]
    np.testing.assert_allclose(displacement_at(result, "column", POINTS), expected, rtol=0, atol=1e-13)
    stress = np.zeros((len(z), 6))
    stress[:, 2] = WEIGHT * (LENGTH - z)
    np.testing.assert_allclose(stress_at(result, "column", POINTS), stress, rtol=0, atol=1e-11)
    assert result.statistics["strain_energy"] == pytest.approx(WEIGHT**2 * LENGTH**3 / (6 * YOUNG), rel=1e-12)


def test_in_degree_one_knots_settle_exactly_and_the_middle_is_off_by_the_square_of_the_span():
    sizes, errors = [], []
    for spans in (2, 4):
        result = column(1, spans)
        knots = np.full((spans + 1, 3), 0.5)
        knots[:, 2] = np.linspace(0, 1, spans + 1)
        found = displacement_at(result, "column", knots)[:, 2]
        np.testing.assert_allclose(found, settlement(LENGTH * knots[:, 2]), rtol=0, atol=1e-13)
        middle = np.array([[0.5, 0.5, 0.5 / spans]])
        errors.append(abs(displacement_at(result, "column", middle)[0, 2] - settlement(LENGTH * 0.5 / spans)))
        sizes.append(LENGTH / spans)
    assert_order(errors, sizes, order=2, tolerance=1e-6)
