"""Pictures of a geometry: patches and knot lines, named faces, control net."""

from collections.abc import Sequence
from itertools import chain
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from geom2iga.bspline import Array
from geom2iga.model import Model
from geom2iga.picture import scene
from geom2iga.picture.labels import Anchor, Region, find_anchors, regions
from geom2iga.picture.scene import ABOVE, Camera, Layer
from geom2iga.picture.sheet import Label, View, draw_page, wrapped
from geom2iga.picture.skin import Skin, moved_apart, outer_faces, sample_skin
from geom2iga.signals import uninterrupted

BELOW = tuple(-x for x in ABOVE)  # shows what the view from above hides
VIEWS = ((ABOVE, "from the front, right and above"), (BELOW, "from the back, left and below"))
ROOM = (1200, 900)  # of a single view [pixels]
HALF = (820, 760)  # of each of two views [pixels]
FAINT = "#d6e4f2"
UNNAMED = "#dddddd"
LIGHT = {"ambient": 0.62, "diffuse": 0.42, "specular": 0.0}
OUTLINE = {"color": "black", "line_width": 3.0}
KNOT_LINE = {"color": "#555555", "line_width": 1.2}
NET = "#c0392b"


def draw_geometry(model: Model, folder: Path, unit: str = "") -> list[str]:
    """Write the pictures of a model into a folder.

    Parameters
    ----------
    model : Model
    folder : Path
        Exists.
    unit : str
        Label of the unit of length.

    Returns
    -------
    list of str
        Names of the files.

    Raises
    ------
    UserError
        Libraries for drawing are missing.
    """
    scene.check_renderer("leave out --plot")
    figures = {"geometry.png": draw_patches, "faces.png": draw_faces, "control_net.png": draw_control_net}
    for name, draw in figures.items():
        with uninterrupted():
            scene.save(draw(model, unit), folder / name)
    return list(figures)


def draw_patches(model: Model, unit: str = "") -> Figure:
    """Draw the bodies in colours of their own, outlines of patches thick, knot lines thin."""
    skins = _skins(model)
    colours = dict(zip(model.bodies, _palette(len(model.bodies)), strict=True))
    cells = [colours[model.body_of(skin.face.patch)] for skin in skins]
    layers = [_surface(skins, cells), *_lines(skins, OUTLINE, KNOT_LINE)]
    entries = [(colours[body], f"{body}: {_described(model, body)}") for body in model.bodies]
    title = f"{_count(len(model.bodies), 'body', 'bodies')}, {_count(len(model.patches), 'patch', 'patches')}"
    camera = _camera(skins, ABOVE, ROOM)
    return draw_page([View(scene.seen(layers, camera), camera)], title, entries, _size(model, unit))


def draw_control_net(model: Model, unit: str = "") -> Figure:
    """Draw the control points of the outer faces, joined to a net, around their faint surfaces."""
    apart, remark = _apart(model)
    skins = _skins(apart)
    nets = [apart.surface(skin.face).control_points for skin in skins]
    points = np.concatenate([points.reshape(-1, 3) for points in nets])
    camera = scene.aimed(np.concatenate([points, _points(skins)]), ABOVE, ROOM)
    lines = [line for points in nets for line in chain(points, points.swapaxes(0, 1))]
    room = np.median(np.concatenate([np.linalg.norm(np.diff(camera.pixels(line), axis=0), axis=1) for line in lines]))
    layers = [
        _surface(skins, [FAINT] * len(skins), opacity=0.6),
        *_lines(skins, {"color": "#777777", "line_width": 2.0}, {"color": "#aaaaaa", "line_width": 1.0}),
        Layer(scene.polylines(lines), {"color": NET, "line_width": min(1.5, 0.1 * room)}),
        Layer(scene.dots(points), {"color": NET, "point_size": min(9, 0.4 * room), "render_points_as_spheres": True}),
    ]
    count = sum(prod(patch.shape) for patch in model.patches.values())
    entries = [(NET, "control points and net of the outer faces"), (FAINT, "surface with its knot lines")]
    title = f"Control net, {_count(count, 'control point', 'control points')}{remark}"
    return draw_page([View(scene.seen(layers, camera), camera)], title, entries, _size(model, unit))


def draw_faces(model: Model, unit: str = "") -> Figure:
    """Draw the outer faces in one colour for each set of names, from two opposite sides, labelled with the names."""
    apart, remark = _apart(model)
    skins, named = _skins(apart), regions(apart)
    number = {face: k for k, region in enumerate(named) for face in region.faces}
    owners = np.array([number.get(skin.face, len(named)) for skin in skins])
    colours = [*_palette(len(named)), UNNAMED]
    surface = _surface(skins, [colours[owner] for owner in owners])
    cells = np.repeat(owners, [len(skin.cells) for skin in skins])
    cameras = [_camera(skins, direction, HALF) for direction, _ in VIEWS]
    masks = [scene.seen_numbers(surface.mesh, cells, camera) for camera in cameras]
    samples = [np.concatenate([sample_skin(apart, f).points.reshape(-1, 3) for f in r.faces]) for r in named]
    layers = [surface, *_lines(skins, {"color": "#333333", "line_width": 2.0}, {"color": "#999999", "line_width": 1.0})]
    views = [
        View(scene.seen(layers, camera), camera, caption, _labels(anchors, named, colours))
        for camera, (_, caption), anchors in zip(cameras, VIEWS, find_anchors(samples, cameras, masks), strict=True)
    ]
    entries = [(colour, f"{r.text}: {_faces(len(r.faces))}") for colour, r in zip(colours, named, strict=False)]
    bare = int((owners == len(named)).sum())
    entries += [(UNNAMED, f"without a name: {_faces(bare)}")] if bare else []
    hidden = not all(label.seen for view in views for label in view.labels)
    note = "; dashed lines lead to faces that others hide" if hidden else ""
    return draw_page(views, f"Named faces{remark}", entries, _size(model, unit) + note)


def _labels(anchors: Sequence[Anchor], named: Sequence[Region], colours: Sequence[Any]) -> list[Label]:
    return [Label(wrapped(named[a.region].text), colours[a.region], a.point, a.seen) for a in anchors]


def _skins(model: Model) -> list[Skin]:
    return [sample_skin(model, face) for face in outer_faces(model)]


def _apart(model: Model) -> tuple[Model, str]:
    """Move several bodies apart, and say so."""
    return (moved_apart(model), "; bodies drawn apart") if len(model.bodies) > 1 else (model, "")


def _points(skins: Sequence[Skin]) -> Array:
    return np.concatenate([skin.points.reshape(-1, 3) for skin in skins])


def _camera(skins: Sequence[Skin], direction: Sequence[float], room: tuple[int, int]) -> Camera:
    return scene.aimed(_points(skins), direction, room)


def _surface(skins: Sequence[Skin], colours: Sequence[Any], **style: Any) -> Layer:
    """Faces, each in one colour."""
    starts = np.cumsum([0, *(skin.points[..., 0].size for skin in skins[:-1])])
    cells = [skin.cells + start for skin, start in zip(skins, starts, strict=True)]
    painted = np.repeat([_bytes(colour) for colour in colours], [len(c) for c in cells], axis=0)
    mesh = scene.quadrilaterals(_points(skins), np.concatenate(cells), colour=painted)
    normals = np.concatenate([skin.normals.reshape(-1, 3) for skin in skins])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    mesh.point_data.active_normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    return Layer(mesh, {"scalars": "colour", "rgb": True, **LIGHT, **style})


def _lines(skins: Sequence[Skin], outline: dict[str, Any], knot_line: dict[str, Any]) -> list[Layer]:
    """Knot lines of faces, then their borders over them."""
    layers = []
    for borders, style in ((False, knot_line), (True, outline)):
        lines = [line for skin in skins for line in skin.lines(borders)]
        layers += [Layer(scene.polylines(lines), style)] if lines else []
    return layers


def _palette(count: int) -> list[Any]:
    """Light colours, 18 different ones; grey stays for faces without a name."""
    tones = [tone for tone in colormaps["tab20"].colors if np.ptp(tone) > 0]  # type: ignore[attr-defined]
    light = [1 - (1 - np.array(tone)) * 0.55 for tone in (*tones[::2], *tones[1::2])]
    return [light[k % len(light)] for k in range(count)]


def _bytes(colour: Any) -> Array:
    return np.round(np.array(to_rgb(colour)) * 255).astype(np.uint8)


def _described(model: Model, body: str) -> str:
    """Say what a body consists of."""
    patches = [model.patches[name] for name in model.bodies[body]]
    degrees = " or ".join(dict.fromkeys(" x ".join(map(str, patch.degrees)) for patch in patches))
    spans = sum(prod(len(at) - 1 for at in patch.breaks) for patch in patches)
    return f"{_count(len(patches), 'patch', 'patches')}, degree {degrees}, {_count(spans, 'span', 'spans')}"


def _size(model: Model, unit: str) -> str:
    """Say how large a model is along x, y and z."""
    extent = np.ptp(_points(_skins(model)), axis=0)
    return f"size {' x '.join(f'{e:.4g}' for e in extent)} {unit}".rstrip()


def _faces(count: int) -> str:
    return _count(count, "face", "faces")


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"
