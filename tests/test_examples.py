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


@pytest.mark.parametrize("case", sorted(EXAMPLES.glob("*/case.toml")), ids=lambda path: path.parent.name)
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
