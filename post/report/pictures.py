"""Pictures inside the page."""

import base64
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from post.case import Post
from post.quantities import QUANTITIES

TYPES = {".png": "image/png", ".svg": "image/svg+xml"}  # the first that a picture has is shown
CAPTIONS = {
    "displacement": "Vertical displacement on the deformed bodies, with their knot lines",
    "stress": "Vertical stress on the deformed bodies, with their knot lines",
    "contact_pressure": "Contact pressure on the secondary faces",
    "contact_plane": "Contact pressure and gap over the parameters of the secondary faces",
    "load_steps": "Contact forces over the share of the loads",
    "newton": "Residual and active control points over the Newton steps",
}
NUMBERED = re.compile(r"contact_pressure_(\d+)")  # of a single contact


class Picture(NamedTuple):
    """A picture, its file within."""

    name: str
    caption: str
    data: str  # URI


def embedded(paths: Sequence[Path], post: Post) -> Iterator[Picture]:
    """Yield each picture once, in the sequence of the paths; of several formats the one that browsers show best."""
    captions = CAPTIONS | _asked_for(post)
    names = dict.fromkeys(path.stem for path in paths)
    for name in names:
        files = {path.suffix: path for path in paths if path.stem == name}
        for suffix in [each for each in TYPES if each in files][:1]:
            coded = base64.b64encode(files[suffix].read_bytes()).decode()
            caption = captions.get(name) or _other(name)
            yield Picture(name, caption, f"data:{TYPES[suffix]};base64,{coded}")


def _other(name: str) -> str:
    """Caption of a picture that is named by a number, or by its file alone."""
    if found := NUMBERED.fullmatch(name):
        return f"{CAPTIONS['contact_pressure']} of contact {found[1]}"
    return name.replace("_", " ").capitalize()


def _asked_for(post: Post) -> dict[str, str]:
    """Captions of the pictures and lines that the case asks for."""
    captions = {}
    for picture in post.picture:
        bodies = "all bodies" if picture.bodies is None else ", ".join(picture.bodies)
        cut = "" if picture.cut is None else f", cut at ({_numbers(picture.cut.origin)})"
        captions[f"picture_{picture.name}"] = f"{picture.name}: {QUANTITIES[picture.field].title} on {bodies}{cut}"
    for line in post.line:
        ends = f"({_numbers(line.start)}) to ({_numbers(line.end)})"
        captions[f"line_{line.name}"] = f"{line.name}: {QUANTITIES[line.field].title} along the line from {ends}"
    for point in post.point:
        title = QUANTITIES[point.field].title
        captions[f"point_{point.name}"] = f"{point.name}: {title} at ({_numbers(point.at)}) over the load steps"
    return captions


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)
