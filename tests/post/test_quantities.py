from typing import get_args

import numpy as np
import pytest

from post.case import Scalar
from post.fields import sample_patch
from post.quantities import QUANTITIES
from solve.material import VOIGT


def test_the_case_file_names_just_the_quantities_that_exist():
    assert get_args(Scalar) == tuple(QUANTITIES)


def test_principal_stresses_are_those_of_the_characteristic_polynomial(bent):
    part = sample_patch(bent, "upper", 3)
    full = np.empty((len(part.stress), 3, 3))
    for number, (i, j) in enumerate(VOIGT):
        full[:, i, j] = full[:, j, i] = part.stress[:, number]
    largest, middle, smallest = (QUANTITIES[f"principal_{number}"].values(part) for number in (1, 2, 3))
    assert (largest >= middle).all()
    assert (middle >= smallest).all()
    size = np.abs(part.stress).max()
    np.testing.assert_allclose(largest * middle * smallest, np.linalg.det(full), atol=1e-12 * size**3)
    mean = QUANTITIES["hydrostatic_pressure"].values(part)
    np.testing.assert_allclose(largest + middle + smallest, -3 * mean, atol=1e-12 * size)
    differences = (largest - middle) ** 2 + (middle - smallest) ** 2 + (smallest - largest) ** 2
    np.testing.assert_allclose(QUANTITIES["von_mises"].values(part) ** 2, differences / 2, atol=1e-12 * size**2)


@pytest.mark.parametrize("name", QUANTITIES)
def test_every_quantity_has_a_value_at_every_sample_point(bent, name):
    part = sample_patch(bent, "lower", 3)
    values = QUANTITIES[name].values(part)
    assert values.shape == (len(part.points),)
    assert np.isfinite(values).all()
