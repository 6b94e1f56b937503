"""What iga-post shows of an analysis whose later load steps did not converge."""

import json
import shutil

import pytest
import tomlkit

import geom2iga
import post
import solve
from post.pipeline import main as run
from solve.__main__ import STEPS
from tests.solve.failing import STOPPED, WAYS

LITTLE = {"pictures": False, "samples": 2}
WANTED = {"verify": [{"quantity": "uz", "on": "upper/top", "value": -0.05, "tolerance": 1e-9}]}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the third load step of four did not converge."""
    folder = tmp_path_factory.mktemp("stopped")
    (folder / "case.toml").write_text(tomlkit.dumps({**STOPPED, "post": LITTLE, **WANTED}))
    assert run(["-q", str(folder / "case.toml")]) == 4
    return folder


def test_the_last_load_step_that_converged_is_shown_and_said_to_be_that(folder, capsys):
    for _ in range(2):  # it is never up to date
        assert post.__main__.main([str(folder / "case.toml")]) == 4
        err = capsys.readouterr().err
        assert "iga-post: NOT CONVERGED: shows load step 2 of 4" in err
        assert err.splitlines()[-1].endswith(f"shows load step 2 of 4: {solve.Status.MAX_STEPS.value}")
    out = folder / "case.out"
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "max_steps"
    assert [step["load_factor"] for step in summary["load_steps"]] == [0.25, 0.5]
    assert summary["diagnosis"]["load_step"] == 3
    assert summary["verify"] == []
    expected = {"bodies.vtu", "contact.vtu", "bezier.vtu", "history.csv", "load_steps.csv", "report.html"}
    assert expected <= set(summary["files"])
    page = (out / "report.html").read_text()
    assert "NOT CONVERGED: shows load step 2 of 4" in page
    assert "try 1: solve.newton.max_steps above 5" in page
    assert (out / STEPS).is_file()


@pytest.mark.parametrize(
    ("old", "new"),
    [("0.25, 0.5,", "0.25, 0.6,"), ("0.75, 1.0", "0.75, 0.9, 1.0"), ("penalty = 1000000.0", "penalty = 2e6")],
)
def test_load_steps_of_another_case_are_not_shown(folder, tmp_path, capsys, old, new):
    shutil.copytree(folder, tmp_path / "copy")
    path = tmp_path / "copy" / "case.toml"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    assert post.__main__.main(["-q", str(path)]) == 2
    assert "run iga-solve first" in capsys.readouterr().err


def test_what_showed_the_failure_is_gone_once_it_converges(folder):
    path = folder / "case.toml"
    path.write_text(path.read_text().replace("max_steps = 5", "max_steps = 50"))
    assert run(["-q", str(path)]) == 0
    summary = json.loads((folder / "case.out" / "summary.json").read_text())
    assert summary["status"] == "converged"
    assert summary["diagnosis"] is None
    assert "NOT CONVERGED" not in (folder / "case.out" / "report.html").read_text()
    assert not (folder / "case.out" / STEPS).exists()


def test_where_no_load_step_has_converged_there_is_nothing_to_show(tmp_path, capsys):
    path = tmp_path / "case.toml"
    path.write_text(tomlkit.dumps({**WAYS[solve.Status.UNBOUNDED].tables, "post": LITTLE}))
    assert run(["-q", str(path)]) == 4
    before = sorted(each.name for each in (tmp_path / "case.out").iterdir())
    capsys.readouterr()
    assert post.__main__.main(["-q", str(path)]) == 4
    assert "nothing to show" in capsys.readouterr().err
    assert sorted(each.name for each in (tmp_path / "case.out").iterdir()) == before


def test_from_python_it_is_the_same(tmp_path):
    case = {**STOPPED, "post": {**LITTLE, "report": False}, **WANTED}
    result = solve.solve(geom2iga.build(case), case)
    summary = post.export(result, case, tmp_path)
    assert summary["status"] == "max_steps"
    assert summary["verify"] == []
