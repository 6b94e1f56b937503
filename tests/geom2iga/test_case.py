import copy
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from geom2iga import bspline
from geom2iga.case import Block, GeometryCase
from geom2iga.errors import CaseError, suggestion
from geom2iga.tables import TABLES, Case, as_case, checked, read_case
from tests.strategies import graded_breaks, open_knot_vectors

BLOCK = {"name": "cube", "size": [1, 2, 3]}
LINE = [0, 0, 1, 1]


def case_of(**changes):
    """A case of one block, with changed keys of that block; those that are None are left out."""
    return {"geometry": {"block": [{k: v for k, v in (BLOCK | changes).items() if v is not None}]}}


def message(case):
    """What a user reads about a wrong case."""
    with pytest.raises(CaseError) as error:
        checked(case, GeometryCase)
    assert "pydantic" not in str(error.value)
    assert error.value.exit_code == 2
    return str(error.value)


def names_of(case):
    """Names of the bodies of a case, in their sequence."""
    return [table.name for _, table in checked(case, GeometryCase).geometry.tables]


@pytest.mark.parametrize(
    ("changes", "key", "found"),
    [
        ({"degree": 0}, "geometry.block[0].degree", "0"),
        ({"degree": -1}, "geometry.block[0].degree", "-1"),
        ({"degree": 1.5}, "geometry.block[0].degree", "1.5"),
        ({"degree": True}, "geometry.block[0].degree", "True"),
        ({"degree": "2"}, "geometry.block[0].degree", "'2'"),
        ({"degree": nan}, "geometry.block[0].degree", "nan"),
        ({"degree": [1, 0, 2]}, "geometry.block[0].degree[1]", "0"),
        ({"degree": [1, 2, 2.5]}, "geometry.block[0].degree[2]", "2.5"),
        ({"degree": [True, 2, 2]}, "geometry.block[0].degree[0]", "True"),
        ({"degree": [1, 2]}, "geometry.block[0].degree[2]", "missing"),
        ({"degree": [1, 2, 3, 4]}, "geometry.block[0].degree", "3"),
        ({"size": [1, 1, nan]}, "geometry.block[0].size[2]", "nan"),
        ({"size": [1, inf, 1]}, "geometry.block[0].size[1]", "inf"),
        ({"size": [0, 1, 1]}, "geometry.block[0].size[0]", "0"),
        ({"size": [1, -2.5, 1]}, "geometry.block[0].size[1]", "-2.5"),
        ({"size": [1, 1, True]}, "geometry.block[0].size[2]", "True"),
        ({"size": [1, "1", 1]}, "geometry.block[0].size[1]", "'1'"),
        ({"size": 1}, "geometry.block[0].size", "1"),
        ({"size": [1, 1]}, "geometry.block[0].size[2]", "missing"),
        ({"size": None}, "geometry.block[0].size", "missing"),
        ({"origin": [0, nan, 0]}, "geometry.block[0].origin[1]", "nan"),
        ({"spans": [2, 2, 0]}, "geometry.block[0].spans[2]", "0"),
        ({"spans": [2, 2.5, 2]}, "geometry.block[0].spans[1]", "2.5"),
        ({"spans": 4.5}, "geometry.block[0].spans", "4.5"),
        ({"breaks": [[0, 1], [0, 0.5, 0.5, 1], [0, 1]]}, "geometry.block[0].breaks[1]", "0.5, 0.5"),
        ({"breaks": [[0, 0.7, 0.2, 1], [0, 1], [0, 1]]}, "geometry.block[0].breaks[0]", "0.7"),
        ({"breaks": [[0, 1], [0, 1], [0, 0.5]]}, "geometry.block[0].breaks[2]", "0.5"),
        ({"breaks": [[0.1, 1], [0, 1], [0, 1]]}, "geometry.block[0].breaks[0]", "0.1"),
        ({"breaks": [[0, 1], [0, 1], []]}, "geometry.block[0].breaks[2]", "[]"),
        ({"breaks": [[0, 1], [0, nan, 1], [0, 1]]}, "geometry.block[0].breaks[1][1]", "nan"),
        ({"knots": [LINE, [0, 0.2, 0.8, 1], LINE]}, "geometry.block[0].knots[1]", "open"),
        ({"knots": [LINE, LINE, [0, 0, 0.7, 0.2, 1, 1]]}, "geometry.block[0].knots[2]", "0.7"),
        ({"knots": [[0, 0, 0.25, 0.25, 1, 1], LINE, LINE]}, "geometry.block[0].knots[0]", "0.25"),
        ({"degree": 2, "knots": [LINE] * 3}, "geometry.block[0].knots[0]", "6"),
        ({"knots": [LINE, LINE]}, "geometry.block[0].knots[2]", "missing"),
        ({"knots": [LINE, LINE, [0, 0, inf, inf]]}, "geometry.block[0].knots[2][2]", "inf"),
        ({"name": ""}, "geometry.block[0].name", '""'),
        ({"name": "a/b"}, "geometry.block[0].name", "a/b"),
        ({"name": "a b"}, "geometry.block[0].name", "a b"),
        ({"name": "-a"}, "geometry.block[0].name", "-a"),
        ({"name": "a\n"}, "geometry.block[0].name", "a"),
        ({"name": 7}, "geometry.block[0].name", "7"),
        ({"name": None}, "geometry.block[0].name", "missing"),
        ({"rotate": {"axis": [0, 0, 0], "angle": 1}}, "geometry.block[0].rotate", "direction"),
        ({"rotate": {"axis": [0, 0, 1]}}, "geometry.block[0].rotate.angle", "missing"),
        ({"rotate": {"angle": nan}}, "geometry.block[0].rotate.angle", "nan"),
        ({"rotate": {"angle": "90"}}, "geometry.block[0].rotate.angle", "'90'"),
        ({"rotate": {"angle": 1, "about": [0, 0]}}, "geometry.block[0].rotate.about[2]", "missing"),
        ({"rotate": 90}, "geometry.block[0].rotate", "90"),
    ],
)
def test_a_wrong_value_is_reported_with_its_full_key(changes, key, found):
    text = message(case_of(**changes))
    assert key in text
    assert found in text.partition(key)[2]


@pytest.mark.parametrize(
    ("changes", "wrong", "table", "right"),
    [
        ({"sise": [1, 1, 1]}, "sise", "geometry.block[0]", "size"),
        ({"span": [1, 1, 1]}, "span", "geometry.block[0]", "spans"),
        ({"rotate": {"angle": 1, "axes": [0, 0, 1]}}, "axes", "geometry.block[0].rotate", "axis"),
    ],
)
def test_an_unknown_key_gets_the_nearest_known_one(changes, wrong, table, right):
    text = message(case_of(**changes))
    assert f'"{wrong}" in [{table}]' in text
    assert f'did you mean "{right}"' in text


def test_an_unknown_key_of_the_geometry_table_gets_the_nearest_known_one():
    text = message({"geometry": {"blocks": [BLOCK]}})
    assert '"blocks" in [geometry]' in text
    assert 'did you mean "block"' in text


def test_a_wrong_second_block_is_called_by_its_number():
    second = BLOCK | {"name": "other", "size": [1, 1, -1]}
    assert "geometry.block[1].size[2] = -1" in message({"geometry": {"block": [BLOCK, second]}})


@pytest.mark.parametrize(("key", "value"), [("knots", [LINE] * 3), ("breaks", [[0, 1]] * 3)])
def test_only_blocks_take_knots_and_breaks(key, value):
    body = {"name": "punch", "file": "punch.step", key: value}
    text = message({"geometry": {"cad": [body]}})
    assert f'unknown key "{key}" in [geometry.cad[0]]' in text
    assert "span_size" in text


def test_knots_must_fit_the_common_degree_too():
    case = case_of(knots=[LINE] * 3)
    checked(case, GeometryCase)
    case["geometry"]["degree"] = 2
    assert "geometry.block[0].knots[0]" in message(case)


@pytest.mark.parametrize("pair", [("spans", "breaks"), ("spans", "knots"), ("breaks", "knots")])
def test_a_mesh_is_given_in_one_way_only(pair):
    ways = {"spans": [1, 1, 1], "breaks": [[0, 1]] * 3, "knots": [LINE] * 3}
    text = message(case_of(**{way: ways[way] for way in pair}))
    assert "geometry.block[0]" in text
    assert f"{pair[0]} and {pair[1]}" in text


def test_two_bodies_must_not_share_a_name():
    cad = {"name": "cube", "file": "cube.step"}
    parts = {"file": "cube.step", "bodies": [{"name": "cube", "tags": [1]}]}
    imported, ball = {"name": "cube", "file": "cube.xml"}, {"name": "cube", "radius": 1.0}
    for geometry in (
        {"block": [BLOCK, BLOCK]},
        {"block": [BLOCK], "cad": [cad]},
        {"block": [BLOCK], "cad": [parts]},
        {"cad": [parts, parts]},
        {"block": [BLOCK], "import": [imported]},
        {"block": [BLOCK], "sphere": [ball]},
    ):
        text = message({"geometry": geometry})
        assert "geometry" in text
        assert '"cube"' in text


@pytest.mark.parametrize("geometry", [{}, {"block": []}, {"degree": 2}])
def test_a_case_without_a_body_is_told_how_to_add_one(geometry):
    text = message({"geometry": geometry})
    assert "geometry" in text
    assert "[[geometry.block]]" in text


@pytest.mark.parametrize("case", [{}, {"title": "nothing"}])
def test_a_case_without_geometry_is_told_so(case):
    assert "geometry is missing" in message(case)


@pytest.mark.parametrize("geometry", [[BLOCK], "cube", 3])
def test_geometry_that_is_no_table_is_told_so(geometry):
    text = message({"geometry": geometry})
    assert "geometry" in text
    assert "table" in text


def test_every_path_to_a_case_refuses_an_unknown_table(tmp_path):
    """A sweep over a misspelt key would else change nothing."""
    path = tmp_path / "case.toml"
    path.write_text("[sovle]\n")
    good = as_case(case_of())
    for attempt in (
        lambda: read_case(path),
        lambda: as_case({"sovle": {}}),
        lambda: Case({"sovle": {}}),
        lambda: good.changed({"sovle.material": []}),
        lambda: checked(case_of() | {"sovle": {}}, GeometryCase),
    ):
        with pytest.raises(CaseError, match=r'"sovle".*did you mean "solve"'):
            attempt()


def test_the_tables_of_later_stages_are_left_to_them():
    checked(case_of() | {table: "unchecked" for table in ("solve", "post", "verify")}, GeometryCase)


@pytest.mark.parametrize("content", [b"[geometry", b"degree = ", b"\xff\xfe\x00", b"a = 1\na = 2\n", b'a = "\x01"'])
def test_a_file_that_is_no_toml_is_named(tmp_path, content):
    path = tmp_path / "wrong.toml"
    path.write_bytes(content)
    with pytest.raises(CaseError, match=r"wrong\.toml.*TOML"):
        read_case(path)


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    for path in (tmp_path / "nowhere.toml", tmp_path):
        with pytest.raises(CaseError, match=path.name):
            read_case(path)


def test_a_case_file_knows_its_folder_and_name(tmp_path):
    path = tmp_path / "patch test.toml"
    path.write_text('title = "Stößel"\n', encoding="utf-8")
    for case in (read_case(path), read_case(str(path)), as_case(path)):
        assert (case.folder, case.name, case.tables) == (tmp_path, "patch test.toml", {"title": "Stößel"})


def test_one_number_stands_for_three():
    geometry = checked(case_of(spans=4, degree=2), GeometryCase).geometry
    assert geometry.block[0].spans == (4, 4, 4)
    assert geometry.block[0].degree == (2, 2, 2)


def test_everything_left_out_has_its_documented_value():
    geometry = checked(case_of(), GeometryCase).geometry
    (block,) = geometry.block
    assert (block.origin, block.rotate, block.degree, geometry.degree) == ((0, 0, 0), None, None, (1, 1, 1))
    assert (block.spans, block.span_size, block.grading, block.faces) == (None, None, (), ())
    assert block.knot_vectors((1, 2, 3)) is None


def test_one_degree_stands_for_three_and_a_body_may_have_its_own():
    blocks = [BLOCK, BLOCK | {"name": "own", "degree": [3, 1, 2]}, BLOCK | {"name": "other", "degree": 4}]
    geometry = checked({"geometry": {"degree": 2, "block": blocks}}, GeometryCase).geometry
    assert geometry.degree == (2, 2, 2)
    assert [block.degree for block in geometry.block] == [None, (3, 1, 2), (4, 4, 4)]


def test_every_body_is_listed_with_its_key_kind_by_kind_in_the_sequence_of_the_file():
    imported = [{"name": "z", "file": "z.xml"}]
    cad = [{"name": name, "file": f"{name}.step"} for name in ("c", "a")]
    balls = [{"name": "ball", "radius": 1.0}]
    blocks = [BLOCK | {"name": name} for name in ("d", "b")]
    geometry = {"import": imported, "cad": cad, "sphere": balls, "block": blocks}
    tables = list(checked({"geometry": geometry}, GeometryCase).geometry.tables)
    kinds = ["block[0]", "block[1]", "sphere[0]", "cad[0]", "cad[1]", "import[0]"]
    assert [key for key, _ in tables] == [f"geometry.{kind}" for kind in kinds]
    assert [table.name for _, table in tables] == ["d", "b", "ball", "c", "a", "z"]


def test_the_files_that_a_case_needs_are_listed():
    geometry = {"import": [{"name": "z", "file": "z.xml"}], "cad": [{"file": "a.step"}], "block": [BLOCK]}
    assert checked({"geometry": geometry}, GeometryCase).geometry.files == ["a.step", "z.xml"]


@pytest.mark.parametrize("name", ["a", "Stößel", "上部", "punch_2-left", "7"])
def test_names_of_letters_of_any_script_digits_and_hyphens_are_good(name):
    assert names_of(case_of(name=name)) == [name]


@given(st.tuples(*[st.integers(1, 9)] * 3), st.tuples(*[st.integers(1, 4)] * 3))
def test_spans_alone_are_no_knot_vectors(spans, degrees):
    """What the mesh becomes is decided when all patches of the body are known."""
    block = Block(name="a", size=(1, 1, 1), spans=spans)
    assert (block.spans, block.knot_vectors(degrees)) == (spans, None)


@given(st.tuples(*[open_knot_vectors()] * 3))
def test_full_knot_vectors_are_taken_as_they_are(splines):
    knots, degrees = zip(*splines, strict=True)
    found = Block(name="a", size=(1, 1, 1), knots=[k.tolist() for k in knots]).knot_vectors(degrees)
    for one, other in zip(found, knots, strict=True):
        np.testing.assert_array_equal(one, other)


@given(graded_breaks())
def test_breaks_become_the_distinct_knots(at):
    at = [0.0, *at[1:-1].tolist(), 1.0]
    for knots in Block(name="a", size=(1, 1, 1), breaks=[at] * 3).knot_vectors((1, 2, 3)):
        assert bspline.breaks(knots).tolist() == at


def test_a_checked_case_is_taken_as_it_is_and_never_changes():
    case = checked(case_of(), GeometryCase)
    assert checked(case, GeometryCase) is case
    with pytest.raises(ValidationError):
        case.title = "other"
    with pytest.raises(ValidationError):
        case.geometry.block[0].size = (1, 1, 1)


def test_the_case_of_another_stage_is_refused():
    with pytest.raises(CaseError, match=r"GeometryCase.*Block"):
        checked(Block(name="cube", size=(1, 1, 1)), GeometryCase)


def test_a_changed_case_is_a_copy():
    tables = case_of(spans=[4, 4, 4])
    before = copy.deepcopy(tables)
    case = Case(tables, Path("folder"), "name")
    spans = [2, 2, 2]
    changed = case.changed({"geometry.degree": 3, "geometry.block.0.spans": spans, "units.length": "mm"})
    assert tables == before
    assert (changed.folder, changed.name) == (case.folder, case.name)
    assert changed.tables["geometry"] == {"degree": 3, "block": [BLOCK | {"spans": [2, 2, 2]}]}
    assert changed.tables["units"] == {"length": "mm"}
    spans[0] = 9
    changed.tables["geometry"]["block"][0]["size"][0] = 9
    assert changed.tables["geometry"]["block"][0]["spans"] == [2, 2, 2]
    assert tables == before


@pytest.mark.parametrize(
    "key",
    ["geometry.block.7.spans", "geometry.block.7", "geometry.block.spans", "geometry.block.0.size.0.x", "title.x"],
)
def test_a_case_has_no_place_for_a_wrong_path(key):
    with pytest.raises(CaseError, match=f'"{key}"'):
        Case(case_of() | {"title": "cube"}).changed({key: 1})


def test_a_suggestion_names_the_nearest_and_all_that_is_known():
    assert suggestion("solv", TABLES).startswith('did you mean "solve"?')
    assert "did you mean" not in suggestion("xyz", TABLES)
    assert all(table in suggestion("xyz", TABLES) for table in TABLES)
    assert "none" in suggestion("xyz", [])
