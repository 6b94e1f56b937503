import csv
import json
import shutil
import subprocess
import sys

import meshio
import numpy as np
import pytest

import geom2iga
import post
import solve
from post.pipeline import main

CASE = "examples/contact_patch_test/case.toml"
FILES = {
    "geometry.h5",
    "solution.h5",
    "bodies.vtu",
    "contact.vtu",
    "bezier.vtu",
    "displacement.png",
    "stress.png",
    "contact_pressure.png",
    "contact_plane.png",
    "newton.png",
    "summary.json",
    "report.html",
    "history.csv",
    "reactions.csv",
    "log.txt",
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder with a case file and all its output."""
    folder = tmp_path_factory.mktemp("run")
    shutil.copy(CASE, folder / "case.toml")
    assert main(["-q", str(folder / "case.toml")]) == 0
    return folder


@pytest.fixture
def copy(finished, tmp_path):
    shutil.copytree(finished, tmp_path / "copy")
    return tmp_path / "copy"


def edited(folder, old, new):
    path = folder / "case.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return str(path)


def test_one_command_writes_everything_that_the_design_promises(finished):
    assert {path.name for path in (finished / "case.out").iterdir()} == FILES


def test_the_summary_holds_the_promised_numbers(finished):
    summary = json.loads((finished / "case.out" / "summary.json").read_text())
    assert summary["status"] == "converged"
    assert summary["dofs"] > 0
    assert set(summary["bodies"]) == {"lower", "upper"}
    assert summary["equilibrium_error"] < 1e-10
    assert summary["peak_memory"] > 1e6
    assert summary["contact"][0]["force"][2] == pytest.approx(1.0, abs=1e-10)
    assert summary["contact"][0]["area"] == pytest.approx(1.0, abs=1e-12)
    assert summary["contact"][0]["gap_min"] == pytest.approx(-1e-5, rel=1e-6)
    assert summary["bodies"]["upper"]["stress_min"][2] == pytest.approx(-1.0, abs=1e-10)
    assert all(check["passed"] for check in summary["verify"])


def test_the_history_has_a_row_per_newton_step(finished):
    summary = json.loads((finished / "case.out" / "summary.json").read_text())
    with open(finished / "case.out" / "history.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["number"]) for row in rows] == list(range(1, summary["newton_iterations"] + 1))
    assert float(rows[-1]["residual"]) < 1e-10


def test_a_second_run_is_up_to_date_and_touches_nothing(copy, capsys):
    before = {path.name: path.stat().st_mtime_ns for path in (copy / "case.out").iterdir() if path.name != "log.txt"}
    assert main([str(copy / "case.toml")]) == 0
    assert capsys.readouterr().err.count("up to date") == 3
    after = {path.name: path.stat().st_mtime_ns for path in (copy / "case.out").iterdir() if path.name != "log.txt"}
    assert before == after


def test_a_change_runs_only_the_stages_that_it_concerns(copy, capsys):
    assert main([edited(copy, "penalty = 1e5", "penalty = 1e6")]) == 5  # uz carries the overlap
    error = capsys.readouterr().err
    assert "geom2iga: up to date" in error
    assert "solve: converged" in error
    assert "uz" in error


def test_a_missed_check_ends_with_five_again_and_again(copy, capsys):
    case = edited(copy, "value = -2.01e-3", "value = -2.02e-3")
    assert main(["-q", case]) == 5
    assert main(["-q", case]) == 5
    assert "expected -0.00202" in capsys.readouterr().err


def test_a_lost_picture_is_drawn_again(copy):
    (copy / "case.out" / "stress.png").unlink()
    assert main(["-q", str(copy / "case.toml")]) == 0
    assert (copy / "case.out" / "stress.png").is_file()


def test_a_damaged_solution_is_made_again(copy):
    path = copy / "case.out" / "solution.h5"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert main(["-q", str(copy / "case.toml")]) == 0


def test_files_that_the_case_no_longer_asks_for_go_with_it(copy):
    path = copy / "case.toml"
    path.write_text(path.read_text().replace("[[verify]]", "[post]\npictures = false\n\n[[verify]]", 1))
    assert main(["-q", str(path)]) == 0
    assert {name.name for name in (copy / "case.out").glob("*.png")} == set()


def asked(folder, table):
    """Put a [post] table into the case."""
    path = folder / "case.toml"
    path.write_text(path.read_text().replace("[[verify]]", f"[post]\nreport = false\n{table}\n\n[[verify]]", 1))
    return str(path)


def points_of(folder):
    return meshio.read(folder / "case.out" / "bodies.vtu").points


def test_files_of_an_interrupted_run_are_not_taken_for_those_of_the_one_before(copy, monkeypatch):
    before = (copy / "case.toml").read_text()
    expected = points_of(copy)

    def stopped(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(sys.modules["post.export"], "_draw", stopped)
        assert main(["-q", asked(copy, "samples = 2")]) == 130
    assert len(points_of(copy)) < len(expected)
    (copy / "case.toml").write_text(before)
    assert main(["-q", str(copy / "case.toml")]) == 0
    np.testing.assert_array_equal(points_of(copy), expected)


def test_the_run_after_one_whose_pictures_were_interrupted_leaves_its_summary(tmp_path, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    shutil.copy(CASE, tmp_path / "case.toml")
    case = asked(tmp_path, "pictures = false")
    with monkeypatch.context() as patched:
        patched.setattr(sys.modules["post.export"], "write_data", stopped)
        assert main(["-q", case]) == 130
    assert main(["-q", case]) == 0
    assert json.loads((tmp_path / "case.out" / "summary.json").read_text())["status"] == "converged"


def test_files_of_a_failed_run_go_when_the_case_asks_for_them_no_more(copy, monkeypatch):
    before = (copy / "case.toml").read_text()
    with monkeypatch.context() as patched:
        patched.setattr("post.plots.usual.draw_bodies", lambda *_: 1 / 0)
        point = '[[post.point]]\nname = "p"\nat = [0.5, 0.5, 0.5]'
        assert main(["-q", asked(copy, point)]) == 1
    assert (copy / "case.out" / "point_p.csv").is_file()
    (copy / "case.toml").write_text(before)
    assert main(["-q", str(copy / "case.toml")]) == 0
    assert not (copy / "case.out" / "point_p.csv").exists()


def test_the_report_shows_the_case_as_it_stands_now(copy):
    path = copy / "case.toml"
    path.write_text(path.read_text() + "# a remark of mine\n")
    assert main(["-q", str(path)]) == 0
    assert "a remark of mine" in (copy / "case.out" / "report.html").read_text(encoding="utf-8")


def test_a_case_that_does_not_converge_leaves_no_summary_of_another(copy, capsys):
    case = edited(copy, "penalty = 1e5", 'penalty = 1.0\nenforcement = "augmented-lagrange"')
    path = copy / "case.toml"
    edited(copy, 'on = "upper/top"\npressure = 1.0', 'on = "upper/top"\ntraction = [0.0, 0.2, -1.0]')
    path.write_text(path.read_text() + "\n[solve.augmentation]\nmax_steps = 1\n")
    assert main(["-q", case]) == 4
    assert "max_steps" in capsys.readouterr().err
    summary = json.loads((copy / "case.out" / "summary.json").read_text())
    assert summary["status"] == "penetration"
    assert summary["files"] == ["history.csv"]
    left = {"geometry.h5", "history.csv", "log.txt", "solution.h5", "steps.h5", "summary.json"}
    assert {path.name for path in (copy / "case.out").iterdir()} == left


def test_a_dry_run_finds_a_wrong_name_in_verify(tmp_path, capsys):
    shutil.copy(CASE, tmp_path / "case.toml")
    assert main(["-n", edited(tmp_path, 'on = "upper/top"\nvalue', 'on = "upper/tap"\nvalue')]) == 2
    assert 'did you mean "upper/top"' in capsys.readouterr().err


def test_iga_post_alone_says_what_to_run_first_and_writes_nothing(tmp_path, capsys):
    from post.__main__ import main as iga_post

    shutil.copy(CASE, tmp_path / "case.toml")
    assert iga_post([str(tmp_path / "case.toml")]) == 2
    assert "run geom2iga first" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["case.toml"]


def test_a_full_disk_is_a_sentence(tmp_path, capsys, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device", "bodies.vtu")

    shutil.copy(CASE, tmp_path / "case.toml")
    monkeypatch.setattr(sys.modules["post.export"], "write_bodies", full)
    assert main(["-q", str(tmp_path / "case.toml")]) == 2
    assert capsys.readouterr().err.startswith("bodies.vtu: no space left")


def test_an_interruption_while_drawing_comes_after_the_picture():
    import signal

    from geom2iga.signals import uninterrupted

    done = []

    def draw():
        with uninterrupted():
            signal.raise_signal(signal.SIGINT)
            done.append("picture")

    with pytest.raises(KeyboardInterrupt):
        draw()
    assert done == ["picture"]


def test_json_goes_to_standard_output_and_talk_to_standard_error(copy, capsys):
    assert main(["--json", str(copy / "case.toml")]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["status"] == "converged"
    assert "up to date" in captured.err


def test_schema_is_json_and_covers_all_stages(capsys):
    assert main(["--schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert {"title", "geometry", "solve", "post", "verify"} <= set(schema["properties"])


def test_a_dry_run_writes_nothing(tmp_path, capsys):
    shutil.copy(CASE, tmp_path / "case.toml")
    assert main(["-n", str(tmp_path / "case.toml")]) == 0
    assert "unknowns" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["case.toml"]


@pytest.mark.parametrize(
    ("old", "new", "code", "named"),
    [
        ("poisson = 0.3", "poisson = 0.5", 2, "poisson"),
        ("young = 1000.0", "young = -1.0", 2, "young"),
        ("degree = 2", "degree = 0", 2, "geometry.degree"),
        ("size = [2.0, 2.0, 1.0]", "size = [2.0, 0.0, 1.0]", 2, "size[1]"),
        ("size = [2.0, 2.0, 1.0]", "size = [2.0, nan, 1.0]", 2, "size[1]"),
        ('on = "upper/top"', 'on = "uper/top"', 2, "upper/top"),
        ('primary = "lower/top"', 'primary = "upper/top"', 2, "upper"),
        ('on = "upper/left"\nnormal = 0.0', 'on = "upper/back"\nnormal = 0.0', 2, 'body "upper" can slide along x'),
        ("penalty = 1e5", "penalti = 1e5", 2, "penalty"),
        ("[[verify]]", "[[verifi]]", 2, "verify"),
        ("tolerance = 1e-10", 'tolerance = "small"', 2, "verify[0].tolerance"),
        ("[geometry]", "[geometry", 2, "TOML"),
    ],
)
def test_a_wrong_case_ends_with_one_sentence_and_its_exit_code(tmp_path, capsys, old, new, code, named):
    shutil.copy(CASE, tmp_path / "case.toml")
    assert main(["-q", edited(tmp_path, old, new)]) == code
    error = capsys.readouterr().err.strip()
    assert named in error
    assert error.count("\n") == 0
    assert "Traceback" not in error
    written = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert written <= {"case.toml", "geometry.h5", "log.txt"}


def test_objects_alone_make_a_sweep_without_files(tmp_path):
    case = geom2iga.read_case(CASE)
    for penalty in (1e4, 1e6):
        varied = case.changed(
            {"solve.contact.0.penalty": penalty, "post": {"pictures": False, "report": False}, "verify": []}
        )
        result = solve.solve(geom2iga.build(varied), varied)
        summary = post.export(result, varied, tmp_path / str(penalty))
        assert summary["contact"][0]["penalty"] == penalty
    assert {path.name for path in (tmp_path / "10000.0").iterdir()} == {
        "bodies.vtu",
        "bezier.vtu",
        "contact.vtu",
        "history.csv",
        "reactions.csv",
        "summary.json",
    }


def test_a_body_without_contact_is_exported_too(tmp_path):
    case = {
        "geometry": {"block": [{"name": "bar", "size": [1, 1, 4]}]},
        "solve": {
            "material": [{"young": 10.0, "poisson": 0.2}],
            "support": [{"on": "bar/bottom", "ux": 0.0, "uy": 0.0, "uz": 0.0}],
            "load": [{"on": "bar/top", "traction": [0.0, 0.0, 0.1]}],
        },
    }
    result = solve.solve(geom2iga.build(case), case)
    summary = post.export(result, case, tmp_path)
    assert summary["contact"] == []
    assert "contact.vtu" not in summary["files"]


def test_load_steps_have_a_table_and_a_picture(copy):
    factors = [0.25, 0.5, 1.0]
    path = edited(copy, "[[solve.contact]]", f"[solve.steps]\nfactors = {factors}\n\n[[solve.contact]]")
    assert main(["-q", path]) == 0
    folder = copy / "case.out"
    with open(folder / "load_steps.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["load_factor"]) for row in rows] == factors
    np.testing.assert_allclose([float(row["force_z"]) for row in rows], factors, rtol=1e-9)
    np.testing.assert_allclose([float(row["penetration"]) for row in rows], np.multiply(factors, 1e-5), rtol=1e-6)
    found = json.loads((folder / "summary.json").read_text())
    assert [step["load_factor"] for step in found["load_steps"]] == factors
    assert {"load_steps.csv", "load_steps.png"} <= set(found["files"])
    assert not (folder / "steps.h5").exists()


def test_commands_begin_without_what_only_pictures_need():
    needed = {"pyvista", "matplotlib", "vtkmodules", "tomlkit"}
    code = f"import sys, post.pipeline; print(sorted({needed} & set(sys.modules)))"
    command = [sys.executable, "-c", code]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip() == "[]"
