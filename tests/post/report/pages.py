"""Reports made and read by the tests."""

from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import post
from geom2iga.tables import checked
from post.case import PostCase
from post.fields import Samples
from post.report import write_report
from solve import Result

VOID = {"meta", "link", "img", "br"}


class Page(HTMLParser):
    """What a page consists of: its elements, its numbers under their keys, its text."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.source = path.read_text(encoding="utf-8")
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.numbers: list[tuple[str, str]] = []
        self.texts: list[str] = []
        self.open: list[str] = []
        self.feed(self.source)
        self.close()
        assert not self.open, "elements that are not closed"

    def handle_starttag(self, tag: str, attributes: Any) -> None:
        found = dict(attributes)
        self.elements.append((tag, found))
        if tag == "data" and "data-key" in found:
            self.numbers.append((found["data-key"], found["value"]))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag, f"</{tag}> closes another element"

    def handle_data(self, data: str) -> None:
        if not {"style", "script"} & set(self.open):
            self.texts.append(data)

    @property
    def text(self) -> str:
        """All that is to be read, with single spaces, also between elements."""
        return " ".join(" ".join(self.texts).split())

    @property
    def sections(self) -> set[str | None]:
        """What the page has sections on."""
        return {attributes["id"] for attributes in self.all("section")}

    def all(self, tag: str) -> list[dict[str, str | None]]:
        """The attributes of all elements of a kind."""
        return [attributes for name, attributes in self.elements if name == tag]


def leaves(entry: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield all values of a summary under their keys."""
    if isinstance(entry, dict | list):
        pairs = entry.items() if isinstance(entry, dict) else enumerate(entry)
        for part, value in pairs:
            yield from leaves(value, f"{key}.{part}" if key else str(part))
    else:
        yield key, entry


def summary_of(result: Result, source: Any, folder: Path) -> dict[str, Any]:
    """What summary.json holds; no pictures are drawn."""
    case = checked(source, PostCase)
    bare = case.post.model_copy(update={"pictures": False, "report": False, "bezier": False})
    return post.export(result, case.model_copy(update={"post": bare}), folder)


def page_of(result: Result, source: Any, summary: dict[str, Any], path: Path, pictures: Any = ()) -> Page:
    """Write a report and read it."""
    write_report(path, Samples(result, 2), summary, source, pictures)
    return Page(path)
