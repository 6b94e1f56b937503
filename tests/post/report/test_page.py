import asyncio
import base64
import json
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import psutil
import pytest

import geom2iga
import solve
from geom2iga.errors import UserError
from geom2iga.tables import checked
from post.case import PostCase
from post.fields import Samples
from post.report import write_report
from tests.cases import patch_test_case
from tests.post.report.pages import leaves, page_of, summary_of

EIGHT_MEGABYTES = 8e6
DOT = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def summary(patch_test, case, tmp_path_factory):
    return summary_of(patch_test, case, tmp_path_factory.mktemp("summary"))


@pytest.fixture(scope="module")
def page(patch_test, case, summary, tmp_path_factory):
    """The report of the patch test."""
    return page_of(patch_test, case, summary, tmp_path_factory.mktemp("report") / "report.html")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "report.html"


def test_numbers_are_those_of_the_summary(page, summary):
    expected = {key: value for key, value in leaves(json.loads(json.dumps(summary))) if type(value) in (int, float)}
    assert all(repr(expected[key]) == value for key, value in page.numbers)
    told = {key for key, _ in page.numbers}
    of_one_step = {key for key in expected if key.startswith("load_steps.")}  # which are those of the whole
    assert expected.keys() - of_one_step <= told, "numbers of the summary that the report does not tell"


def test_the_summary_is_told_under_title_and_status(page):
    assert page.text.startswith("Contact patch test")
    assert "converged" in page.text
    assert "2 of 2 checks passed" in page.text
    assert "Taylor & Papadopoulos 1991: uniform by statics" in page.text
    assert "F/UL²" in page.text


def test_every_link_of_the_contents_leads_to_a_section(page):
    links = {found["href"] for found in page.all("a")}
    assert links == {f"#{name}" for name in page.sections}


def test_the_case_is_shown_as_in_its_file_with_comments(page, case):
    text = (case.folder / case.name).read_text(encoding="utf-8")
    assert " ".join(text.split()) in page.text


def test_a_changed_case_is_shown_as_changed_without_the_comments_of_its_file(patch_test, case, summary, path):
    changed = case.changed({"solve.material.0.young": 1234.5})
    text = page_of(patch_test, changed, summary, path).text
    assert "young = 1234.5" in text
    assert "young = 1000.0" not in text
    assert "[[geometry.block]]" in text


def test_tables_of_the_third_stage_alone_have_no_case_file(patch_test, case, summary, path):
    assert "case" not in page_of(patch_test, checked(case, PostCase), summary, path).sections


def test_what_users_write_is_text_and_never_markup(patch_test, case, summary, path):
    evil = '<script>alert("1")</script> & "quotes" \'too\''
    page = page_of(patch_test, case.changed({"title": evil}), summary | {"title": evil}, path)
    assert page.all("script") == []
    assert page.text.count(evil) == 2  # title and heading
    assert page.text.count("<script>alert") == 3  # and the case


def test_missed_checks_are_told_at_the_top_and_in_their_row(patch_test, case, tmp_path):
    wrong = case.changed({"verify.1.value": -3.0})
    page = page_of(patch_test, wrong, summary_of(patch_test, wrong, tmp_path), tmp_path / "report.html")
    assert "1 of 2 checks missed" in page.text
    assert "✗ missed displacement along z" in page.text
    assert [found for found in page.all("tr") if found.get("class") == "missed"]


def test_warnings_stand_above_everything_else_and_at_their_contact(patch_test, case, summary, path):
    warning = "points overlap by <1e-3>"
    contact = [{**summary["contact"][0], "warnings": [warning]}]
    text = page_of(patch_test, case, summary | {"contact": contact}, path).text
    assert text.count(warning) == 2
    assert text.index(warning) < text.index("Unknowns")


def test_reactions_are_told_with_their_sum(patch_test, case, summary, path):
    reactions = [
        {"on": "lower/bottom", "force": [0.5, 0.0, 4.0], "moment": [1.0, 2.0, 3.0]},
        {"on": "lower/left", "force": [0.25, 0.0, 0.0], "moment": [1.0, 1.0, 1.0]},
    ]
    page = page_of(patch_test, case, summary | {"reactions": reactions}, path)
    assert ("reactions.1.force.0", "0.25") in page.numbers
    assert "Sum 0.75 0 4 2 3 4" in page.text


def test_each_load_step_has_its_contact_and_its_newton_steps(case, tmp_path):
    two = geom2iga.tables.Case(patch_test_case()).changed({"solve.steps": {"factors": [0.25, 1.0]}})
    result = solve.solve(geom2iga.build(two), two)
    page = page_of(result, two, summary_of(result, two, tmp_path), tmp_path / "report.html")
    assert ("load_steps.0.load_factor", "0.25") in page.numbers
    assert "Load step 1, 0.25 of the loads" in page.text
    assert "Load step 2, 1 of the loads" in page.text


def test_a_case_without_contact_checks_and_units_has_no_such_sections(tmp_path):
    tables = patch_test_case()
    tables["geometry"]["block"].pop()
    tables["solve"] |= {"contact": [], "support": tables["solve"]["support"][:3], "load": tables["solve"]["load"][1:2]}
    tables["solve"]["load"][0].pop("exposed")
    result = solve.solve(geom2iga.build(tables), tables)
    page = page_of(result, tables, summary_of(result, tables, tmp_path), tmp_path / "report.html")
    assert page.sections == {"scene", "reactions", "bodies", "geometry", "mesh", "solver", "case"}
    assert "no checks" in page.text
    assert "Untitled case" in page.text
    assert len(page.all("abbr")) == 2, "units other than those of time and memory"


def test_pictures_are_inside_the_page_each_once_with_a_caption(patch_test, case, summary, path):
    folder = path.parent
    files = [
        folder / name
        for name in ("stress.png", "stress.pdf", "contact_pressure_2.png", "stress.svg", "line_across.svg")
    ]
    for file in files:
        file.write_bytes(DOT if file.suffix == ".png" else b"<svg xmlns='http://www.w3.org/2000/svg'/>")
    line = {"name": "across", "start": [0.0, 0.0, 0.0], "end": [1.0, 1.0, 1.0]}
    page = page_of(patch_test, case.changed({"post": {"line": [line]}}), summary, path, files)
    first, numbered, second = page.all("img")
    assert first["src"] == "data:image/png;base64," + base64.b64encode(DOT).decode()
    assert first["alt"].startswith("Vertical stress")
    assert numbered["alt"] == "Contact pressure on the secondary faces of contact 2"
    assert second["src"].startswith("data:image/svg+xml;base64,")
    assert second["alt"] == "across: von Mises stress along the line from (0, 0, 0) to (1, 1, 1)"


def test_the_page_names_no_address_on_the_network(page):
    loaded = [found.get(key) or "" for _, found in page.elements for key in ("src", "href", "action", "data")]
    assert not [address for address in loaded if address and not address.startswith(("#", "data:"))]
    scene = page.all("iframe")[0]["srcdoc"]
    assert "kitware.github.io/vtk-js/icon" not in scene
    assert "default-src 'none'" in page.all("meta")[2]["content"]


def test_the_report_of_the_patch_test_leaves_room_for_pictures_below_eight_megabytes(page):
    assert len(page.source.encode()) < EIGHT_MEGABYTES / 2


def test_nothing_is_left_running_and_no_file_beside(patch_test, case, summary, path):
    def state():
        return threading.enumerate(), psutil.Process().net_connections()

    before = state()
    page_of(patch_test, case, summary, path)
    assert state() == before
    assert list(path.parent.iterdir()) == [path]


def test_a_report_can_be_written_in_a_thread_and_where_an_event_loop_runs(patch_test, case, summary, path):
    def write():
        write_report(path, Samples(patch_test, 2), summary, case, ())
        return path.read_text(encoding="utf-8")

    async def from_a_notebook():
        return write()

    with ThreadPoolExecutor(1) as pool:
        in_thread = pool.submit(write).result()
    assert in_thread.endswith("</html>")
    assert len(asyncio.run(from_a_notebook())) == pytest.approx(len(in_thread), rel=1e-3)


def test_a_missing_library_is_told_in_one_sentence(patch_test, case, summary, path, monkeypatch):
    monkeypatch.setitem(sys.modules, "trame_vtk.tools.vtksz2html", None)
    with pytest.raises(UserError, match=r"report\.html needs trame-vtk .* pip install trame-vtk"):
        page_of(patch_test, case, summary, path)
    assert not path.exists()


def test_a_model_without_certificates_is_told_so(patch_test, case, summary, path):
    bare = replace(patch_test, model=replace(patch_test.model, certificates={}))
    assert "no certificates" in page_of(bare, case, summary | {"patches": {}}, path).text
