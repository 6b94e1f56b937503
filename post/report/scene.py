"""The deformed bodies, coloured by von Mises stress, to be turned in the browser."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pyvista
from matplotlib.colors import to_hex

from geom2iga.bspline import Array, Indices
from geom2iga.patch import Face
from geom2iga.picture.scene import ABOVE, check_renderer, polylines, quadrilaterals
from geom2iga.picture.skin import outer_faces
from post.fields import Samples
from post.grid import Line, face_grid
from post.plots.deformation import stress_of
from post.plots.style import Scale, scale_of
from post.report.viewer import viewer_page

MOST = 40_000  # quadrilaterals
FINEST = 9  # samples per span and direction
DENSEST = 48  # spans along a face, beyond which knot lines would blacken it
STOPS = 11  # colours of the bar, between which it is filled
AXES = ("#c1272d", "#2e7d32", "#1f4e9e")  # colours of the arrows along x, y and z
ARROW = 0.12  # length of the arrows along the axes, in sizes of the scene


class Scene(NamedTuple):
    """A page that shows the bodies, and what its colours mean."""

    page: str
    low: float  # von Mises stress of the first colour
    high: float  # and of the last
    colours: tuple[str, ...]  # between them at equal distances
    remark: str  # on a field that is uniform


class Piece(NamedTuple):
    """Sample points of a face at their deformed place."""

    points: Array  # (n_1, n_2, 3)
    field: Array  # (n_1, n_2)
    cells: Indices  # (c, 4)
    knots: tuple[Indices, Indices]  # which rows and which columns are drawn as lines


def draw_scene(samples: Samples, scale: float) -> Scene:
    """Draw the outer faces with their knot lines, displacements multiplied by a scale."""
    check_renderer("set report = false in [post]")
    pieces = sample_pieces(samples, scale)
    field = np.concatenate([piece.field.ravel() for piece in pieces])
    colours = scale_of(field, max(float(np.nanmax(field)), stress_of(samples.result)), signed=False)
    plotter = _plotter(pieces, colours)
    page = viewer_page(plotter)
    plotter.close()
    stops = tuple(to_hex(colour) for colour in colours.colours(np.linspace(0, 1, STOPS)))
    return Scene(page, *colours.limits, stops, colours.remark)


def sample_pieces(samples: Samples, scale: float) -> list[Piece]:
    """Sample all outer faces, so finely that they look smooth and so coarsely that the page stays small."""
    result = samples.result
    faces = outer_faces(result.model)
    spans = sum(np.prod([len(at) - 1 for at in result.model.surface(face).breaks]) for face in faces)
    count = int(np.clip(1 + (MOST / spans) ** 0.5, 2, FINEST))
    step = int(np.ceil((spans / MOST) ** 0.5))
    taken = samples if samples.count == count else Samples(result, count)
    return [_piece(taken, face, scale, step) for face in faces]


def _piece(samples: Samples, face: Face, scale: float, step: int) -> Piece:
    """Sample a face; a step larger than one leaves out knot lines between."""
    lines = face_grid(samples.result.model.patches[face.patch], face, samples.count).lines
    first, second = (lines[axis] for axis in face.axes)
    part = samples.face(face)
    shape = (len(first.rule.points), len(second.rule.points))
    rows, columns = _kept(first, step), _kept(second, step)
    chosen = np.ix_(rows, columns)
    numbers = np.arange(len(rows) * len(columns)).reshape(len(rows), len(columns))
    begins = np.ix_(_starts(first, rows), _starts(second, columns))
    corner = numbers[begins].reshape(-1, 1)
    return Piece(
        (part.points + scale * part.displacement).reshape(*shape, 3)[chosen],
        part.von_mises.reshape(shape)[chosen],
        corner + np.array([0, len(columns), len(columns) + 1, 1]),
        (_drawn(first, rows), _drawn(second, columns)),
    )


def _kept(line: Line, step: int) -> Indices:
    """Which points of a direction are shown: all, or those on every so many-th knot line and the last."""
    if step == 1:
        return np.arange(len(line.rule.points))
    return np.unique(np.append(line.knots[:-1:step], line.knots[-1]))


def _starts(line: Line, kept: Indices) -> Indices:
    """Which of the points kept a cell begins at; it ends at the next."""
    return np.flatnonzero(np.isin(kept[:-1], line.starts))


def _drawn(line: Line, kept: Indices) -> Indices:
    """Which of the points kept lie on knot lines, on the borders alone where these are dense."""
    knots = np.flatnonzero(np.isin(kept, line.knots))
    return knots if len(knots) <= DENSEST + 1 else knots[[0, -1]]


def _plotter(pieces: Sequence[Piece], colours: Scale) -> pyvista.Plotter:
    """Put the faces, their knot lines and the axes into a scene, which nobody looks at here."""
    everything = np.concatenate([piece.points.reshape(-1, 3) for piece in pieces])
    low, high = everything.min(axis=0), everything.max(axis=0)
    points = (everything - (low + high) / 2).astype(np.float32)  # single precision is fine near the origin
    starts = np.cumsum([0, *(piece.field.size for piece in pieces[:-1])])
    cells = np.concatenate([piece.cells + start for piece, start in zip(pieces, starts, strict=True)])
    field = np.concatenate([piece.field.ravel() for piece in pieces]).astype(np.float32)
    surface = quadrilaterals(points, cells, von_mises=field)
    surface.compute_normals(
        cell_normals=False, split_vertices=False, consistent_normals=False, non_manifold_traversal=False, inplace=True
    )
    plotter = pyvista.Plotter(off_screen=True, lighting="none")
    plotter.set_background("white")
    light = {"ambient": 0.8, "diffuse": 0.2, "specular": 0.0}  # near the colours of the bar, yet edges show
    style = {"scalars": "von_mises", "cmap": colours.colours, "clim": colours.limits, "show_scalar_bar": False}
    bodies = plotter.add_mesh(surface, **style, **light)
    bodies.mapper.SetResolveCoincidentTopologyToPolygonOffset()  # lines lie in front of the faces
    plotter.add_mesh(_knot_lines(pieces, (low + high) / 2), color="black", line_width=1, lighting=False)
    size = float((high - low).max())
    for axis, colour in enumerate(AXES):
        arrow = pyvista.Arrow(
            start=(low - high) / 2 - 0.5 * ARROW * size, direction=np.eye(3)[axis], scale=ARROW * size
        )
        plotter.add_mesh(arrow, color=colour, ambient=0.5, diffuse=0.5)
    plotter.camera_position = [ABOVE, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]
    plotter.reset_camera()
    return plotter


def _knot_lines(pieces: Sequence[Piece], centre: Array) -> pyvista.PolyData:
    """The knot lines of all faces, each once as a polyline."""
    families = [
        family
        for piece in pieces
        for family in (piece.points[piece.knots[0]], piece.points.swapaxes(0, 1)[piece.knots[1]])
    ]
    return polylines([(line - centre).astype(np.float32) for family in families for line in family])
