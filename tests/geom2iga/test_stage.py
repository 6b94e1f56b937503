import json
import os
import subprocess
import sys
from pathlib import Path

import gmsh
import h5py
import pytest

import geom2iga
from geom2iga import __main__ as command
from geom2iga.__main__ import main
from geom2iga.case import GeometryCase
from geom2iga.errors import CaseError, GeometryError, NotConvergedError, VerificationError
from geom2iga.files import VERSION, read_model
from geom2iga.stage import Stage, fingerprint, run_command
from geom2iga.tables import TABLES
from tests.oracles import assert_same_model

pytestmark = pytest.mark.usefixtures("quiet_log")

ROOT = Path(__file__).parents[2]
CASE = """
title = "A cube"

[geometry]
degree = 2

[[geometry.block]]
name = "cube"
size = [1, 2, 3]
spans = [2, 1, 4]
"""


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "cube.toml"
    path.write_text(CASE)
    return path


def edit(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def run_fake(case, *flags, raising=None, plan=None):
    """Run a command of one stage that does nothing, or raises."""

    def run(*_):
        if raising is not None:
            raise raising

    stage = Stage(
        "fake", GeometryCase, lambda *_: "inputs", lambda _: None, plan or (lambda _: ""), run, lambda _: {"found": 1}
    )
    return run_command("A fake.", [stage], [str(case), *flags])


def run_alone(*arguments, folder):
    """Run the command in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "geom2iga", *map(str, arguments)],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
    )


def test_the_command_writes_the_model_beside_the_case(case):
    assert main(["-q", str(case)]) == 0
    folder = case.parent / "cube.out"
    assert sorted(path.name for path in folder.iterdir()) == ["geometry.h5", "log.txt"]
    patch = read_model(folder / "geometry.h5").patches["cube"]
    assert (patch.degrees, patch.shape) == ((2, 2, 2), (4, 3, 6))


def test_the_output_folder_can_be_chosen_and_is_made(case, tmp_path):
    for flag in ("-o", "--output"):
        folder = tmp_path / "deep" / flag.strip("-")
        assert main(["-q", str(case), flag, str(folder)]) == 0
        assert (folder / "geometry.h5").is_file()
    assert not (tmp_path / "cube.out").exists()


def test_the_file_holds_the_model_that_python_builds(case):
    assert main(["-q", str(case)]) == 0
    assert_same_model(read_model(case.parent / "cube.out" / "geometry.h5"), command.build(case))


def test_talk_goes_to_standard_error_and_says_what_was_made(case, capsys):
    assert main([str(case)]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert "cube: degree 2, 2 x 1 x 4 spans; exact" in err


def test_quiet_prints_nothing(case, capsys):
    assert main(["-q", str(case)]) == 0
    assert capsys.readouterr() == ("", "")


def test_verbose_prints_more(case, capsys):
    assert main([str(case)]) == 0
    usual = capsys.readouterr().err
    assert main([str(case), "-v", "-f"]) == 0
    assert len(capsys.readouterr().err.splitlines()) > len(usual.splitlines())


def test_everything_said_is_in_the_log_too_run_after_run(case):
    for flag in ("-q", "-v"):
        assert main([flag, "-f", str(case)]) == 0
    text = (case.parent / "cube.out" / "log.txt").read_text()
    assert text.count("cube: degree 2") == 2


def test_json_puts_only_the_summary_on_standard_output(case, capsys):
    for _ in range(2):  # made, then up to date
        assert main([str(case), "--json"]) == 0
        summary = json.loads(capsys.readouterr().out)
        assert summary["status"] == "done"
        cube = summary["patches"]["cube"]
        assert (cube["degrees"], cube["spans"], cube["control_points"]) == ([2, 2, 2], [2, 1, 4], 4 * 3 * 6)
        assert (cube["way"], cube["jacobian"], cube["volume"]) == ("exact", "proven", pytest.approx(6.0, rel=1e-12))
        assert summary["bodies"] == {"cube": ["cube"]}
        assert "cube/top" in summary["faces"]


def test_a_dry_run_says_what_would_be_done_and_writes_nothing(case, capsys):
    assert main([str(case), "-n"]) == 0
    assert "2 x 1 x 4 spans" in capsys.readouterr().err
    assert list(case.parent.iterdir()) == [case]


def test_a_dry_run_finds_geometry_that_cannot_be_built(case):
    edit(case, "size = [1, 2, 3]", "size = [1, 2, 3]\norigin = [1e12, 0, 0]")
    assert main(["-n", "-q", str(case)]) == 3
    assert list(case.parent.iterdir()) == [case]


def test_the_schema_is_json_and_names_every_key(capsys):
    assert main(["--schema"]) == 0
    text = capsys.readouterr().out
    assert set(json.loads(text)["properties"]) == set(TABLES)  # those of later stages may hold anything
    assert all(f'"{key}"' in text for key in ("degree", "block", "cad", "spans", "breaks", "knots", "rotate", "angle"))


def test_help_shows_an_example_and_every_flag(capsys):
    with pytest.raises(SystemExit) as end:
        main(["-h"])
    assert end.value.code == 0
    text = capsys.readouterr().out
    flags = ("-o", "--dry-run", "--force", "-q", "-v", "--json", "--new", "--schema", "--print-completion", "--version")
    assert all(flag in text for flag in flags)
    groups = ("what to do", "what to say", "instead of running a case", "exit codes")
    assert all(f"{group}:" in text for group in groups)
    examples = text.partition("examples:")[2].partition("\n\n")[0].split("\n")
    assert [line.split()[0] for line in examples if line] == ["geom2iga", "geom2iga"]


def test_the_version_is_that_of_the_project(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out.split()[0] == "geom2iga"


def made(folder):
    """When geometry.h5 was made; a new file has a new one."""
    status = (folder / "geometry.h5").stat()
    return status.st_mtime_ns, status.st_ino


def test_what_is_up_to_date_is_not_made_again(case, capsys):
    folder = case.parent / "cube.out"
    assert main([str(case)]) == 0
    before = made(folder)
    capsys.readouterr()
    assert main([str(case)]) == 0
    assert "up to date" in capsys.readouterr().err
    assert made(folder) == before


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("degree = 2", "degree = 2 # quadratic"),
        ('"A cube"', '"Another cube"'),
        ("[geometry]", "[solve]\nanything = 1\n[geometry]"),
    ],
)
def test_a_change_that_does_not_concern_the_geometry_keeps_it(case, old, new):
    assert main(["-q", str(case)]) == 0
    before = made(case.parent / "cube.out")
    edit(case, old, new)
    assert main(["-q", str(case)]) == 0
    assert made(case.parent / "cube.out") == before


def test_a_changed_geometry_is_made_anew(case, capsys):
    folder = case.parent / "cube.out"
    assert main(["-q", str(case)]) == 0
    edit(case, "degree = 2", "degree = 3")
    assert main([str(case)]) == 0
    assert "up to date" not in capsys.readouterr().err
    assert read_model(folder / "geometry.h5").patches["cube"].degrees == (3, 3, 3)


def test_force_makes_anew_what_is_up_to_date(case):
    assert main(["-q", str(case)]) == 0
    before = made(case.parent / "cube.out")
    assert main(["-q", "--force", str(case)]) == 0
    assert made(case.parent / "cube.out") != before


def test_a_damaged_or_outdated_file_is_made_anew(case):
    path = case.parent / "cube.out" / "geometry.h5"
    assert main(["-q", str(case)]) == 0
    whole = read_model(path)
    with h5py.File(path, "a") as file:
        file.attrs["version"] = VERSION + 1
    assert main(["-q", str(case)]) == 0
    assert_same_model(read_model(path), whole)
    path.write_bytes(path.read_bytes()[:-100])
    assert main(["-q", str(case)]) == 0
    assert_same_model(read_model(path), whole)


def write_box(path, size):
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addBox(0, 0, 0, *size)
    gmsh.model.occ.synchronize()
    gmsh.write(str(path))
    gmsh.finalize()


def test_a_changed_cad_file_is_read_again(tmp_path):
    case = tmp_path / "case.toml"
    case.write_text('[[geometry.cad]]\nname = "punch"\nfile = "punch.step"\n')
    for height in (1.0, 2.0):
        write_box(tmp_path / "punch.step", (1, 1, height))
        assert main(["-q", str(case)]) == 0
        points = read_model(tmp_path / "case.out" / "geometry.h5").patches["punch"].control_points
        assert points[..., 2].max() == pytest.approx(height, rel=1e-14)
        before = made(tmp_path / "case.out")
        assert main(["-q", str(case)]) == 0
        assert made(tmp_path / "case.out") == before


def test_a_cad_file_that_vanished_is_missed_though_its_patches_are_there(tmp_path, capsys):
    case = tmp_path / "case.toml"
    case.write_text('[[geometry.cad]]\nname = "punch"\nfile = "punch.step"\n')
    write_box(tmp_path / "punch.step", (1, 1, 1))
    assert main(["-q", str(case)]) == 0
    (tmp_path / "punch.step").unlink()
    assert main(["-q", str(case)]) == 2
    assert "punch.step" in capsys.readouterr().err
    read_model(tmp_path / "case.out" / "geometry.h5")  # what was there still is


def test_a_cad_file_that_changes_while_it_is_read_is_not_believed(tmp_path, capsys, monkeypatch):
    case = tmp_path / "case.toml"
    case.write_text('[[geometry.cad]]\nname = "punch"\nfile = "punch.step"\n')
    write_box(tmp_path / "punch.step", (1, 1, 1))

    def build(case):
        write_box(tmp_path / "punch.step", (1, 1, 2))
        return geom2iga.build(case)

    monkeypatch.setattr(command, "build", build)
    assert main([str(case)]) == 2
    assert "changed while it was read" in capsys.readouterr().err
    assert not (tmp_path / "case.out" / "geometry.h5").exists()


def test_a_wrong_case_ends_with_two_and_names_the_key(case, capsys):
    edit(case, "size = [1, 2, 3]", "size = [1, 2, -3]")
    assert main([str(case)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "cube" in err
    assert "geometry.block[0].size[2] = -3" in err
    assert "Traceback" not in err
    assert list(case.parent.iterdir()) == [case]


@pytest.mark.parametrize("arguments", [[], ["nowhere.toml"], ["."], ["--nonsense"], ["case.toml", "another.toml"]])
def test_a_wrong_command_ends_with_two(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    try:
        code = main(arguments)
    except SystemExit as end:
        code = end.code
    assert code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_an_output_folder_that_is_a_file_ends_with_two_and_advice(case, tmp_path, capsys):
    (tmp_path / "taken").write_text("")
    assert main([str(case), "-o", str(tmp_path / "taken")]) == 2
    err = capsys.readouterr().err
    assert "taken: a file, not a folder" in err
    assert "-o" in err


def test_geometry_that_is_no_block_ends_with_three(tmp_path, capsys):
    case = tmp_path / "case.toml"
    case.write_text('[[geometry.cad]]\nname = "punch"\nfile = "punch.step"\n')
    (tmp_path / "punch.step").write_text("hello\n")
    assert main([str(case)]) == 3
    assert "punch.step" in capsys.readouterr().err
    assert not (tmp_path / "case.out" / "geometry.h5").exists()


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (CaseError("the thing is wrong"), 2),
        (GeometryError("the thing is wrong"), 3),
        (NotConvergedError("the thing is wrong"), 4),
        (VerificationError("the thing is wrong"), 5),
    ],
)
def test_each_kind_of_error_has_its_exit_code_and_no_traceback(case, capsys, error, code):
    assert run_fake(case, raising=error) == code
    assert capsys.readouterr().err.splitlines() == ["the thing is wrong"]
    assert "the thing is wrong" in (case.parent / "cube.out" / "log.txt").read_text()


def test_errors_are_printed_though_all_else_is_quiet(case, capsys):
    assert run_fake(case, "-q", raising=NotConvergedError("the thing is wrong")) == 4
    assert "the thing is wrong" in capsys.readouterr().err


def test_a_missed_verification_still_has_its_summary(case, capsys):
    assert run_fake(case, "--json", raising=VerificationError("missed")) == 5
    assert json.loads(capsys.readouterr().out) == {"found": 1}
    assert run_fake(case, "--json", raising=NotConvergedError("lost")) == 4
    assert capsys.readouterr().out == ""


def test_a_bug_of_ours_ends_with_one_and_leaves_its_traceback_in_the_log(case, capsys):
    assert run_fake(case, raising=ZeroDivisionError("by nought")) == 1
    err = capsys.readouterr().err
    log_file = case.parent / "cube.out" / "log.txt"
    assert "ZeroDivisionError: by nought" in err
    assert "bug" in err
    assert str(log_file) in err
    assert "Traceback" not in err
    assert "Traceback" in log_file.read_text()


def test_a_bug_of_ours_in_a_dry_run_does_not_point_to_a_log_that_is_not_there(case, capsys):
    assert run_fake(case, "-n", plan=lambda _: 1 / 0) == 1
    err = capsys.readouterr().err
    assert "-v" in err
    assert "log.txt" not in err
    assert run_fake(case, "-n", "-v", plan=lambda _: 1 / 0) == 1
    assert "Traceback" in capsys.readouterr().err


def test_an_interrupt_ends_with_130(case, capsys):
    assert run_fake(case, raising=KeyboardInterrupt()) == 130
    assert "interrupted" in capsys.readouterr().err


def test_a_fingerprint_tells_inputs_apart_and_not_the_sequence_of_keys():
    assert fingerprint({"a": 1, "b": 2}) == fingerprint({"b": 2, "a": 1})
    different = [fingerprint(*parts) for parts in ((1,), (2,), (1, 2), ([1, 2],), ("1",), (1.5,), (None,), ())]
    assert len(set(different)) == len(different)


def test_the_module_runs_as_a_command_with_nothing_but_data_on_standard_output(case):
    write_box(case.parent / "punch.step", (1, 1, 1))
    edit(case, "[[geometry.block]]", '[[geometry.cad]]\nname = "punch"\nfile = "punch.step"\n\n[[geometry.block]]')
    ended = run_alone("cube.toml", "--json", folder=case.parent)
    assert ended.returncode == 0
    assert set(json.loads(ended.stdout)["patches"]) == {"cube", "punch"}
    assert "2 bodies" in ended.stderr


def test_a_failing_command_ends_its_process_with_the_code(case):
    edit(case, "size = [1, 2, 3]", "size = [1, 2, 3]\norigin = [1e12, 0, 0]")
    ended = run_alone("cube.toml", folder=case.parent)
    assert ended.returncode == 3
    assert ended.stdout == ""
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize("name", ["summary.json", "geometry.h5"])
@pytest.mark.parametrize("flags", [(), ("--force",)])
@pytest.mark.parametrize("text", ['{"mine": 1}', "mine", "[" * 10_000])
def test_a_file_of_somebody_else_that_has_the_name_of_ours_is_refused_and_stays(case, capsys, name, flags, text):
    folder = case.parent / "cube.out"
    folder.mkdir()
    (folder / name).write_text(text)
    assert main(["-q", str(case), *flags]) == 2
    assert f"{folder / name}: not written by this program" in capsys.readouterr().err
    assert (folder / name).read_text() == text


def test_pictures_and_exports_go_with_the_geometry_that_they_show_and_others_stay(case):
    folder = case.parent / "cube.out"
    folder.mkdir()
    (folder / "geometry.mesh").write_text("mine")
    assert main(["-q", str(case)]) == 0
    assert (folder / "geometry.mesh").read_text() == "mine"
    assert main(["-q", str(case), "--export", "mfem"]) == 0
    assert (folder / "geometry.mesh").read_text() != "mine"
    edit(case, "degree = 2", "degree = 3")
    assert main(["-q", str(case)]) == 0
    assert not (folder / "geometry.mesh").exists()


def test_an_empty_name_is_not_the_current_folder(case, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for flag in ("-o", "--new"):
        with pytest.raises(SystemExit) as end:
            main([str(case), flag, ""])
        assert end.value.code == 2
        assert "empty, name a folder" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [case]


def test_a_link_that_leads_nowhere_is_no_output_folder(case, capsys):
    (case.parent / "away").symlink_to("nowhere")
    assert main([str(case), "-o", str(case.parent / "away")]) == 2
    assert "away: a link that leads nowhere" in capsys.readouterr().err
    assert not (case.parent / "nowhere").exists()


def test_the_plan_is_data_where_json_is_asked_for(case, capsys):
    assert run_fake(case, "-n", "--json", plan=lambda _: "two\nlines") == 0
    out, err = capsys.readouterr()
    assert json.loads(out) == {"fake": "two\nlines"}
    assert "two" in err


@pytest.mark.parametrize("flags", [("cube.toml", "--json"), ("--schema",), ("--print-completion", "bash")])
def test_standard_output_on_a_full_disk_is_a_sentence(case, flags):
    command = f'"{sys.executable}" -m geom2iga -q {" ".join(flags)} >/dev/full'
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    ended = subprocess.run(["bash", "-c", command], cwd=case.parent, env=environment, capture_output=True, text=True)
    assert ended.returncode == 2
    assert ended.stderr == "standard output: no space left on device; no file was half written\n"
