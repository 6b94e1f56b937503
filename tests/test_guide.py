"""All that the guide says is done: examples/guide/pages.py says how blocks are read."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from html import unescape

import pytest
from playwright.sync_api import sync_playwright

from tests.test_examples import EXAMPLES, script

GUIDE = EXAMPLES / "guide"
SLOW = ("how-to/geometry", "how-to/results", "tutorial/geometry-to-pressure", "tutorial/hertz")
MKDOCS = GUIDE / "mkdocs.yml"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pages = script(GUIDE / "pages.py")

PAGES = [
    pytest.param(page, id=name, marks=pytest.mark.slow if name in SLOW else ())
    for page in sorted((GUIDE / "docs").rglob("*.md"))
    if not {"reference", "gallery"} & set(page.relative_to(GUIDE / "docs").parts)
    for name in [page.relative_to(GUIDE / "docs").with_suffix("").as_posix()]
]


@pytest.mark.parametrize("page", PAGES)
def test_every_block_of_the_guide_does_what_the_page_says(page, tmp_path):
    pages.follow(page, tmp_path)


def test_the_readme_names_keys_that_exist_and_its_sweep_runs(tmp_path, monkeypatch):
    (tmp_path / "examples").symlink_to(EXAMPLES)
    monkeypatch.chdir(tmp_path)
    session = pages.Session(tmp_path, EXAMPLES.parent / "README.md")
    for block in pages.blocks(session.page.read_text(encoding="utf-8")):
        if block.language == "toml":
            session.follow(replace(block, notes={"into": "examples/contact_patch_test/case.toml", "keys only": ""}))
        elif block.language == "python" and "read_case" in block.text:
            session.follow(block)
    assert session.printed.count("\n") == 3


def written(folder, text):
    path = folder / "page.md"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("block", "complaint"),
    [
        ("```python\nprint(1)\n```\n\n```text\n2\n```", "does not print"),
        ("```python\n1 / 0\n```", "ZeroDivisionError"),
        ("```console\n$ iga-run missing.toml\n```", "exit code 2, expected 0"),
        ("```console\n$ rm -r everything\n```", "neither run nor listed"),
        ("```console\n$ iga-run --version\niga-solve ...\n```", "does not print"),
        ("```toml\n[post]\nsamples = 3\n```", "no case above"),
        ("<!-- into: examples/stack/case.toml -->\n```toml\n[post]\nsample = 3\n```", 'unknown key "sample"'),
        ('<!-- into: examples/stack/case.toml -->\n```toml\n[[solve.load]]\non = "no"\npressure = 1\n```', "no face"),
        ("```fortran\nend\n```", "nothing tells whether it is true"),
        ("<!-- drawn: stress.png -->\n![Stress](pictures/stress.png)", "was not drawn"),
    ],
)
def test_a_page_that_says_what_is_not_so_is_found(block, complaint, tmp_path):
    with pytest.raises(pages.PageError, match=complaint):
        pages.follow(written(tmp_path, f"# Page\n\n{block}\n"), tmp_path)


def test_a_block_may_leave_out_what_it_does_not_want_to_show(tmp_path):
    text = "```python\nprint('one\\ntwo 2.5 s\\nthree')\n```\n\n```text\none\ntwo ... s\n```\n"
    assert "three" in pages.follow(written(tmp_path, text), tmp_path).printed


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site as the command builds it."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", MKDOCS, "-d", folder]
    built = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"NO_MKDOCS_2_WARNING": "true"})
    assert built.returncode == 0, built.stdout + built.stderr
    return folder


def test_the_site_builds_without_a_broken_link_and_loads_nothing_from_the_network(site):
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r'<(?:script|img|iframe)[^>]*\ssrc="?([^"\s>]+)|<link\s[^>]*href="?([^"\s>]+)', text)
        assert not [url for pair in loaded for url in pair if re.match(r"(https?:)?//", url)], page
        assert "arithmatex" not in text, page


def test_no_formula_of_the_site_shows_a_sign_that_only_aligns(site):
    formulas = [
        formula
        for page in site.rglob("*.html")
        for formula in re.findall("<math.*?</math>", page.read_text(encoding="utf-8"), re.DOTALL)
    ]
    assert len(formulas) > 100
    assert not [formula for formula in formulas if "&" in unescape(unescape(formula))]


def test_every_page_of_the_navigation_has_a_link_of_its_own(site):
    text = (site / "index.html").read_text(encoding="utf-8")
    shown = {unescape(title.strip()) for title in re.findall(r'md-ellipsis">([^<]*)<', text)}
    titles = re.findall(r"^ +- (.+): \S+\.md$", MKDOCS.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(titles) > 40
    assert not {title.strip('"') for title in titles} - shown


def test_every_page_of_the_site_is_in_the_search_index(site):
    index = (site / "search" / "search_index.json").read_text(encoding="utf-8")
    assert (site / "search" / "search_index.js").is_file()
    for page in (GUIDE / "docs").rglob("*.md"):
        assert page.relative_to(GUIDE / "docs").with_suffix(".html").as_posix() in index


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None and not os.environ.get("CI"), reason="needs Chromium")
def test_the_site_opens_and_searches_from_a_disk_without_a_network(site):
    requests, errors = [], []
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        context = browser.new_context()
        context.set_offline(True)
        page = context.new_page()
        page.on("request", lambda request: requests.append(request.url))
        page.on("console", lambda message: errors.append(message.text) if message.type != "log" else None)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(f"file://{site}/tutorial/geometry-to-pressure.html")
        page.keyboard.press("s")
        page.keyboard.type("penalty")
        page.locator(".md-search-result__link").first.wait_for()
        assert "matching documents" in page.locator(".md-search-result__meta").inner_text()
        assert page.locator("math").count() > 20
        browser.close()
    assert not errors
    assert all(url.startswith(("file:", "data:", "blob:")) for url in requests)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None and not os.environ.get("CI"), reason="needs Chromium")
def test_what_is_too_wide_for_a_page_scrolls_by_itself(site):
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 400, "height": 900})
        for name in ("theory/contact", "tutorial/hertz", "how-to/large-problems"):
            page.goto(f"file://{site}/{name}.html")
            wide = page.evaluate(
                "[...document.querySelectorAll('pre > code, math[display=block]')]"
                ".filter(each => each.scrollWidth > each.clientWidth).map(each => getComputedStyle(each).overflowX)"
            )
            assert set(wide) == {"auto"}, name
            assert page.evaluate("document.documentElement.scrollWidth") == 400, name
        browser.close()
