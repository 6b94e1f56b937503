import ast
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("geom2iga", "solve", "post")  # each imports only what stands on its left
MODULES = {path: ast.parse(path.read_text(encoding="utf-8")) for p in PACKAGES for path in (ROOT / p).rglob("*.py")}

TOP_LEVEL = {"pyproject.toml", *PACKAGES, "tests", "examples"}
BY_CONVENTION = {"README.md", "LICENSE", "CHANGELOG.md", ".ci", ".gitignore", ".pre-commit-config.yaml"}

MOST_LINES_OF_A_FILE = 400
MOST_LINES_OF_A_FUNCTION = 40


def name_of(path):
    """The dotted name by which a file is imported."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path):
    """Dotted names of all that a file imports, anywhere in it."""
    for node in ast.walk(MODULES[path]):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def imported_files(path):
    """Files of the project that a file imports."""
    files = {name_of(file): file for file in MODULES}
    for name in imports(path):
        parent = name.rpartition(".")[0]
        if name in files or parent in files:
            yield files[name if name in files else parent]


def lines_of_code(function):
    """Lines of a function that hold code: without docstring, comments and blank lines."""
    body = function.body[1:] if ast.get_docstring(function) else function.body
    nodes = [function.args, *body]
    held = {
        line
        for top in nodes
        for node in ast.walk(top)
        if hasattr(node, "lineno")
        for line in (node.lineno, node.end_lineno)
    }
    return len(held | {function.lineno})


def test_all_three_packages_are_looked_at():
    assert {path.relative_to(ROOT).parts[0] for path in MODULES} == set(PACKAGES)


@pytest.mark.parametrize("path", sorted(MODULES), ids=name_of)
def test_imports_point_left(path):
    package = name_of(path).partition(".")[0]
    right = PACKAGES[PACKAGES.index(package) + 1 :]
    assert not [name for name in imports(path) if name.partition(".")[0] in right]


def test_no_file_imports_itself_by_way_of_others():
    order = []

    def visit(path, way):
        assert path not in way, " imports ".join(map(name_of, (*way, path)))
        if path not in order:
            for file in imported_files(path):
                if file != path:
                    visit(file, (*way, path))
            order.append(path)

    for path in MODULES:
        visit(path, ())


def test_two_files_alone_import_gmsh():
    users = {name_of(path) for path in MODULES if any(name.partition(".")[0] == "gmsh" for name in imports(path))}
    assert users == {"geom2iga.cad.session", "geom2iga.cad.hexahedra"}


def test_the_packages_do_not_import_the_tests():
    for path in MODULES:
        assert not [name for name in imports(path) if name.partition(".")[0] == "tests"]


@pytest.mark.parametrize("path", sorted(MODULES), ids=name_of)
def test_files_and_functions_are_short(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= MOST_LINES_OF_A_FILE
    functions = [node for node in ast.walk(MODULES[path]) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    assert not {f.name: lines_of_code(f) for f in functions if lines_of_code(f) > MOST_LINES_OF_A_FUNCTION}


def test_the_top_level_is_the_users():
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("no git repository: nothing tells what belongs to the project")
    command = ["git", "ls-files", "-z"]  # not what lies there beside, such as somebody's first case
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    found = {Path(name).parts[0] for name in listed if name and (ROOT / name).exists()}
    assert found >= TOP_LEVEL
    assert found <= TOP_LEVEL | BY_CONVENTION
