import pytest

import geom2iga
import solve

CASE = "examples/contact_patch_test/case.toml"


@pytest.fixture(scope="session")
def case():
    return geom2iga.read_case(CASE)


@pytest.fixture(scope="session")
def patch_test(case):
    """The paper's case: uniform fields."""
    return solve.solve(geom2iga.build(case), case)


@pytest.fixture(scope="session")
def bent_case(case):
    """The upper block turned, off centre, hanging over an edge, and sheared: fields that vary."""
    return case.changed(
        {
            "geometry.block.1.rotate": {"angle": 17.0},
            "geometry.block.1.origin": [1.3, 0.4, 1.0],
            "geometry.block.1.spans": [3, 2, 2],
            "solve.load.0": {"on": "upper/top", "traction": [0.0, 0.2, -1.0]},
        }
    )


@pytest.fixture(scope="session")
def bent(bent_case):
    return solve.solve(geom2iga.build(bent_case), bent_case)
