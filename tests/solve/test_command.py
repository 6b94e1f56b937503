"""The command iga-solve: exit codes, what it says, what it writes."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import solve.__main__
from geom2iga.__main__ import main as geom2iga
from geom2iga.seal import digest_of
from solve.__main__ import FILE, STEPS, main
from solve.files import read_result, write_result
from tests.cases import TWO_BLOCKS


@pytest.fixture
def case(tmp_path):
    """A case file whose geometry has been made."""
    path = tmp_path / "case.toml"
    path.write_text(TWO_BLOCKS)
    assert geom2iga(["-q", str(path)]) == 0
    return path


def output(case):
    return case.parent / "case.out"


def edit(case, old, new):
    text = case.read_text()
    assert old in text
    case.write_text(text.replace(old, new))


def test_a_solution_is_written_and_then_up_to_date(case, capsys):
    assert main([str(case)]) == 0
    assert "converged" in capsys.readouterr().err
    written = (output(case) / FILE).read_bytes()
    assert main([str(case)]) == 0
    assert "up to date" in capsys.readouterr().err
    assert (output(case) / FILE).read_bytes() == written
    assert sorted(path.name for path in output(case).iterdir()) == ["geometry.h5", "log.txt", FILE]


def test_force_solves_again(case, capsys):
    main(["-q", str(case)])
    assert main(["-f", str(case)]) == 0
    assert "up to date" not in capsys.readouterr().err


def test_a_changed_case_is_solved_again(case, capsys):
    main(["-q", str(case)])
    edit(case, "uz = -0.01", "uz = -0.02")
    assert main([str(case)]) == 0
    assert "up to date" not in capsys.readouterr().err


def test_a_title_is_no_reason_to_solve_again(case, capsys):
    main(["-q", str(case)])
    edit(case, "two blocks", "the same blocks")
    assert main([str(case)]) == 0
    assert "up to date" in capsys.readouterr().err


def test_the_summary_is_json_on_standard_output_and_talk_is_on_standard_error(case, capsys):
    assert main(["--json", str(case)]) == 0
    printed = capsys.readouterr()
    summary = json.loads(printed.out)
    assert summary["status"] == "converged"
    assert summary["contact"][0]["force"][2] > 0
    assert summary["newton_iterations"] >= 1
    assert "solve:" in printed.err


def test_quiet_says_nothing(case, capsys):
    assert main(["-q", str(case)]) == 0
    printed = capsys.readouterr()
    assert printed.out == printed.err == ""


def test_a_dry_run_checks_and_writes_nothing(case, capsys):
    assert main(["-n", str(case)]) == 0
    assert "unknowns" in capsys.readouterr().err
    assert not (output(case) / FILE).exists()
    edit(case, '"upper/bottom"', '"upper/bottm"')
    assert main(["-n", str(case)]) == 2
    assert '"upper/bottm"' in capsys.readouterr().err


def test_without_geometry_it_says_what_to_run_first(tmp_path, capsys):
    path = tmp_path / "case.toml"
    path.write_text(TWO_BLOCKS)
    assert main([str(path)]) == 2
    message = capsys.readouterr().err
    assert "geometry.h5" in message
    assert "geom2iga" in message


def test_a_geometry_made_before_the_case_was_changed_is_named(case, capsys):
    edit(case, "spans = [2, 2, 1]", "spans = [3, 2, 1]")
    assert main([str(case)]) == 2
    message = capsys.readouterr().err
    assert "geometry.h5" in message
    assert "geom2iga" in message
    assert not (output(case) / FILE).exists()


def test_another_output_folder_can_be_named(case, tmp_path):
    folder = tmp_path / "elsewhere"
    assert geom2iga(["-q", str(case), "-o", str(folder)]) == 0
    assert main(["-q", str(case), "-o", str(folder)]) == 0
    assert (folder / FILE).is_file()
    assert not (output(case) / FILE).exists()


@pytest.mark.parametrize(
    ("old", "new", "names"),
    [
        ("young = 1000.0", "young = -1.0", ["solve.material[0].young"]),
        ("max_steps", "max_stepz", ['"max_stepz"', '"max_steps"']),
        ('on = "upper/top"', 'on = "upper/tap"', ["solve.support[1]", '"upper/tap"', '"upper/top"']),
        ("[solve.newton]", "[solver.newton]", ['"solver"', '"solve"']),
        ("max_steps = 50", "max_steps = ", ["TOML"]),
    ],
)
def test_a_wrong_case_is_one_sentence_on_standard_error_and_exit_code_2(case, capsys, old, new, names):
    edit(case, old, new)
    assert main([str(case)]) == 2
    printed = capsys.readouterr()
    assert all(name in printed.err.splitlines()[-1] for name in names)
    assert "Traceback" not in printed.err
    assert printed.out == ""
    assert not (output(case) / FILE).exists()


@pytest.mark.parametrize("arguments", [[], ["nowhere.toml"]])
def test_no_case_at_all_is_exit_code_2(arguments, capsys):
    assert main(arguments) == 2
    assert capsys.readouterr().err.strip()


def unfinished(case):
    """Make a case that one Newton step does not solve: a punch tilted onto the block, found apart."""
    tilted = "size = [1.0, 1.0, 1.0]\nspans = [6, 3, 2]\nrotate = { axis = [0, 1, 0], angle = 3.0 }"
    edit(case, "size = [1.0, 1.0, 1.0]", tilted)
    edit(case, "uz = -0.01", "uz = -0.03")
    edit(case, "max_steps = 50", "max_steps = 1")
    assert geom2iga(["-q", str(case)]) == 0


def test_no_convergence_is_exit_code_4_and_there_is_no_solution(case, capsys):
    unfinished(case)
    assert main([str(case)]) == 4
    assert "max_steps" in capsys.readouterr().err
    names = ["geometry.h5", "history.csv", "log.txt", STEPS, "summary.json"]
    assert sorted(path.name for path in output(case).iterdir()) == names


def test_no_convergence_keeps_the_solution_of_before(case):
    main(["-q", str(case)])
    before = (output(case) / FILE).read_bytes()
    unfinished(case)
    assert main(["-q", str(case)]) == 4
    assert (output(case) / FILE).read_bytes() == before


@pytest.mark.parametrize(("error", "code"), [(KeyboardInterrupt(), 130), (ZeroDivisionError("oops"), 1)])
def test_an_interruption_and_a_bug_of_ours_write_nothing(case, capsys, monkeypatch, error, code):
    def fail(*arguments):
        raise error

    monkeypatch.setattr(solve.__main__, "solve", fail)
    assert main([str(case)]) == code
    message = capsys.readouterr().err
    assert "Traceback" not in message
    assert sorted(path.name for path in output(case).iterdir()) == ["geometry.h5", "log.txt"]
    if code == 1:
        assert "oops" in message
        assert "Traceback" in (output(case) / "log.txt").read_text()


def test_a_failure_while_writing_leaves_no_half_file(case, monkeypatch):
    def fail(*arguments):
        raise OSError("disk full")

    monkeypatch.setattr("solve.files.put_model", fail)
    assert main(["-q", str(case)]) == 2
    assert sorted(path.name for path in output(case).iterdir()) == ["geometry.h5", "log.txt"]


def test_the_log_file_holds_every_newton_step(case):
    main(["-q", str(case)])
    text = (output(case) / "log.txt").read_text()
    assert "converged" in text
    assert "upper/bottom" in text


def test_the_schema_describes_the_solve_table(capsys):
    assert main(["--schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert "solve" in schema["properties"]
    assert "Contact" in schema["$defs"]


def test_it_runs_as_a_module():
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-m", "solve", "--help"], cwd=root, capture_output=True, text=True, check=True
    )
    assert "iga-solve" in done.stdout


STEPPED = """
[solve.steps]
factors = [0.25, 0.5, 1.0]
"""


@pytest.fixture
def stepped(case):
    """A case of three load steps."""
    case.write_text(case.read_text() + STEPPED)
    return case


def stop(monkeypatch, error, after=2):
    """Stop as the load step after some begins: raise an error from what is told of Newton steps."""
    report = solve.__main__.report_step

    def told(step):
        if step.load_step > after:
            raise error
        report(step)

    monkeypatch.setattr(solve.__main__, "report_step", told)


@pytest.mark.parametrize(("error", "code"), [(KeyboardInterrupt(), 130), (ZeroDivisionError("oops"), 1)])
def test_load_steps_before_an_interruption_are_kept_and_gone_on_from(stepped, capsys, monkeypatch, error, code):
    main(["-q", str(stepped)])
    whole = read_result(output(stepped) / FILE)
    (output(stepped) / FILE).unlink()
    with monkeypatch.context() as patch:
        stop(patch, error)
        assert main([str(stepped)]) == code
    assert sorted(path.name for path in output(stepped).iterdir()) == ["geometry.h5", "log.txt", STEPS]
    kept = read_result(output(stepped) / STEPS)
    assert [state.load_factor for state in kept.states] == [0.25, 0.5]
    capsys.readouterr()
    assert main([str(stepped)]) == 0
    assert "going on after load step 2" in capsys.readouterr().err
    result = read_result(output(stepped) / FILE)
    assert [state.load_factor for state in result.states] == [0.25, 0.5, 1.0]
    assert {step.load_step for step in result.history} == {1, 2, 3}
    np.testing.assert_array_equal(result.state.displacement, whole.state.displacement)
    assert result.statistics["equilibrium_error"] == whole.statistics["equilibrium_error"]
    assert digest_of(result.statistics) == digest_of(whole.statistics)
    assert sorted(path.name for path in output(stepped).iterdir()) == ["geometry.h5", "log.txt", FILE]


def test_load_steps_that_a_run_cut_off_at_its_end_left_behind_go_with_the_next(stepped, monkeypatch):
    def cut_off(path, *arguments):
        write_result(path, *arguments)
        if path.name == FILE:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(solve.__main__, "write_result", cut_off)
        assert main(["-q", str(stepped)]) == 130
    assert (output(stepped) / STEPS).exists()
    assert main(["-q", str(stepped)]) == 0
    assert sorted(path.name for path in output(stepped).iterdir()) == ["geometry.h5", "log.txt", FILE]


def test_damaged_load_steps_beside_a_solution_are_told_of_once(stepped, capsys):
    assert main(["-q", str(stepped)]) == 0
    (output(stepped) / STEPS).write_bytes((output(stepped) / FILE).read_bytes()[:-1])
    assert main([str(stepped)]) == 0
    assert f"{STEPS}: damaged" in capsys.readouterr().err
    assert main([str(stepped)]) == 0
    assert STEPS not in capsys.readouterr().err
    assert not (output(stepped) / STEPS).exists()


def test_a_changed_case_does_not_go_on_from_load_steps_of_another(stepped, capsys, monkeypatch):
    with monkeypatch.context() as patch:
        stop(patch, KeyboardInterrupt())
        main(["-q", str(stepped)])
    assert (output(stepped) / STEPS).is_file()
    edit(stepped, "uz = -0.01", "uz = -0.02")
    assert main([str(stepped)]) == 0
    assert "going on" not in capsys.readouterr().err
    assert not (output(stepped) / STEPS).exists()
    assert {step.load_step for step in read_result(output(stepped) / FILE).history} == {1, 2, 3}


def test_a_load_step_that_does_not_converge_is_named_and_those_before_are_kept(stepped, capsys):
    edit(stepped, "factors = [0.25, 0.5, 1.0]", "factors = [0.0, 1.0]")
    unfinished(stepped)
    edit(stepped, "rotate =", "# apart: nothing moves in the first step\norigin = [0.5, 0.5, 1.1]\nrotate =")
    edit(stepped, "origin = [0.5, 0.5, 1.0]\n", "")
    edit(stepped, "uz = -0.03", "uz = -0.15")
    assert geom2iga(["-q", str(stepped)]) == 0
    capsys.readouterr()
    assert main([str(stepped)]) == 4
    message = capsys.readouterr().err
    assert "load step 2" in message
    assert "max_steps" in message
    assert [state.load_factor for state in read_result(output(stepped) / STEPS).states] == [0.0]
    assert not (output(stepped) / FILE).exists()


def test_a_last_load_step_that_carries_a_share_of_the_loads_is_told(stepped, capsys):
    assert main([str(stepped)]) == 0
    assert "of the loads" not in capsys.readouterr().err
    edit(stepped, "factors = [0.25, 0.5, 1.0]", "factors = [0.25, 0.5]")
    assert main([str(stepped)]) == 0
    assert "iga-solve: the last load step carries 0.5 of the loads" in capsys.readouterr().err


def test_the_summary_of_what_did_not_converge_is_on_standard_output(stepped, capsys):
    unfinished(stepped)
    assert main(["--json", str(stepped)]) == 4
    out = capsys.readouterr().out
    assert json.loads(out) == json.loads((output(stepped) / "summary.json").read_text())
    assert json.loads(out)["diagnosis"]["load_step"] == 2


def test_one_load_step_leaves_no_file_of_steps(case):
    assert main(["-q", str(case)]) == 0
    assert not (output(case) / STEPS).exists()


def test_the_log_tells_force_moment_and_overlap_of_each_contact(case, capsys):
    assert main([str(case)]) == 0
    message = capsys.readouterr().err
    for word in ("force", "moment", "area", "overlap", "gaps closed"):
        assert word in message
