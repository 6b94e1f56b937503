import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geom2iga.errors import CaseError
from solve.case import Solve
from solve.material import VOIGT, Material, find_materials, von_mises
from tests.cases import block_patch, model_of
from tests.strategies import SEEDS, rotations

MATERIALS = st.builds(Material, st.floats(1e-3, 1e12), st.floats(-0.9, 0.49))


def tensor(stress):
    """Stress (6,) as a symmetric matrix."""
    full = np.empty((3, 3))
    for value, (i, j) in zip(stress, VOIGT, strict=True):
        full[i, j] = full[j, i] = value
    return full


def voigt(stress):
    return np.array([[stress[i, j] for i, j in VOIGT]])


@given(MATERIALS)
def test_young_and_poisson_come_back_from_lame(material):
    lame, mu = material.lame
    assert mu * (3 * lame + 2 * mu) / (lame + mu) == pytest.approx(material.young, rel=1e-12)
    assert lame / (2 * (lame + mu)) == pytest.approx(material.poisson, rel=1e-12, abs=1e-15)


@given(MATERIALS)
def test_uniaxial_strain_state_of_a_bar_gives_uniaxial_stress(material):
    strain = np.diag([1.0, -material.poisson, -material.poisson])
    expected = [material.young, 0, 0, 0, 0, 0]
    np.testing.assert_allclose(material.stress(strain[None])[0], expected, rtol=0, atol=1e-12 * material.young)


@given(MATERIALS)
def test_volume_change_costs_the_bulk_modulus_and_shear_the_shear_modulus(material):
    bulk = material.young / (3 * (1 - 2 * material.poisson))
    swelling = material.stress(np.eye(3)[None] / 3)[0]
    np.testing.assert_allclose(swelling, [bulk, bulk, bulk, 0, 0, 0], rtol=1e-11)
    for row, (i, j) in enumerate(VOIGT):
        if i != j:
            slide = np.zeros((1, 3, 3))
            slide[0, i, j] = 1.0
            expected = np.zeros(6)
            expected[row] = material.young / (2 * (1 + material.poisson))
            np.testing.assert_allclose(material.stress(slide)[0], expected, rtol=1e-13)


@given(MATERIALS, SEEDS, rotations())
def test_stress_turns_with_the_body_and_ignores_turns_of_space(material, seed, turn):
    gradient = np.random.default_rng(seed).normal(size=(3, 3))
    spin = np.random.default_rng(seed + 1).normal(size=(3, 3))
    stress, matrix = material.stress(gradient[None]), turn.as_matrix()
    scale = 1e-12 * np.abs(stress).max()
    np.testing.assert_allclose(material.stress((gradient + spin - spin.T)[None]), stress, rtol=0, atol=20 * scale)
    of_turned = material.stress((matrix @ gradient @ matrix.T)[None])
    np.testing.assert_allclose(of_turned, voigt(matrix @ tensor(stress[0]) @ matrix.T), rtol=0, atol=scale)


@given(SEEDS, rotations(), st.floats(-10, 10))
def test_von_mises_is_the_norm_of_the_deviator_whatever_the_frame_or_the_pressure(seed, turn, pressure):
    stress = np.random.default_rng(seed).normal(size=6)
    deviator = tensor(stress) - np.trace(tensor(stress)) / 3 * np.eye(3)
    expected = pytest.approx(np.sqrt(1.5 * np.sum(deviator**2)), rel=1e-12)
    matrix = turn.as_matrix()
    assert von_mises(stress[None]) == expected
    assert von_mises(voigt(matrix @ tensor(stress) @ matrix.T - pressure * np.eye(3))) == expected


def test_von_mises_is_the_tension_of_a_bar_and_root_three_times_a_shear():
    assert von_mises(np.array([[0, -7.0, 0, 0, 0, 0]])) == pytest.approx(7.0)
    assert von_mises(np.array([[0, 0, 0, 0, 0, 2.0]])) == pytest.approx(2 * 3**0.5)


def found(*materials):
    case = Solve.model_validate({"material": materials})
    return find_materials(model_of(block_patch("lower"), block_patch("upper")), case)


def test_a_material_without_bodies_is_that_of_all():
    assert found({"young": 2.0, "poisson": 0.1}) == {"lower": Material(2.0, 0.1), "upper": Material(2.0, 0.1)}


def test_each_body_gets_the_material_that_names_it():
    materials = found(
        {"young": 2.0, "poisson": 0.1, "bodies": ["upper"]}, {"young": 3.0, "poisson": 0.2, "bodies": ["lower"]}
    )
    assert materials == {"upper": Material(2.0, 0.1), "lower": Material(3.0, 0.2)}


@pytest.mark.parametrize(
    ("bodies", "names"),
    [
        ([["lower"]], ['"upper"', "no material"]),
        ([["lower", "upper"], ["lower"]], ["solve.material[1]", '"lower"', "already"]),
        ([None, ["upper"]], ["solve.material[1]", '"upper"', "already"]),
        ([["lower", "uper"]], ["solve.material[0].bodies", '"uper"', 'did you mean "upper"']),
    ],
)
def test_a_body_with_no_material_or_two_or_an_unknown_one_is_named(bodies, names):
    with pytest.raises(CaseError) as error:
        found(*[{"young": 1.0, "poisson": 0.0, "bodies": names} for names in bodies])
    assert all(name in str(error.value) for name in names)
