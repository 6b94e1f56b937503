from post import plots
from tests.test_examples import EXAMPLES, script


def test_the_gallery_has_a_picture_by_every_function():
    commands = [entry.command for entry in script(EXAMPLES / "gallery.py").entries()]
    for name in (name for name in plots.__all__ if name.startswith("draw_")):
        assert any(command.startswith(f"plots.{name}(") for command in commands), name


def test_the_page_of_the_gallery_shows_every_picture():
    gallery = script(EXAMPLES / "gallery.py")
    page = (gallery.FOLDER / "gallery.md").read_text(encoding="utf-8")
    for entry in gallery.entries():
        assert f"({entry.name}.png)" in page
        assert entry.command in page
        assert (gallery.FOLDER / f"{entry.name}.png").stat().st_size < 300_000
