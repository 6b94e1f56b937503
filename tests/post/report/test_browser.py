"""The report in a real browser, without a network."""

import io
import json
import os
import shutil
from collections import Counter
from types import SimpleNamespace

import matplotlib.image
import numpy as np
import pytest
from playwright.sync_api import sync_playwright

from tests.post.report.pages import leaves, page_of, summary_of

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # WebGL without a graphics card
DESKTOP, PHONE = {"width": 1280, "height": 900}, {"width": 360, "height": 740}
LONGEST = 30_000  # milliseconds until the scene is drawn
COLOURS = 50  # at least, of the bodies; the frame around them has a handful

pytestmark = pytest.mark.skipif(CHROMIUM is None and not os.environ.get("CI"), reason="needs Chromium")


@pytest.fixture(scope="module")
def opened(bent, bent_case, tmp_path_factory):
    """The report as opened from a disk, and all that happened meanwhile."""
    assert CHROMIUM, "Chromium is missing: apt install chromium"
    folder = tmp_path_factory.mktemp("browser")
    (folder / "newton.png").write_bytes(_picture())
    summary = summary_of(bent, bent_case, folder / "files")
    page_of(bent, bent_case, summary, folder / "report.html", [folder / "newton.png"])
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        context = browser.new_context(viewport=DESKTOP)
        context.set_offline(True)
        page, requests, errors = context.new_page(), [], []
        page.on("request", lambda request: requests.append(request.url))
        page.on("console", lambda message: errors.append(message.text) if message.type != "log" else None)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(f"file://{folder / 'report.html'}")
        page.locator("iframe").scroll_into_view_if_needed()
        page.frame_locator("iframe").locator("canvas").wait_for(timeout=LONGEST)
        yield SimpleNamespace(page=page, requests=requests, errors=errors, summary=summary)
        browser.close()


def _picture():
    """A small PNG file."""
    content = io.BytesIO()
    matplotlib.image.imsave(content, np.eye(8), format="png")
    return content.getvalue()


def shot(page):
    """What the scene shows, (height, width, 3)."""
    content = page.locator("iframe").screenshot()
    return matplotlib.image.imread(io.BytesIO(content), format="png")[..., :3]


def drawn(page):
    """Wait until the scene shows bodies, and return what it shows."""
    for _ in range(LONGEST // 200):
        image = shot(page)
        if colours(image) >= COLOURS:
            return image
        page.wait_for_timeout(200)
    pytest.fail(f"the scene shows {colours(image)} colours after {LONGEST / 1000:g} s")


def colours(image):
    """How many colours an image has that more than a few pixels share."""
    codes = (255 * image).astype(int) @ np.array([65536, 256, 1])
    return sum(count > 3 for count in Counter(codes.ravel().tolist()).values())


def test_the_scene_shows_bodies_and_turns_when_dragged(opened):
    before = drawn(opened.page)
    box = opened.page.locator("iframe").bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    opened.page.mouse.move(*middle)
    opened.page.mouse.down()
    opened.page.mouse.move(middle[0] + 150, middle[1] + 40, steps=5)
    opened.page.mouse.up()
    opened.page.wait_for_timeout(300)
    after = drawn(opened.page)
    changed = np.abs(after - before).max(axis=2) > 0.1
    assert changed.mean() > 0.05


def test_numbers_on_the_page_are_those_of_the_summary(opened):
    told = opened.page.eval_on_selector_all("data[data-key]", "all => all.map(e => [e.dataset.key, Number(e.value)])")
    expected = dict(leaves(json.loads(json.dumps(opened.summary))))
    assert len(told) > 100
    assert all(expected[key] == value for key, value in told)


def test_pictures_are_decoded_and_the_heading_is_the_title(opened):
    sizes = opened.page.eval_on_selector_all("img", "all => all.map(e => [e.naturalWidth, e.naturalHeight])")
    assert sizes == [[8, 8]]
    assert opened.page.locator("h1").inner_text() == opened.summary["title"]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_ground(opened, scheme):
    opened.page.emulate_media(color_scheme=scheme)
    pairs = opened.page.evaluate(CONTRASTS)
    opened.page.emulate_media(color_scheme="light")
    assert len(pairs) > 100
    weak = {(text, ground) for text, ground in map(tuple, pairs) if contrast(rgb(text), rgb(ground)) < 4.5}
    assert not weak


CONTRASTS = """() => [...document.querySelectorAll("body *")]
    .filter(e => [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim()) && e.offsetParent !== null)
    .map(e => {
        let ground = e;
        while (ground && getComputedStyle(ground).backgroundColor === "rgba(0, 0, 0, 0)") ground = ground.parentElement;
        return [getComputedStyle(e).color, getComputedStyle(ground).backgroundColor];
    })"""


def rgb(text):
    """Red, green and blue, 0 to 1, of a colour as browsers write it."""
    return np.array([float(part) for part in text[text.index("(") + 1 : -1].split(",")[:3]]) / 255


def contrast(first, second):
    """Contrast ratio, Web Content Accessibility Guidelines 2.1."""

    def luminance(colour):
        linear = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
        return linear @ np.array([0.2126, 0.7152, 0.0722])

    low, high = sorted((luminance(first), luminance(second)))
    return (high + 0.05) / (low + 0.05)


def test_a_phone_shows_it_without_scrolling_sideways(opened):
    opened.page.set_viewport_size(PHONE)
    widths = opened.page.evaluate(
        "[document.documentElement.scrollWidth, document.querySelector('iframe').clientWidth]"
    )
    opened.page.set_viewport_size(DESKTOP)
    assert widths[0] <= PHONE["width"]
    assert 0.8 * PHONE["width"] < widths[1] < PHONE["width"]


def test_nothing_was_asked_of_the_network_and_no_error_came_up(opened):
    drawn(opened.page)
    assert opened.errors == []
    assert [url for url in opened.requests if not url.startswith(("file:", "data:", "blob:", "about:"))] == []
    assert [url for url in opened.requests if url.startswith("file:")] == opened.requests[:1]
