"""The reference and the theory of the guide agree with the program."""

import csv
import importlib
import importlib.util
import json
import re
import tomllib
from contextlib import redirect_stdout
from html import unescape
from io import StringIO
from pathlib import Path

import pytest
from latex2mathml.converter import convert
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

import geom2iga
import post
import solve
from geom2iga.tables import checked, read_case
from post.pipeline import STAGES, main
from tests.cases import patch_test_case

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "examples" / "guide" / "docs"
THEORY = [DOCS / "theory.md", *sorted((DOCS / "theory").glob("*.md"))]
PAGES = [*THEORY, DOCS / "methods.md", DOCS / "comparison.md", *sorted((DOCS / "reference").rglob("*.md"))]
BLOCKS = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
FORMULAS = re.compile(r"\$\$(.+?)\$\$|\$([^$\n]+?)\$", re.DOTALL)
EQUATIONS = range(1, 33)  # of the paper


def relative(path):
    return path.relative_to(DOCS).as_posix()


def text_of(page):
    """A page without its blocks of code."""
    return BLOCKS.sub("", page.read_text(encoding="utf-8"))


def quoted(page):
    """What stands between backticks, outside of formulas."""
    return re.findall(r"`([^`\n]+)`", FORMULAS.sub("", text_of(page)))


@pytest.fixture(scope="module")
def generate():
    """The script that writes pages."""
    path = DOCS.parent / "generate.py"
    specification = importlib.util.spec_from_file_location("guide_generate", path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def schema():
    """What iga-run --schema prints, as tables of keys; the first one is the case itself."""
    with redirect_stdout(StringIO()) as out:
        assert main(["--schema"]) == 0
    found = json.loads(out.getvalue())
    return [set(table["properties"]) for table in (found, *found["$defs"].values()) if "properties" in table]


@pytest.mark.parametrize("page", PAGES, ids=relative)
def test_every_formula_becomes_mathml(page):
    for found in FORMULAS.finditer(text_of(page)):
        formula = found[1] or found[2]
        mathml = convert(formula.strip())
        assert "\\" not in mathml, formula
        assert "$" not in mathml, formula
        assert "&" not in unescape(mathml), formula
        assert "<mtable" not in mathml, f"without a mathematical font its parentheses stay small: {formula}"


def test_the_formulas_are_found():
    assert sum(len(FORMULAS.findall(text_of(page))) for page in THEORY) > 100


def resolve(name):
    """Whether a dotted name is an object of the program, or a field of one."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            if not hasattr(found, part):
                return part in getattr(found, "__annotations__", ())
            found = getattr(found, part)
        return True
    return False


@pytest.mark.parametrize("page", PAGES, ids=relative)
def test_every_name_of_the_program_exists(page, generate):
    keys = {f"{place.key}.{name}" for place in generate.places() for name in place.kind.model_fields}
    for name in quoted(page):
        if re.fullmatch(r"(geom2iga|solve|post)(\.\w+)+", name):
            assert resolve(name) or name in keys, name


def test_names_that_do_not_exist_are_told_apart():
    assert resolve("solve.contact.mortar.Mortar.control_gaps")
    assert resolve("solve.contact.mortar.Mortar.area")
    assert not resolve("solve.contact.mortar.Mortar.control_gap")
    assert not resolve("solve.nothing")


def test_every_equation_of_the_paper_has_its_row():
    rows = re.findall(r"^\| (\([^|]*\)) \|", text_of(DOCS / "theory.md"), re.MULTILINE)
    found = []
    for row in rows:
        numbers = [int(number) for number in re.findall(r"\((\d+)\)", row)]
        found += range(numbers[0], numbers[-1] + 1) if " to " in row else numbers
    assert sorted(set(found)) == list(EQUATIONS)


@pytest.mark.parametrize("page", THEORY, ids=relative)
def test_equations_that_are_cited_are_in_the_paper(page):
    cited = {int(number) for number in re.findall(r"\((\d{1,2})\)", text_of(page))}
    assert cited <= set(EQUATIONS)


@pytest.mark.parametrize("page", PAGES, ids=relative)
def test_every_command_exists(page, generate):
    for command in quoted(page):
        words = [word for word in command.split() if not re.fullmatch(r"[A-Z_]+=\S+", word)]
        if len(words) > 1 and words[0] in generate.commands():
            known = generate.help_of(generate.commands()[words[0]])
            assert all(word in known for word in words[1:] if word.startswith("-")), command
        for word in words[1:] if words and words[0] in ("python", "tests/run", *generate.commands()) else ():
            if "/" in word:
                assert (ROOT / word).exists(), command
            if word.startswith("tests."):
                assert importlib.util.find_spec(word), command


def test_the_page_of_the_case_file_has_every_key_of_every_table(generate, schema):
    page = generate.case_page()
    whole, *tables = schema
    for key in set().union(*tables):
        rows = page.count(f"| `{key}` |")
        assert rows == sum(key in table for table in tables) + (key == "title"), key
    for key in whole:
        assert re.search(rf"^(## `\[+{key}\]|\| `{key}` \|)", page, re.MULTILINE), key


def test_the_page_of_the_case_file_has_no_other_keys(generate, schema):
    keys = re.findall(r"^\| `(\w+)` \|", generate.case_page(), re.MULTILINE)
    assert set(keys) <= set().union(*schema)


def test_links_within_the_page_of_the_case_file_lead_somewhere(generate):
    page = generate.case_page()
    anchors = set(re.findall(r"\{ #([\w-]+) \}", page))
    assert set(re.findall(r"\]\(#([\w-]+)\)", page)) <= anchors
    assert len(anchors) == len(re.findall(r"\{ #", page))


def test_values_are_said_in_words(generate):
    page = generate.case_page()
    for row in (
        "| `degree` | one integer, or three | ≥ 1; ≤ 20 |",
        "| `poisson` | number | > -1; < 0.5 | **required** |",
        '| `penalty` | number, or `"auto"` | > 0 | `"auto"` |',
        "| `knots` | 3 lists of numbers |",
        "| `exposed` | true or false |  | `false` |",
        '| `method` | `"mortar"`, `"kts"` |  | `"mortar"` |',
    ):
        assert row in page


def test_the_file_with_every_table_is_right():
    case = read_case(DOCS / "reference" / "every-table.toml")
    for stage in STAGES:
        checked(case, stage.tables)


def test_every_example_is_toml(generate):
    blocks = re.findall(r"^```toml\n(.*?)^```", generate.case_page(), re.MULTILINE | re.DOTALL)
    assert len(blocks) > 25
    assert all(tomllib.loads(block) for block in blocks)


def test_the_page_of_the_commands_has_every_exit_code(generate):
    page = generate.commands_page()
    for code in (0, 1, 2, 3, 4, 5, 130):
        assert f"| {code} |" in page
    for name in ("geom2iga", "iga-solve", "iga-post", "iga-run"):
        assert f"usage: {name} " in page


@pytest.mark.parametrize("package", [geom2iga, solve, post], ids=lambda package: package.__name__)
def test_the_reference_has_every_public_name(package, generate):
    page = generate.api_page(package.__name__)
    for name in package.__all__:
        value = getattr(package, name)
        full = f"{value.__module__}.{value.__qualname__}"
        assert f"::: {full}\n" in page
        assert resolve(full)
        assert value.__doc__


def test_no_page_of_the_reference_is_empty(generate):
    for name in generate.PAGES:
        assert generate.api_page(name).count(":::") > 1, name


def test_pages_come_out_the_same_every_time(generate):
    assert generate.pages() == generate.pages()


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The folder of a small run with two load steps."""
    folder = tmp_path_factory.mktemp("out")
    case = patch_test_case(1, (1, 1, 1), (1, 1, 1))
    case["solve"]["steps"] = {"count": 2}
    case["post"] = {
        "pictures": False,
        "report": False,
        "gauss_points": True,
        "point": [{"name": "inside", "at": [1.0, 1.0, 0.5]}],
        "line": [{"name": "through", "start": [1.0, 1.0, 0.1], "end": [1.0, 1.0, 1.9]}],
    }
    post.export(solve.solve(geom2iga.build(case), case), case, folder)
    return folder


def described(path):
    """The name by which the page has a file: that of a probe left open, without the number of a load step."""
    name = re.sub(r"^(point|line)_.*(?=\.csv$)", r"\1_<name>", path.name)
    return re.sub(r"_\d+(?=\.vtu$)", "", name)


def section(name):
    """The part of the page on output files under the heading of a file."""
    return text_of(DOCS / "reference" / "output-files.md").split(f"\n## `{name}`\n")[1].split("\n## ")[0]


def listed(name):
    """First column of the tables of a section."""
    rows = re.findall(r"^\| (`[^|]*`) \|", section(name), re.MULTILINE)
    return [found for row in rows for found in re.findall(r"`(\w+)`", row)]


def arrays(path):
    """Names of all arrays of a VTU file."""
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    parts = (grid.GetPointData(), grid.GetCellData(), grid.GetFieldData())
    return {part.GetArrayName(number) for part in parts for number in range(part.GetNumberOfArrays())}


def test_every_array_is_described(written):
    paths = list(written.glob("*.vtu"))
    assert {described(path) for path in paths} >= {"bodies.vtu", "contact.vtu"}
    for path in paths:
        name = described(path)
        like_bodies = set(listed("bodies.vtu")) if name == "gauss.vtu" else set()
        known = set(re.findall(r"`(\w+)`", section(name))) | like_bodies
        assert arrays(path) - {"samples", "body"} <= known, name
        assert set(listed(name)) <= arrays(path), name


def test_every_column_is_described(written):
    paths = list(written.glob("*.csv"))
    assert len(paths) > 1
    for path in paths:
        with open(path, encoding="utf-8") as file:
            assert sorted(next(csv.reader(file))) == sorted(listed(described(path))), path.name


def keys_of(value, by_name=("bodies", "patches", "seconds")):
    """All keys of a summary but names of bodies, patches and phases."""
    if isinstance(value, list):
        return set().union(*map(keys_of, value))
    if not isinstance(value, dict):
        return set()
    inner = [list(each.values()) if key in by_name else each for key, each in value.items()]
    return set(value).union(*map(keys_of, inner))


def test_every_number_of_the_summary_is_described(written):
    summary = json.loads((written / "summary.json").read_text(encoding="utf-8"))
    known = set(re.findall(r"`(\w+)`", section("summary.json")))
    assert keys_of(summary) <= known
    assert set(listed("summary.json")) <= set(summary)


def test_every_file_is_described(written):
    text = text_of(DOCS / "reference" / "output-files.md")
    assert not [path.name for path in written.iterdir() if f"`{described(path)}`" not in text]
