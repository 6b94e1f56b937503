"""Pages of the reference that are written by the program itself: the case file, the commands, the Python interface.

`mkdocs build` calls `on_files`; `python examples/guide/generate.py FOLDER` writes the same pages into a folder.
"""

import importlib
import inspect
import io
import os
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stdout, suppress
from functools import cache
from pathlib import Path
from types import ModuleType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin
from unittest.mock import patch

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

import geom2iga.shapes.primitives
import post.exact
import post.plots
import post.profile
import solve
from geom2iga.case import GeometryCase
from geom2iga.errors import UserError
from geom2iga.signals import ENDING
from geom2iga.stage import OUR_BUG
from geom2iga.tables import Table
from post.case import PostCase
from solve.case import SolveCase

HERE = Path(__file__).parent
EVERY_TABLE = HERE / "docs" / "reference" / "every-table.toml"
STAGES = {"geom2iga": GeometryCase, "iga-solve": SolveCase, "iga-post": PostCase}
WORDS = {float: "number", int: "integer", str: "text", bool: "true or false"}
PLURAL = {"number": "numbers", "integer": "integers", "text": "texts"}
SYMBOLS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤", "min_length": "length ≥"}
ONE_OR_THREE, OR_TABLE = "_three", {"_several": "{}, or a list of them", "_round": "radius, or {}"}
CASE_INTRODUCTION = """# Case file

TOML; paths are relative to the file; unknown keys are errors. Numbers must be in consistent units: a length, a force,
and stresses as force per length². This page is made from the schema that `iga-run --schema` prints. A case needs
`[geometry]` with a body and `[solve]` with a material; all else has defaults.

The examples below are pieces of one file, [every-table.toml](every-table.toml).
"""
OPTIONS = (  # of mkdocstrings
    "heading_level: 2",
    "show_root_full_path: false",
    "separate_signature: true",
    "show_signature_annotations: true",
)
PAGES = {  # of the Python interface: packages with a list of public names, and modules that are public as a whole
    "geom2iga": ([geom2iga], "Bodies of NURBS patches: build, read, change, write them."),
    "shapes": ([geom2iga.shapes.primitives], "Exact shapes for people who have no CAD."),
    "solve": ([solve], "Isogeometric elasticity with mortar contact."),
    "post": ([post], "Files, pictures and checks of a result."),
    "exact": ([post.exact], "Closed-form solutions to compare with."),
    "plots": ([post.plots, post.profile], "Pictures for scripts and notebooks."),
}


class Place(NamedTuple):
    """A table of the case file."""

    key: str  # such as geometry.block
    header: str  # as it is written
    kind: type[Table]
    inline: bool  # written inside another one, in braces


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages to the site."""
    for name, text in pages().items():
        files.append(File.generated(config, name, content=text))
    return files


def pages() -> dict[str, str]:
    """All pages by name."""
    api = {f"reference/api/{name}.md": api_page(name) for name in PAGES}
    return {"reference/case-file.md": case_page(), "reference/commands.md": commands_page(), **api}


# ---- the case file


@cache
def places() -> list[Place]:
    """All tables of the case file, each key once, in the sequence of the file."""
    found: dict[str, Place] = {}
    for kind in STAGES.values():
        for name, info in kind.model_fields.items():
            for place in _below(info.alias or name, info.annotation, False):
                found.setdefault(place.key, place)
    return list(found.values())


def _below(key: str, annotation: Any, inside: bool) -> Iterator[Place]:
    """The table of a key, if it is one, and all below it."""
    kind = _table_in(annotation)
    if kind is None:
        return
    several = any(get_origin(part) is tuple for part in _parts(annotation))
    has_tables = any(_table_in(info.annotation) for info in kind.model_fields.values())
    inline = inside or (key.count(".") > 0 and key.rpartition(".")[2] in ("bodies", "faces"))
    header = f"{key.rpartition('.')[2]} = {{ ... }}" if inline else f"[[{key}]]" if several else f"[{key}]"
    yield Place(key, header, kind, inline)
    for name, info in kind.model_fields.items() if has_tables else ():
        own = several or inline  # tables in an entry of a list are written in braces
        yield from _below(f"{key}.{info.alias or name}", info.annotation, own)


def _parts(annotation: Any) -> list[Any]:
    """The members of a union, without None."""
    if get_origin(annotation) is Annotated:
        return _parts(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        return [part for each in get_args(annotation) for part in _parts(each) if each is not type(None)]
    return [annotation]


def _table_in(annotation: Any) -> type[Table] | None:
    """The class of tables inside an annotation such as tuple[Block, ...] or Rotation | None."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return annotation
    return next((kind for part in get_args(annotation) if (kind := _table_in(part))), None)


def case_page() -> str:
    """The reference of the case file: a section for each table."""
    every, seen = EVERY_TABLE.read_text(encoding="utf-8"), dict[type[Table], Place]()
    top = [(name, info) for kind in STAGES.values() for name, info in kind.model_fields.items()]
    lines = [
        CASE_INTRODUCTION,
        *_rows({info.alias or name: info for name, info in top if _table_in(info.annotation) is None}),
    ]
    for place in places():
        if place.kind in seen:
            continue
        seen[place.kind] = place
        lines += _section(place, every)
    return "\n".join(lines) + "\n"


def _section(place: Place, every: str) -> list[str]:
    """Heading, keys and example of a table."""
    same = [other for other in places() if other.kind is place.kind]
    level = "##" if place.key.count(".") < 2 else "###"
    lines = [
        "",
        f"{level} `{place.header}` {{ #{_anchor(place.key)} }}",
        "",
        inspect.cleandoc(place.kind.__doc__ or ""),
    ]
    if len(same) > 1:
        lines += ["", f"Written as {_where(same)}."]
    own = {info.alias or name: info for name, info in place.kind.model_fields.items()}
    lines += ["", *_rows(dict(sorted(own.items(), key=lambda item: not item[1].is_required())))]
    if any(_table_in(info.annotation) is None for info in own.values()):  # else it only holds tables
        lines += ["", "```toml", example(same, every), "```"]
    return lines


def _where(same: Sequence[Place]) -> str:
    """Say under which keys of which other tables a table is written."""
    kinds = {place.key: place.kind for place in places()}
    parents = {kinds[place.key.rpartition(".")[0]]: place.key.split(".")[-2] for place in same}
    keys = " or ".join(dict.fromkeys(f"`{place.key.rpartition('.')[2]}`" for place in same))
    return f"{keys} in {', '.join(f'[{name}](#{anchor(kind)})' for kind, name in parents.items())}"


@cache
def anchor(kind: type[Table]) -> str:
    """The anchor of the section of a table."""
    return _anchor(next(place.key for place in places() if place.kind is kind))


def _anchor(key: str) -> str:
    return key.replace(".", "-").replace("_", "-")


def _rows(fields: Mapping[str, FieldInfo]) -> list[str]:
    """A table of keys."""
    lines = ["| key | value | allowed | default | meaning |", "| --- | --- | --- | --- | --- |"]
    for key, info in fields.items():
        value = words(info.annotation, info.metadata)
        allowed = "; ".join(limits(info.annotation, info.metadata))
        text = (info.description or _doc_of(info.annotation)).replace("<", "&lt;")
        lines.append(f"| `{key}` | {value} | {allowed} | {default(info)} | {text} |")
    return lines


def _doc_of(annotation: Any) -> str:
    """The first sentence on a table."""
    kind = _table_in(annotation)
    return "" if kind is None else inspect.cleandoc(kind.__doc__ or "").split("\n")[0]


def words(annotation: Any, metadata: Sequence[Any] = ()) -> str:
    """The kind of a value in words."""
    names = [part.func.__name__ for part in metadata if hasattr(part, "func")]
    kind, origin, inner = _table_in(annotation), get_origin(annotation), get_args(annotation)
    if ONE_OR_THREE in names:
        return "one integer, or three"
    if kind is not None:
        either = next((OR_TABLE[name] for name in names if name in OR_TABLE), "")
        link = f"[{'table' if either or origin is not tuple else 'tables'}](#{anchor(kind)})"
        return either.format(link) or link
    if origin is Annotated:
        return words(inner[0], [each for part in inner[1:] for each in getattr(part, "metadata", [part])])
    if origin in (Union, UnionType):
        return ", or ".join(dict.fromkeys(words(part) for part in inner if part is not type(None)))
    if origin is Literal:
        return ", ".join(f'`"{each}"`' for each in inner)
    if origin in (tuple, list):
        count = "" if origin is list or inner[-1] is Ellipsis else f"{len(inner)} "
        item = words(inner[0])
        return (
            f"{count}lists of{item[7:]}" if item.startswith("list of") else f"list of {count}{PLURAL.get(item, item)}"
        )
    if origin is dict:
        return f"table of {words(inner[1])}"
    return WORDS[annotation]


def limits(annotation: Any, metadata: Sequence[Any] = ()) -> list[str]:
    """The range of a number, the length of a list."""
    marks = [mark for part in metadata for mark in getattr(part, "metadata", [part])]
    bounds = [(sign, getattr(mark, name, None)) for mark in marks for name, sign in SYMBOLS.items()]
    own = [f"{sign} {bound:g}" for sign, bound in bounds if bound is not None]
    inner = [] if _table_in(annotation) or get_origin(annotation) is Literal else get_args(annotation)
    if get_origin(annotation) is Annotated:
        return limits(inner[0], [*inner[1:], *metadata])
    return [*dict.fromkeys([*own, *(text for part in inner for text in limits(part))])]


def default(info: FieldInfo) -> str:
    """The value of a key that is left out."""
    value = info.get_default(call_default_factory=True)
    if value is PydanticUndefined:
        return "**required**"
    if value is None or value in ((), {}, ""):
        return ""
    if isinstance(value, Table):
        return "its defaults"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return "`[" + ", ".join(f'"{each}"' if isinstance(each, str) else f"{each:g}" for each in value) + "]`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{value:g}`"


def example(same: Sequence[Place], every: str) -> str:
    """The piece of the file with every table that shows a table, at the first of the places where it may stand."""
    pieces = re.split(r"\n\n(?=\[)", every.strip())
    for place in same:
        show = _inline_example if place.inline else _own_example
        if shown := show(place, pieces):
            return shown
    raise KeyError(f"{EVERY_TABLE.name} shows no {same[0].key}: add one")


def _own_example(place: Place, pieces: Sequence[str]) -> str:
    """The entries of a table with a header of its own."""
    return "\n\n".join(piece for piece in pieces if piece.startswith(place.header + "\n"))


def _inline_example(place: Place, pieces: Sequence[str]) -> str:
    """The lines of a key in the entry of another table, with that one's header."""
    key = place.key.rpartition(".")[2]
    for piece in pieces:
        head, *lines = piece.split("\n")
        shown = [number for number, line in enumerate(lines) if re.search(rf"\b{key} = [\[{{]", line)]
        if shown and place.key.startswith(head.strip("[]") + "."):
            start = next(number for number in range(shown[0], -1, -1) if lines[number][0] not in " ]")
            end = lines.index("]", start) if lines[start].endswith("[") else start
            return "\n".join([head, *lines[start : end + 1]])
    return ""


# ---- commands


def commands() -> dict[str, Any]:
    """Functions of all commands by name."""
    scripts = tomllib.loads((HERE.parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    return {name: _found(*target.split(":")) for name, target in scripts.items()}


def _found(module: str, name: str) -> Any:
    return getattr(importlib.import_module(module), name)


def help_of(main: Any) -> str:
    """What a command prints with --help."""
    text = io.StringIO()
    with patch.dict(os.environ, {"COLUMNS": "100"}), redirect_stdout(text), suppress(SystemExit):
        main(["--help"])
    return text.getvalue().rstrip()


def exit_codes() -> dict[int, str]:
    """Exit codes and their meaning."""
    theirs: dict[int, str] = {}
    for kind in UserError.__subclasses__():
        meaning = inspect.cleandoc(kind.__doc__ or "").rstrip(".")
        theirs[kind.exit_code] = f"{theirs[kind.exit_code]}. {meaning}" if kind.exit_code in theirs else meaning
    ended = {128 + number: f"Ended by {number.name}" for number in ENDING}
    return {0: "Done, or up to date", OUR_BUG: "A bug of the program", **theirs, **ended}


def commands_page() -> str:
    """The reference of the commands."""
    lines = ["# Commands", "", "Errors and progress go to standard error, data to standard output.", ""]
    for name, main in commands().items():
        lines += [f"## `{name}`", "", "```text", help_of(main), "```", ""]
    lines += ["## Exit codes", "", "| exit code | meaning |", "| --- | --- |"]
    lines += [f"| {code} | {meaning} |" for code, meaning in sorted(exit_codes().items())]
    return "\n".join(lines) + "\n"


# ---- the Python interface


def public(module: ModuleType) -> list[str]:
    """Full names of what a module defines for others, where it is defined."""
    listed = getattr(module, "__all__", None)
    origins = {name: getattr(value, "__module__", None) or "" for name, value in vars(module).items()}
    own = [name for name, origin in origins.items() if origin.startswith(module.__name__) and not name.startswith("_")]
    names = listed or own
    return [f"{value.__module__}.{value.__qualname__}" for name in names for value in [getattr(module, name)]]


def api_page(name: str) -> str:
    """The reference of some modules: docstrings, by mkdocstrings."""
    modules, title = PAGES[name]
    lines = [f"# {modules[0].__name__}", "", title, ""]
    for module in modules:
        lines += [f"From `{module.__name__}`:", ""]
        for full in public(module):
            lines += [f"::: {full}", "    options:", *(f"      {option}" for option in OPTIONS), ""]
    return "\n".join(lines)


def main(arguments: Sequence[str]) -> None:
    """Write all pages into a folder."""
    for name, text in pages().items():
        path = Path(arguments[0]) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
