"""Do what a page of the guide says, as a reader would; python pages.py PAGE... draws the pictures of pages anew.

A page is one session in an empty folder, from its first block to its last:

- ```toml title="case.toml"     is written to that file; so is python and text with a title.
- ```diff title="case.toml"     changes lines of that file, wherever they stand.
- ```toml                       is a fragment: merged into the last file above with [geometry], or into the one that
                                a comment <!-- into: examples/stack/case.toml --> names; then `iga-run --dry-run`.
- ```python                     is executed; blocks of a page share their names.
- ```console                    commands behind "$ ": ours are run, those of NOT_RUN are not, others are errors.
                                What follows a command is what it prints, "..." is anything, lines may be left out.
- ```text                       right below a python block is what that prints.

Comments above a block: <!-- exit: 5 -->, the exit code of its commands; <!-- keys only -->, the fragment's keys are
checked, but nothing is built; <!-- not run -->. An image below <!-- drawn: case.out/stress.png --> is that file.
"""

import contextlib
import io
import os
import re
import runpy
import shlex
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from PIL import Image

from geom2iga.__main__ import main as geom2iga_main
from geom2iga.case import GeometryCase
from geom2iga.errors import UserError
from geom2iga.tables import Case, checked, read_case
from post.__main__ import main as post_main
from post.case import PostCase
from post.pipeline import STAGES
from post.pipeline import main as run_main
from solve.__main__ import main as solve_main
from solve.case import SolveCase

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(
    r"^(?P<notes>(?:<!--[^\n]*-->\n+)*)```(?P<head>\S[^\n]*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)
DRAWN = re.compile(r"<!-- drawn: (\S+) -->\n+!\[[^\]]*\]\((\S+?)\)")
LARGEST = (1000, 1000)  # pixels of the pictures that are kept
COMMANDS: Mapping[str, Callable[[list[str]], int]] = {
    "geom2iga": geom2iga_main,
    "iga-solve": solve_main,
    "iga-post": post_main,
    "iga-run": run_main,
}
NOT_RUN = (  # what installs, waits for a person, or belongs to other programs
    "git clone",
    "sudo apt-get",
    "python3 -m venv",
    ". .venv/bin/activate",
    "pip install",
    "examples/quickstart",
    "export ",
    "jupyter",
    "mkdocs",
    "paraview",
    "tests/run",
    "xdg-open",
)


class PageError(AssertionError):
    """What a page says is not so."""


@dataclass(frozen=True)
class Block:
    """A fenced block: what it is, its title, the comments above it, whether it stands right below the one before."""

    language: str
    title: str | None
    notes: Mapping[str, str]
    text: str
    line: int
    below: bool


def blocks(page: str) -> Iterator[Block]:
    """Find the fenced blocks of a page."""
    end = None
    for found in BLOCK.finditer(page):
        language, _, rest = found["head"].partition(" ")
        title = re.search(r'title="([^"]+)"', rest)
        notes = dict(re.findall(r"<!-- ([\w ]+?)(?:: (.*?))? -->", found["notes"]))
        below = end is not None and not page[end : found.start()].strip()
        line = page.count("\n", 0, found.start("head")) + 1
        yield Block(language, title and title[1], notes, found["text"], line, below)
        end = found.end()


@dataclass
class Session:
    """A reader at work: folder, page, names defined, what was printed last, the case last written, pictures to show."""

    folder: Path
    page: Path
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "__main__"})
    printed: str = ""
    case: Path | None = None
    pictures: dict[str, Image.Image] = field(default_factory=dict)

    def follow(self, block: Block) -> None:
        """Do what one block says; raise PageError where it cannot be done or something else comes out."""
        if "not run" in block.notes:
            return
        act = {"toml": self._toml, "python": self._python, "console": self._console, "text": self._text}
        try:
            if block.title:
                self._write(block)
            elif block.language in act:
                act[block.language](block)
            else:
                raise PageError(f"a block of {block.language}: nothing tells whether it is true")
        except PageError as error:
            raise PageError(f"{self.page.name}, line {block.line}: {error}") from None
        except Exception as error:
            raise PageError(f"{self.page.name}, line {block.line}: {type(error).__name__}: {error}") from error

    def keep(self, drawn: str, shown: str) -> None:
        """Take a picture as it is now, to be shown under a name; raise PageError where there is none."""
        path = self.folder / drawn
        if not path.is_file():
            raise PageError(f"{self.page.name}: {drawn} was not drawn")
        self.pictures[shown] = Image.open(path).convert("RGB")

    def _write(self, block: Block) -> None:
        """Write a file that the page shows, or change it."""
        path = Path(str(block.title))
        path.parent.mkdir(parents=True, exist_ok=True)
        text = edited(path.read_text(encoding="utf-8"), block.text) if block.language == "diff" else block.text
        path.write_text(text, encoding="utf-8")
        if path.suffix == ".toml" and "geometry" in tomllib.loads(text):
            self.case = path.absolute()

    def _toml(self, block: Block) -> None:
        """Merge a fragment into a case, and check what comes of it."""
        into = ROOT / block.notes["into"] if "into" in block.notes else self.case
        if into is None:
            raise PageError("a fragment, but there is no case above it")
        case = read_case(into)
        case = Case(merged(case.tables, tomllib.loads(block.text)), case.folder, case.name)
        code = 0
        try:
            for kind in (GeometryCase, SolveCase, PostCase):
                checked(case, kind)
            for stage in () if "keys only" in block.notes else STAGES:
                stage.plan(case)
        except UserError as error:
            code, self.printed = error.exit_code, str(error)
        self._check_exit(block, code)

    def _python(self, block: Block) -> None:
        """Execute code."""
        with self._listening():
            exec(compile(block.text, f"{self.page.name}:{block.line}", "exec"), self.names)

    def _console(self, block: Block) -> None:
        """Run commands, and look for what they are said to print."""
        for part in re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]:
            command, _, expected = part.partition("\n")
            if command.startswith(NOT_RUN):
                continue
            words = shlex.split(command, comments=True)
            with self._listening():
                code = self._run(words)
            self._check_exit(block, code)
            self._check_printed(expected)

    def _run(self, words: Sequence[str]) -> int:
        """Run one command in this process and return its exit code."""
        name, *arguments = words
        if name == "cd":
            os.chdir(arguments[0])
            return 0
        try:
            if name == "python":
                return run_script(arguments)
            if name in COMMANDS:
                return COMMANDS[name](arguments)
        except SystemExit as end:
            return int(end.code or 0)
        raise PageError(f'"{name}" is neither run nor listed among those that are not')

    def _text(self, block: Block) -> None:
        """Look for what the python block above is said to print; other text is a picture."""
        if block.below:
            self._check_printed(block.text)

    def _check_exit(self, block: Block, code: int) -> None:
        wanted = int(block.notes.get("exit", 0))
        if code != wanted:
            raise PageError(f"exit code {code}, expected {wanted}:\n{self.printed}")

    def _check_printed(self, expected: str) -> None:
        printed, at = " ".join(self.printed.split()), 0
        for line in filter(None, (" ".join(line.split()) for line in expected.splitlines())):
            pattern = ".*?".join(map(re.escape, line.split("...")))
            found = re.compile(pattern).search(printed, at)
            if not found:
                raise PageError(f"does not print, or not here: {line}\n--- printed:\n{self.printed}")
            at = found.end()

    @contextlib.contextmanager
    def _listening(self) -> Iterator[None]:
        """Keep what is printed."""
        out = io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            try:
                yield
            finally:
                self.printed = out.getvalue()


def run_script(arguments: Sequence[str]) -> int:
    """Run a script, or with -m a module, as `python` would."""
    before, path, known = sys.argv, list(sys.path), set(sys.modules)
    sys.argv = list(arguments[1:] if arguments[0] == "-m" else arguments)
    sys.path.insert(0, "")
    try:
        if arguments[0] == "-m":
            runpy.run_module(arguments[1], run_name="__main__", alter_sys=True)
        else:
            runpy.run_path(arguments[0], run_name="__main__")
    finally:
        sys.argv, sys.path[:] = before, path
        for name in set(sys.modules) - known:  # the reader's own modules, which another page may call the same
            if Path(getattr(sys.modules[name], "__file__", None) or "/").parent == Path.cwd():
                del sys.modules[name]
    return 0


def edited(text: str, change: str) -> str:
    """Replace the lines of a change marked "-" by those marked "+" that follow them."""
    for hunk in re.findall(r"(?:^-[^\n]*\n)+(?:^\+[^\n]*\n)*", change, re.MULTILINE):
        old, new = ("".join(re.findall(rf"^\{sign}([^\n]*\n)", hunk, re.MULTILINE)) for sign in "-+")
        if old not in text:
            raise PageError(f"there is nothing like this to be changed:\n{old}")
        text = text.replace(old, new)
    return text


def merged(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """Merge tables key by key; lists and values are replaced."""
    result = dict(base)
    for key, value in change.items():
        both = isinstance(value, Mapping) and isinstance(base.get(key), Mapping)
        result[key] = merged(base[key], value) if both else value
    return result


def follow(page: Path, folder: Path) -> Session:
    """Do all that a page says, in a folder; raise PageError where it does not hold."""
    session, before = Session(folder, page), Path.cwd()
    text = page.read_text(encoding="utf-8")
    drawn = [(text.count("\n", 0, found.start()) + 1, found[1], found[2]) for found in DRAWN.finditer(text)]
    steps = [(block.line, block) for block in blocks(text)] + [(line, names) for line, *names in drawn]
    os.chdir(folder)
    try:
        for _, step in sorted(steps, key=lambda each: each[0]):
            if isinstance(step, Block):
                session.follow(step)
            else:
                session.keep(*step)
    finally:
        os.chdir(before)
    return session


def main(pages: Sequence[str]) -> None:
    """Follow pages and put the pictures that their cases draw beside them."""
    for page in map(Path, pages):
        with tempfile.TemporaryDirectory() as folder:
            session = follow(page.absolute(), Path(folder))
        for name, picture in session.pictures.items():
            (page.parent / name).parent.mkdir(exist_ok=True)
            picture.thumbnail(LARGEST)
            picture.save(page.parent / name, optimize=True)
        print(page)


if __name__ == "__main__":
    main(sys.argv[1:])
