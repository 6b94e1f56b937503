import numpy as np
import pytest

import solve
from solve.space import number_control_points
from solve.strain import largest_strains
from tests.cases import bent_patch, block_patch, hollow_cylinder, model_of


@pytest.mark.parametrize(
    "patch", [block_patch(spans=(2, 3, 1)), bent_patch(0), hollow_cylinder()], ids=lambda p: p.name
)
def test_a_uniform_strain_is_found_and_a_turn_is_none(patch):
    random = np.random.default_rng(0)
    gradient = random.normal(size=(3, 3))
    space = number_control_points(model_of(patch))
    found = largest_strains(space, space.control_points @ gradient.T + 7.0)[patch.name]
    assert found == pytest.approx(np.linalg.norm((gradient + gradient.T) / 2, 2), rel=1e-12)
    turn = gradient - gradient.T
    assert largest_strains(space, space.control_points @ turn.T)[patch.name] < 1e-12


@pytest.mark.parametrize(("pressure", "told"), [(1e6, 1), (110.0, 1), (90.0, 0)])
def test_strains_that_are_not_small_are_told_once_for_each_body(caplog, pressure, told):
    model = model_of(block_patch("still", (5, 0, 0)), block_patch("pressed"))
    case = {
        "material": [{"young": 1000.0, "poisson": 0.0}],
        "support": [
            {"on": "pressed/bottom", "ux": 0, "uy": 0, "uz": 0},
            {"on": "still/top", "ux": 0, "uy": 0, "uz": 0},
        ],
        "load": [{"on": "pressed/top", "pressure": pressure}],
        "steps": {"factors": [0.5, 1.0]},
    }
    assert solve.solve(model, {"solve": case}).status is solve.Status.CONVERGED
    said = [record.getMessage() for record in caplog.records if "strains reach" in record.getMessage()]
    assert len(said) == told
    assert all(f'body "pressed": strains reach {pressure / 1000:.2g}: small deformation' in line for line in said)
