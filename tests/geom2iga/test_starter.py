import json
import re
import tomllib
from pathlib import Path

import pytest

import post.__main__
import solve.__main__
from geom2iga import __main__ as geometry
from geom2iga.case import Block, GeometryCase
from geom2iga.schema import schema
from geom2iga.starter import starter
from geom2iga.tables import Case, Table, checked
from post.case import Post, PostCase
from post.pipeline import main
from solve.case import Augmentation, Contact, Linear, Load, Material, Newton, SolveCase, Steps, Support

pytestmark = pytest.mark.usefixtures("quiet_log")

ROOT = Path(__file__).parents[2]
TABLES = (GeometryCase, SolveCase, PostCase)
LEFT_OUT = re.compile(r"#(?=[^\s:])")  # a key or table; prose has a space behind its #


def variants():
    """Yield the starter with one key, or one table with all its keys, taken in."""
    lines = starter().splitlines()
    number = 0
    while number < len(lines):
        end = number + 1
        if LEFT_OUT.match(lines[number]):
            while lines[number].startswith("#[") and end < len(lines) and LEFT_OUT.match(lines[end]):
                end += 1
            taken = [line.removeprefix("#") for line in lines[number:end]]
            before = lines[:number]
            if rival := re.search(r"# instead of (\w+)", taken[0]):
                last = max(n for n, line in enumerate(before) if line.startswith(f"{rival[1]} ="))
                before[last] = ""
            yield pytest.param("\n".join([*before, *taken, *lines[end:]]), id=f"{number + 1}: {taken[0].split('#')[0]}")
        number = end


VARIANTS = list(variants())


WHOLE = schema(TABLES, "iga-run")
SCHEMAS = (WHOLE, *(schema([kind], "one") for kind in TABLES))


def valid(rules, tables):
    """Whether a JSON schema accepts a case."""
    jsonschema = pytest.importorskip("jsonschema")
    return jsonschema.Draft202012Validator(rules).is_valid(tables)


WITHOUT_PICTURES = (("#pictures = true", "pictures = false"), ("#report = true", "report = false"))


@pytest.mark.parametrize("changes", [WITHOUT_PICTURES, pytest.param((), marks=pytest.mark.slow)], ids=["bare", "whole"])
def test_the_starter_runs_and_all_its_checks_pass(tmp_path, changes):
    folder = tmp_path / "deep" / "first"
    assert main(["-q", "--new", str(folder)]) == 0
    assert sorted(path.name for path in folder.iterdir()) == ["case.schema.json", "case.toml"]
    text = (folder / "case.toml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "case.toml").write_text(text)
    assert main(["-q", str(folder / "case.toml")]) == 0
    summary = json.loads((folder / "case.out" / "summary.json").read_text())
    assert summary["verify"]
    assert all(check["passed"] for check in summary["verify"])


def test_nothing_is_overwritten(tmp_path, capsys):
    (tmp_path / "case.toml").write_text("mine")
    assert main(["--new", str(tmp_path)]) == 2
    assert "case.toml" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["case.toml"]
    assert (tmp_path / "case.toml").read_text() == "mine"
    assert main(["--new", str(tmp_path / "case.toml")]) == 2
    assert "folder" in capsys.readouterr().err


def test_the_name_of_a_case_file_is_no_folder(tmp_path, capsys):
    assert main(["--new", str(tmp_path / "case.toml")]) == 2
    assert "name one without .toml" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("others", [["-n"], ["case.toml"], ["-o", "there"], ["-f"], ["--json"]])
def test_a_new_case_is_written_and_nothing_else_done(tmp_path, others, capsys):
    assert main(["--new", str(tmp_path / "first"), *others]) == 2
    assert "--new" in capsys.readouterr().err
    assert not (tmp_path / "first").exists()


def test_every_command_writes_the_same_case_and_says_what_comes_next(tmp_path, capsys):
    for name, command in (("geom2iga", geometry), ("iga-solve", solve.__main__), ("iga-post", post.__main__)):
        assert command.main(["--new", str(tmp_path / name)]) == 0
        assert (tmp_path / name / "case.toml").read_text() == starter()
        assert f"next: iga-run {tmp_path / name / 'case.toml'}" in capsys.readouterr().err


def test_much_is_left_out_to_be_taken_in():
    assert len(VARIANTS) > 30


@pytest.mark.parametrize("text", VARIANTS)
def test_whatever_is_taken_in_is_a_valid_case(text):
    case = Case(tomllib.loads(text))
    for kind in TABLES:
        checked(case, kind)
    assert case.tables != tomllib.loads(starter())
    assert valid(WHOLE, case.tables)


def test_all_that_can_be_taken_in_together_fits_the_model(tmp_path):
    text = re.sub(r"#\[\[geometry\.cad]](\n#\S.*)+", "", starter())  # there is no such file
    lines = [line if "# instead of" in line else LEFT_OUT.sub("", line) for line in text.splitlines()]
    (tmp_path / "case.toml").write_text("\n".join(lines))
    assert main(["-n", str(tmp_path / "case.toml")]) == 0


@pytest.mark.slow
@pytest.mark.parametrize("text", VARIANTS)
def test_whatever_is_taken_in_fits_the_model(text, tmp_path):
    if "cad" in tomllib.loads(text)["geometry"]:
        pytest.skip("the file is the user's")
    (tmp_path / "case.toml").write_text(text)
    assert main(["-q", "-n", str(tmp_path / "case.toml")]) == 0


@pytest.mark.parametrize("kind", [Block, Material, Support, Load, Contact, Linear, Newton, Augmentation, Steps, Post])
def test_every_common_key_is_in_the_starter(kind):
    seldom = {"breaks", "knots", "points"} if kind in (Block, Contact) else set()
    assert not [key for key in set(kind.model_fields) - seldom if not re.search(rf"\b{key}\b", starter())]


def test_what_is_shown_as_left_out_is_the_default_where_there_is_one():
    linear, newton = Linear(), Newton()
    assert f'#method = "{linear.method}"' in starter()
    assert f"#max_steps = {newton.max_steps}\n#tolerance = {newton.tolerance:g}" in starter()


def tables(kinds):
    """All tables that some tables hold, themselves too."""
    for kind in kinds:
        yield kind
        inside = [part for info in kind.model_fields.values() for part in tables_in(info.annotation)]
        yield from tables(inside)


def tables_in(annotation):
    if isinstance(annotation, type) and issubclass(annotation, Table):
        yield annotation
    for part in getattr(annotation, "__args__", ()):
        yield from tables_in(part)


def test_every_key_of_every_table_is_described():
    found = set(tables(TABLES))
    assert {"Block", "Contact", "Verify", "Rotation", "Cut"} <= {kind.__name__ for kind in found}
    lacking = [
        f"{kind.__name__}.{key}" for kind in found for key, info in kind.model_fields.items() if not info.description
    ]
    assert not lacking


def test_the_schema_forbids_unknown_keys_and_lists_choices_and_defaults():
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft202012Validator.check_schema(WHOLE)
    assert WHOLE["$schema"].endswith("2020-12/schema")
    assert WHOLE["title"]
    for name, kind in {"Case": WHOLE, **WHOLE["$defs"]}.items():
        assert kind["additionalProperties"] is False, name
        assert kind["description"], name
    contact = WHOLE["$defs"]["Contact"]["properties"]
    assert contact["method"]["enum"] == ["mortar", "kts"]
    assert contact["method"]["default"] == "mortar"


CASES = sorted((ROOT / "examples").glob("*/*.toml"))


@pytest.mark.parametrize("path", CASES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_the_schema_accepts_every_example(path):
    assert all(valid(rules, tomllib.loads(path.read_text())) for rules in SCHEMAS)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("geometry.degre", 2),
        ("geometry.degree", 0),
        ("geometry.degree", [1, 2]),
        ("geometry.block.0.name", "a/b"),
        ("solve.contact.0.method", "kss"),
        ("solve.contact.0.penalty", "soft"),
        ("solve.material.0.poisson", 0.5),
        ("post.formats", []),
    ],
)
def test_the_schema_refuses_what_the_commands_refuse(key, value):
    assert not valid(WHOLE, Case(tomllib.loads(starter())).changed({key: value}).tables)


def test_the_starter_names_its_schema_where_editors_look_for_it(tmp_path):
    first = starter().splitlines()[0]
    assert first == "#:schema ./case.schema.json"
    assert main(["-q", "--new", str(tmp_path)]) == 0
    assert json.loads((tmp_path / "case.schema.json").read_text()) == json.loads(json.dumps(WHOLE))
