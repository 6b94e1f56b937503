"""The notebook runs, and its pictures and numbers are what it says."""

import ast
import warnings
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")

ROOT = Path(__file__).parents[1]
NOTEBOOK = ROOT / "examples" / "notebook" / "contact.ipynb"
SMALL = 20_000  # characters of a notebook without pictures


def source():
    return nbformat.read(NOTEBOOK, as_version=4)


@pytest.fixture(scope="module")
def executed():
    """The notebook as executed by a kernel of its own, its code cells by their last line."""
    notebook = source()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the libraries that talk to the kernel
        nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(ROOT)}}).execute()
    return {cell.source.splitlines()[-1]: cell.outputs for cell in notebook.cells if cell.cell_type == "code"}


def found(executed, line):
    """What the cell that ends with a line shows, by kind."""
    (output,) = executed[line]
    return output.data


def test_the_notebook_is_kept_without_what_it_shows():
    notebook = source()
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not [cell for cell in code if cell.outputs or cell.execution_count]
    assert len(NOTEBOOK.read_text(encoding="utf-8")) < SMALL


@pytest.mark.slow
def test_the_notebook_warns_of_nothing(executed):
    streams = [output for outputs in executed.values() for output in outputs if output.output_type != "execute_result"]
    assert not [output for output in streams if output.output_type == "stream"]


@pytest.mark.slow
def test_models_patches_and_results_show_themselves_as_tables(executed):
    for line in ("model", 'model.patches["upper"]', "result"):
        data = found(executed, line)
        assert "upper" in data["text/plain"] or "CONVERGED" in data["text/plain"]
        assert data["text/html"].startswith("<table>")


@pytest.mark.slow
def test_a_result_and_its_pressure_are_drawn(executed):
    pictures = [
        line for line, outputs in executed.items() for output in outputs if "image/png" in output.get("data", {})
    ]
    assert 'result.plot("von_mises", units=units)' in pictures
    assert len(pictures) == 3


@pytest.mark.slow
def test_pressure_and_reach_are_those_of_hertz(executed):
    (line,) = [line for line in executed if "errors(exact).items()" in line]
    errors = {
        name: float(text.rstrip("% ")) for name, text in ast.literal_eval(found(executed, line)["text/plain"]).items()
    }
    assert abs(errors["largest pressure"]) < 1
    assert "passed=True" in found(executed, "post.verify(result, checked)")["text/plain"]
