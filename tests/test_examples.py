"""Every example runs as its README says."""

import importlib.util
from pathlib import Path

import pytest

from post.pipeline import main

EXAMPLES = Path(__file__).parents[1] / "examples"


def script(path):
    """Import a script that lies beside a case."""
    specification = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


SLOW = ("hertz_sphere/sphere", "two_spheres/case", "hertz_hemisphere/case")
CASES = [
    pytest.param(path, id=name, marks=pytest.mark.slow if name in SLOW else ())
    for path in sorted(EXAMPLES.glob("*/*.toml"))
    for name in [f"{path.parent.name}/{path.stem}"]
]


@pytest.mark.parametrize("case", CASES)
def test_every_example_shows_its_known_answers(case, tmp_path):
    assert main(["-q", str(case), "-o", str(tmp_path)]) == 0


def test_every_example_has_a_readme():
    for case in EXAMPLES.glob("*/case.toml"):
        assert (case.parent / "README.md").is_file()


def test_the_sweep_over_degrees_holds_to_rounding():
    errors = script(EXAMPLES / "contact_patch_test" / "degrees.py").main()
    assert set(errors) == {1, 2, 3}
    assert max(errors.values()) < 1e-10


def test_the_table_of_the_readme_says_what_segment_and_element_cells_do():
    module = script(EXAMPLES / "contact_patch_test" / "table.py")
    case = module.geom2iga.read_case(EXAMPLES / "contact_patch_test" / "case.toml")
    header, segment, element = module.table(case, degrees=(1,))
    assert all(float(error) < 1e-10 for error in segment[2:])
    exact = [float(error) < 1e-10 for error in element[2:]]
    assert exact == [name == "matching" for name in header[2:]]


@pytest.mark.parametrize(
    ("folder", "pressure", "spans"),
    [
        ("hertz_cylinders", 0.001, 0.0389 / 0.68078),
        pytest.param("hertz_sphere", 0.005, 0.022 / 0.20157, marks=pytest.mark.slow),
        pytest.param("two_spheres", 0.01, 0.069 / 0.63018, marks=pytest.mark.slow),
        pytest.param("hertz_hemisphere", 0.03, 0.3 / 1.0235, marks=pytest.mark.slow),
    ],
)
def test_hertz_pressure_and_the_reach_of_contact_within_a_span(folder, pressure, spans):
    errors = script(EXAMPLES / folder / "profile.py").main()
    assert abs(errors["largest pressure"]) < pressure
    assert abs(errors["reach of contact"]) < spans
