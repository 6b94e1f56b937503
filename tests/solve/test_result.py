import sys

import pytest
from matplotlib.figure import Figure

import geom2iga
import solve
from geom2iga.errors import CaseError
from solve.newton import Status
from tests.cases import converged, patch_test_case


@pytest.fixture(scope="module")
def result():
    case = patch_test_case(lower_spans=(2, 2, 1), upper_spans=(1, 1, 1))
    return converged(geom2iga.build(case), case)


def test_a_result_says_how_it_ended_and_what_its_contacts_carry(result):
    assert repr(result).startswith("Result(CONVERGED, ")
    assert f"{result.statistics['dofs']} dofs" in repr(result)
    assert "contact force 1)" in repr(result)
    assert "1 Newton step," in repr(result) or "Newton steps," in repr(result)


def test_a_notebook_shows_a_row_for_each_contact(result):
    html = result._repr_html_()
    assert html.count("<tr>") == 2
    assert "upper/bottom" in html
    assert "4 of 4" in html


def test_a_result_without_contact_shows_itself_too(result):
    lost = solve.Result(Status.MAX_STEPS, result.model, result.materials, (), (), result.statistics)
    assert "MAX_STEPS" in repr(lost)
    assert lost._repr_html_().count("<tr>") == 1


def test_a_result_draws_a_field(result):
    assert isinstance(result.plot("uz"), Figure)
    with pytest.raises(CaseError):
        result.plot("temperature")


def test_what_draws_is_looked_for_only_when_it_is_asked_for(result, monkeypatch):
    monkeypatch.setitem(sys.modules, "post.plots", None)
    with pytest.raises(ModuleNotFoundError, match=r"post\.plots"):
        result.plot()
