"""Every way in which an analysis can end, from a case file, through the command and from Python."""

import csv
import json
import shutil
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import tomlkit

import geom2iga
import solve
from geom2iga.__main__ import main as geom2iga_main
from solve import Status
from solve.__main__ import FILE, HISTORY, STEPS, SUMMARY, main
from solve.files import read_result
from tests.solve.failing import STOPPED, WAYS


class OnDisk(NamedTuple):
    """A case file, and what lies in its output folder."""

    path: Path

    @property
    def out(self):
        return self.path.parent / "case.out"

    @property
    def names(self):
        return sorted(path.name for path in self.out.iterdir())

    def edit(self, *pairs):
        text = self.path.read_text()
        for old, new in pairs:
            assert old in text
            text = text.replace(old, new)
        self.path.write_text(text)


def written(folder, tables):
    """A case file whose geometry has been made."""
    path = folder / "case.toml"
    path.write_text(tomlkit.dumps(tables))
    assert geom2iga_main(["-q", str(path)]) == 0
    return OnDisk(path)


@pytest.fixture(scope="module")
def failed(tmp_path_factory):
    """Where the third load step of four did not converge."""
    case = written(tmp_path_factory.mktemp("failed"), STOPPED)
    assert main(["-q", str(case.path)]) == 4
    return case


@pytest.fixture
def stopped(failed, tmp_path):
    """The same, to be changed."""
    shutil.copytree(failed.path.parent, tmp_path / "copy")
    return OnDisk(tmp_path / "copy" / "case.toml")


def rows(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_every_status_but_success_has_a_case():
    assert set(WAYS) == set(Status) - {Status.CONVERGED}


@pytest.mark.parametrize("status", WAYS, ids=lambda status: status.name)
def test_a_case_that_fails_says_so_why_and_what_to_try(status, tmp_path, capsys):
    case = written(tmp_path, WAYS[status].tables)
    assert main([str(case.path)]) == 4
    lines = capsys.readouterr().err.splitlines()
    assert lines[-1] == f"iga-solve: {status.value}"
    assert any(line.startswith(f"iga-solve: try 1: {WAYS[status].advice}") for line in lines)
    assert case.names == ["geometry.h5", HISTORY, "log.txt", STEPS, SUMMARY]
    left = read_result(case.out / STEPS)
    summary = json.loads((case.out / SUMMARY).read_text())
    assert left.status is status
    assert left.states == ()
    assert summary["status"] == status.name.lower()
    assert summary["diagnosis"]["seen"] == list(left.diagnosis.seen) != []
    assert summary["diagnosis"]["advice"] == list(left.diagnosis.advice) != []
    assert len(rows(case.out / HISTORY)) == len(left.history) == summary["newton_iterations"]
    assert f"try 1: {WAYS[status].advice}" in (case.out / "log.txt").read_text()


@pytest.mark.parametrize("status", WAYS, ids=lambda status: status.name)
def test_what_is_to_be_tried_first_helps(status):
    case = WAYS[status].case.changed(WAYS[status].change)
    result = solve.solve(geom2iga.build(case), case)
    assert result.status is Status.CONVERGED
    assert result.diagnosis is None


def test_errors_alone_are_printed_where_all_else_is_quiet(tmp_path, capsys):
    case = written(tmp_path, WAYS[Status.UNBOUNDED].tables)
    assert main(["-q", str(case.path)]) == 4
    assert capsys.readouterr().err == f"iga-solve: {Status.UNBOUNDED.value}\n"


def test_the_load_steps_before_the_one_that_fails_are_kept_with_all_newton_steps(tmp_path, capsys):
    case = written(tmp_path, STOPPED)
    assert main([str(case.path)]) == 4
    err = capsys.readouterr().err
    assert "load step 2 of 4 is kept" in err
    assert err.splitlines()[-1] == f"iga-solve: load step 3: {Status.MAX_STEPS.value}"
    left = read_result(case.out / STEPS)
    assert [state.load_factor for state in left.states] == [0.25, 0.5]
    assert (left.diagnosis.load_step, left.diagnosis.load_steps) == (3, 4)
    steps = [int(row["load_step"]) for row in rows(case.out / HISTORY)]
    assert sorted(set(steps)) == [1, 2, 3]
    assert steps.count(3) == 5
    assert not (case.out / FILE).exists()


@pytest.mark.parametrize(
    ("edits", "factors"),
    [
        ((), [0.25, 0.5, 0.75, 1.0]),
        ([("0.75, 1.0]", "0.6, 0.8, 1.0]")], [0.25, 0.5, 0.6, 0.8, 1.0]),
    ],
    ids=["more Newton steps", "shorter load steps"],
)
def test_after_a_failure_it_goes_on_with_more_effort_to_the_same_result(stopped, capsys, edits, factors):
    stopped.edit(("max_steps = 5\n", "max_steps = 50\n"), *edits)
    assert main([str(stopped.path)]) == 0
    assert "going on after load step 2" in capsys.readouterr().err
    assert stopped.names == ["geometry.h5", "log.txt", FILE]
    found = read_result(stopped.out / FILE)
    assert [state.load_factor for state in found.states] == factors
    assert sorted({step.load_step for step in found.history}) == list(range(1, len(factors) + 1))
    assert main(["-qf", str(stopped.path)]) == 0
    whole = read_result(stopped.out / FILE)
    for one, other in zip(found.states, whole.states, strict=True):
        np.testing.assert_array_equal(one.displacement, other.displacement)
        np.testing.assert_array_equal(one.pressure, other.pressure)


@pytest.mark.parametrize(
    ("old", "new", "kept"),
    [
        ("0.25, 0.5, 0.75, 1.0]", "0.25, 0.6, 1.0]", 1),
        ("0.25, 0.5, 0.75, 1.0]", "0.2, 0.5, 1.0]", 0),
        ("0.25, 0.5, 0.75, 1.0]", "0.25, 0.5]", 1),
        ("penalty = 1000000.0", "penalty = 100000.0", 0),
    ],
    ids=["another second step", "another first step", "the last one is always solved", "another penalty"],
)
def test_only_load_steps_of_the_same_problem_are_gone_on_from(stopped, capsys, old, new, kept):
    stopped.edit(("max_steps = 5\n", "max_steps = 50\n"), (old, new))
    assert main([str(stopped.path)]) == 0
    err = capsys.readouterr().err
    assert (f"going on after load step {kept}\n" in err) if kept else ("going on" not in err)
    assert stopped.names == ["geometry.h5", "log.txt", FILE]


def test_the_same_again_fails_the_same_way_from_the_load_steps_that_are_kept(stopped, capsys):
    before = read_result(stopped.out / STEPS)
    assert main([str(stopped.path)]) == 4
    err = capsys.readouterr().err
    assert "up to date" not in err
    assert "going on after load step 2" in err
    again = read_result(stopped.out / STEPS)
    assert again.diagnosis == before.diagnosis
    assert len(again.history) == len(before.history)
