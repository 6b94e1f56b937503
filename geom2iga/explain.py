"""What pydantic finds wrong with a case, in the words of the case file."""

import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ValidationError

from geom2iga.errors import shown, suggestion

WORDS = {  # what pydantic calls things, and what they are in a case file
    r"^(Input|Tuple|List) should ": "should ",
    " after validation": "",
    "valid tuple": "list",
    r"valid dictionary( or instance of \w+)?": "table",
    "a valid boolean": "true or false",
    "a valid string": "a string, in quotes",
}
QUOTED = re.compile("'([^']*)'")

KeyPath = tuple[int | str, ...]


def explained(error: ValidationError, kind: type[BaseModel], tables: Mapping[str, Any]) -> str:
    """Turn the first of the errors into one sentence: key = value: what is allowed.

    Parameters
    ----------
    kind :
        What was to be made of the tables.
    tables :
        What stands in the case file.
    """
    found = [(_path(each, kind, tables), each) for each in error.errors(include_url=False)]
    found.sort(key=lambda each: each[1]["type"] != "extra_forbidden")  # a typo before what it leaves out
    first = found[0][0]
    path = max((path for path, _ in found if path[: len(first)] == first), key=len)  # the deepest of one value's
    return _sentence(path, [each for its, each in found if its == path], kind)


def _path(error: Any, kind: type[BaseModel], tables: Any) -> KeyPath:
    """Find the keys that lead to a wrong value; pydantic puts names of alternatives between them."""
    path: list[int | str] = []
    value = tables
    for part in error["loc"]:
        if isinstance(part, int):
            path.append(part)
            if not isinstance(value, Mapping):  # one table may stand for a list of one
                value = value[part] if isinstance(value, Sequence) and part < len(value) else None
        elif (isinstance(value, Mapping) and part in value) or part in dict(_fields(kind, tuple(path))):
            path.append(part)
            value = value.get(part) if isinstance(value, Mapping) else value
    return tuple(path)


def _sentence(path: KeyPath, errors: Sequence[Any], kind: type[BaseModel]) -> str:
    """Say what is wrong at one place, where none of several alternatives is met."""
    error, key = errors[0], _key(path)
    if error["type"] == "extra_forbidden":
        known = [name for name, _ in _fields(kind, path[:-1])]
        return f'unknown key "{path[-1]}" in [{_key(path[:-1])}]; {suggestion(str(path[-1]), known)}'
    if error["type"] == "missing":
        return f"{key} is missing"
    if error["type"] == "tuple_type" and len(errors) == 1 and isinstance(error["input"], Mapping):
        return f"{key} is one table, should be a list of tables: write [[{_key(path, numbers=False)}]]"
    if error["type"] == "value_error":
        message = error["msg"].removeprefix("Value error, ")
        return f"{key}.{message}" if message.startswith(("block[", "cad[", "breaks[")) else f"{key}: {message}"
    texts = list(dict.fromkeys(_in_our_words(each["msg"]).removeprefix("should be ") for each in errors))
    allowed = f"should be {' or '.join(texts)}" if len(texts) > 1 else _in_our_words(error["msg"])
    return f"{key} = {shown(error['input'])}: {allowed}{_guess(path, errors, kind)}"


def _key(path: KeyPath, numbers: bool = True) -> str:
    """Write a path of keys as one key: geometry.block[0].size."""
    text = "".join(f".{part}" if isinstance(part, str) else f"[{part}]" * numbers for part in path)
    return text.removeprefix(".")


def _in_our_words(message: str) -> str:
    for theirs, ours in WORDS.items():
        message = re.sub(theirs, ours, message)
    message = QUOTED.sub(r'"\1"', message)
    return message[0].lower() + message[1:]


def _guess(path: KeyPath, errors: Sequence[Any], kind: type[BaseModel]) -> str:
    """Say what a wrong value could have been: a word that is allowed there, or tables under another key."""
    value = errors[0]["input"]
    if isinstance(value, str):
        words = [word for each in errors if "expected" in each.get("ctx", {}) for word in QUOTED.findall(each["msg"])]
        return "".join(f'; did you mean "{word}"?' for word in get_close_matches(value, words, 1))
    tables = value if isinstance(value, list) else [value]
    if tables and all(isinstance(each, Mapping) for each in tables):
        lists = [name for name, field in _fields(kind, path[:-1]) if _table_in(field.annotation)]
        close = get_close_matches(str(path[-1]), lists, 1)
        return "".join(f"; tables go under [[{_key((*path[:-1], name), numbers=False)}]]" for name in close)
    return ""


def _fields(kind: Any, path: KeyPath) -> list[tuple[str, Any]]:
    """List the keys allowed in the table that a path of keys leads to."""
    for part in path:
        fields = {info.alias or name: info for name, info in kind.model_fields.items()}
        if part in fields:
            kind = _table_in(fields[part].annotation) or kind
    return [(info.alias or name, info) for name, info in kind.model_fields.items()]


def _table_in(annotation: Any) -> Any:
    """Find the class of tables inside an annotation such as tuple[Block, ...] or Rotation | None."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for part in getattr(annotation, "__args__", ()) if (found := _table_in(part))), None)
