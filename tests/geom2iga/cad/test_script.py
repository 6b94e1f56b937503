import pytest

from geom2iga import build
from geom2iga.cad.script import check_script
from geom2iga.errors import GeometryError

RUNS = 'SystemCall "touch ran";\n'
BOX = 'SetFactory("OpenCASCADE");\nBox(1) = {0, 0, 0, 1, 1, 1};\n'


def case_of(path, **keys):
    return {"geometry": {"cad": [{"name": "box", "file": path, **keys}]}}


@pytest.mark.parametrize(
    "script",
    [
        RUNS,
        BOX + "// harmless\n" + RUNS,
        'NonBlockingSystemCall "touch ran";\n',
        'OnelabRun("client", "touch ran");\n',
        'If(1) SystemCall StrCat("touch ", "ran"); EndIf\n',
        'System "touch ran";\n',
        'System/* */"touch ran";\n',
        'Field[1] = ExternalProcess;\nField[1].CommandLine = "touch ran";\n',
    ],
)
def test_a_script_that_runs_a_command_is_refused(tmp_path, monkeypatch, script):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "box.geo").write_text(script)
    with pytest.raises(GeometryError, match=r"box\.geo.*line \d: \w+ runs a command.*trusted = true"):
        build(case_of("box.geo"))
    assert not (tmp_path / "ran").exists()


def test_a_trusted_script_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "box.geo").write_text(RUNS + BOX)
    assert list(build(case_of("box.geo", trusted=True)).bodies) == ["box"]
    assert (tmp_path / "ran").exists()


@pytest.mark.parametrize("include", ["Include", "Merge", "MergeWithBoundingBox"])
def test_a_script_that_includes_one_that_runs_a_command_is_refused(tmp_path, include):
    (tmp_path / "parts").mkdir()
    (tmp_path / "box.geo").write_text(f'{include} "parts/shape.geo";\n' + BOX)
    (tmp_path / "parts" / "shape.geo").write_text('Include "deep.geo";\n')
    (tmp_path / "parts" / "deep.geo").write_text("\n" + RUNS)
    with pytest.raises(GeometryError, match=r"deep\.geo.*line 2: SystemCall"):
        check_script(tmp_path / "box.geo")


@pytest.mark.parametrize("include", ["Include", "Merge", "MergeWithBoundingBox"])
def test_a_script_that_makes_up_what_it_includes_is_refused(tmp_path, include):
    (tmp_path / "box.geo").write_text(f'{include} StrCat("sha", "pe.geo");\n')
    with pytest.raises(GeometryError, match=r"a name that the script makes up.*trusted = true"):
        check_script(tmp_path / "box.geo")


@pytest.mark.parametrize(
    "line",
    [
        'Printf("a") > "trace";',
        'Printf("a") > StrCat("tr", "ace");',
        'Printf("%g", 1) >> "trace";',
        'Save "trace.brep";',
        'Print "trace.png";',
        'Point(9) = {0, 0, 0}; Save "trace.brep";',
        'a = 1; Print "trace.msh";',
        'Printf("a; b") > "trace";',
        'Printf("a") /* to */ > "trace";',
        'General.LogFileName = "trace";',
        'CreateDir "trace";',
    ],
)
def test_a_script_that_writes_a_file_is_refused(tmp_path, line):
    (tmp_path / "box.geo").write_text(BOX + line + "\n")
    with pytest.raises(GeometryError, match=r"line 3: it writes a file.*trusted = true"):
        check_script(tmp_path / "box.geo")


@pytest.mark.parametrize(
    "text",
    [
        BOX,
        BOX + 'Printf("volume %g", 1);\n',
        "a = 3; If (a > 2) Point(1) = {0, 0, 0}; EndIf\n",
        "For k In {1:3}\nBox(k) = {k, 0, 0, 1, 1, 1};\nEndFor\n",
        "x() = {1, 2};\nIf (#x() > 1)\nPoint(1) = {0, 0, 0};\nEndIf\n",
        "If (Sqrt(4) > 1) Point(1) = {0, 0, 0}; EndIf\n",
    ],
)
def test_a_harmless_script_is_let_through(tmp_path, text):
    (tmp_path / "box.geo").write_text(text)
    check_script(tmp_path / "box.geo")


def test_scripts_that_include_each_other_are_looked_at_once_and_refused(tmp_path):
    for name, other in (("a", "b"), ("b", "a")):
        (tmp_path / f"{name}.geo").write_text(f'Include "{other}.geo";\n')
    with pytest.raises(GeometryError, match=r'[ab]\.geo": it includes itself'):
        check_script(tmp_path / "a.geo")


def test_a_script_that_includes_a_file_that_is_not_there_is_refused(tmp_path):
    """It could make it first."""
    (tmp_path / "box.geo").write_text('Include "nowhere.geo";\n')
    with pytest.raises(GeometryError, match=r"nowhere\.geo.*not there"):
        check_script(tmp_path / "box.geo")
