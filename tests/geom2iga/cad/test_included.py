import pytest

from geom2iga.__main__ import stamp
from geom2iga.cad.script import check_script, with_included
from geom2iga.errors import GeometryError
from geom2iga.tables import Case

CASE = {"geometry": {"cad": [{"name": "box", "file": "box.geo"}]}}


def test_a_change_of_an_included_script_is_a_change_of_the_inputs(tmp_path):
    (tmp_path / "box.geo").write_text('Include "parts/size.geo";\n')
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "size.geo").write_text('Merge "shape.brep";\n')
    stamps = []
    for text in ("one", "two", "two"):
        (tmp_path / "parts" / "shape.brep").write_text(text)
        stamps.append(stamp(Case(CASE, tmp_path), tmp_path))
    assert stamps[0] != stamps[1] == stamps[2]


def test_a_script_that_includes_many_that_include_each_other_is_looked_at_once(tmp_path):
    """Along every way there would be 40 factorial."""
    for number in range(40):
        text = "".join(f'Include "part{other}.geo";\n' for other in range(40))
        (tmp_path / f"part{number}.geo").write_text(text)
    with pytest.raises(GeometryError, match=r'part\d+\.geo": it includes itself'):
        check_script(tmp_path / "part0.geo")
    assert len(with_included(tmp_path / "part0.geo")) == 40


def test_a_chain_of_included_scripts_may_be_as_long_as_it_likes(tmp_path):
    for number in range(1200):
        (tmp_path / f"part{number}.geo").write_text(f'Include "part{number + 1}.geo";\n')
    with pytest.raises(GeometryError, match=r"part1200\.geo.*not there"):
        check_script(tmp_path / "part0.geo")


@pytest.mark.parametrize("text", ['Include "box.geo";\n', 'Merge "part.txt";\n'])
def test_a_script_that_includes_itself_is_told_so(tmp_path, text):
    (tmp_path / "box.geo").write_text(text)
    (tmp_path / "part.txt").write_text('Include "./box.geo";\n')
    with pytest.raises(GeometryError, match="includes itself"):
        check_script(tmp_path / "box.geo")


@pytest.mark.parametrize(
    ("text", "looked"),
    [
        ('Merge "part.step";\n', False),
        ('Include "part.step";\n', True),
        ('Merge "part.step";\nInclude "part.step";\n', True),
        ('Merge "part.Step";\n', True),  # which gmsh takes for a script
        ('Merge "part.txt";\n', True),
    ],
)
def test_models_are_inputs_that_are_not_looked_at_scripts_are_whatever_their_names(tmp_path, text, looked):
    (tmp_path / "box.geo").write_text(text)
    part = tmp_path / text.split('"')[1]
    part.write_text('SystemCall "ls";\n')
    assert with_included(tmp_path / "box.geo") == [tmp_path / "box.geo", part]
    if looked:
        with pytest.raises(GeometryError, match="runs a command"):
            check_script(tmp_path / "box.geo")
    else:
        check_script(tmp_path / "box.geo")


@pytest.mark.parametrize("name", ["folder", "loop", "nul\0l", "x" * 5000])
def test_what_is_no_file_cannot_be_included(tmp_path, name):
    (tmp_path / "folder").mkdir()
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "box.geo").write_text(f'Include "{name}";\n')
    with pytest.raises(GeometryError, match="not there"):
        check_script(tmp_path / "box.geo")
