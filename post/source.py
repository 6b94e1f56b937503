"""The text of a case: as in its file, or written anew."""

import tomllib
from collections.abc import Mapping
from typing import Any

from geom2iga.tables import Case, Source, Table, as_case


def case_text(source: Source) -> str | None:
    """Find the TOML text of a case, with its comments where it is that of a file; none for one stage's tables alone."""
    if isinstance(source, Table):
        return None
    case = as_case(source)
    return _file_text(case) or _written(case.tables)


def _file_text(case: Case) -> str | None:
    """The file that a case was read from, unless the case was changed since."""
    try:
        text = (case.folder / case.name).read_text(encoding="utf-8-sig")
        return text if tomllib.loads(text) == case.tables else None
    except (OSError, ValueError):
        return None


def _written(tables: Mapping[str, Any]) -> str:
    import tomlkit  # seldom needed

    return tomlkit.dumps(_plain(tables))


def _plain(value: Any) -> Any:
    """Turn what Python takes for tables and lists into what TOML has; what is None is left out."""
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items() if each is not None}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return value if isinstance(value, bool | int | float | str) else str(value)
