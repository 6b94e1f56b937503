"""The outer surface of a model as sampled for pictures, and its bodies moved apart."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geom2iga.bspline import Array, Indices
from geom2iga.model import Model
from geom2iga.patch import Face, evaluate

INTERVALS = 24  # at least, along each direction of a face
APART = 0.25  # how far bodies are moved from the common centre, in sizes of the model
CENTRAL = 0.01  # a body nearer to the common centre than this, in sizes of the model, stays there if it can
CLEAR = 0.15  # least distance between the boxes of bodies moved apart, in sizes of the model


@dataclass(frozen=True, eq=False)
class Skin:
    """Sample points of a face, its knot lines among them.

    Parameters
    ----------
    face : Face
    points : (n_1, n_2, 3)
        In the sequence of `Face.axes` [length].
    normals : (n_1, n_2, 3)
        Not of unit length; zero where the face is degenerate.
    knots : two arrays
        Which rows and which columns are knot lines.
    """

    face: Face
    points: Array
    normals: Array
    knots: tuple[Indices, Indices]

    @property
    def cells(self) -> Indices:
        """Quadrilaterals (c, 4) between the points in flat numbering."""
        rows, columns = self.points.shape[:2]
        numbers = np.arange(rows * columns).reshape(rows, columns)
        return np.stack([numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:]], axis=-1).reshape(
            -1, 4
        )

    def lines(self, borders: bool) -> Iterator[Array]:
        """Yield the borders, or the knot lines between them, as points (q, 3)."""
        for points, knots in zip((self.points, self.points.swapaxes(0, 1)), self.knots, strict=True):
            yield from points[knots[[0, -1]] if borders else knots[1:-1]]


def outer_faces(model: Model) -> tuple[Face, ...]:
    """List the faces of all patches that are not glued to another."""
    inner = {face for pair in model.glued for face in (pair.first, pair.second)}
    faces = (Face(name, axis, side) for name in model.patches for axis in range(3) for side in (0, 1))
    return tuple(face for face in faces if face not in inner)


def sample_skin(model: Model, face: Face) -> Skin:
    """Sample a face in every span, so closely that its curves look smooth."""
    surface = model.surface(face)
    each, knots = [], []
    for at, degree in zip(surface.breaks, surface.degrees, strict=True):
        intervals = max(min(degree, 2), -(-INTERVALS // (len(at) - 1)))
        fractions = np.arange(intervals) / intervals
        each.append(np.append((at[:-1, None] + np.diff(at)[:, None] * fractions).ravel(), at[-1]))
        knots.append(np.arange(len(at)) * intervals)
    xi = np.stack(np.meshgrid(*each, indexing="ij"), axis=-1)
    points, slopes = evaluate(surface, xi.reshape(-1, 2), 1)
    normals = np.cross(slopes[..., 0], slopes[..., 1])
    shape = (*xi.shape[:2], 3)
    return Skin(face, points.reshape(shape), normals.reshape(shape), (knots[0], knots[1]))


def moved_apart(model: Model) -> Model:
    """Move the bodies of a model away from their common centre, so that faces in contact can be seen.

    Each goes a fixed share of the size of the model along the line between the centres, measured in sizes of the
    model along x, y and z: plates in a pile part along the pile. It goes on while its box and the box of a body placed
    before it are not clear of each other: so part the bodies of which one lies inside the other.
    """
    points = [
        np.concatenate([model.patches[p].control_points.reshape(-1, 3) for p in b]) for b in model.bodies.values()
    ]
    moves = _moves(np.array([[p.min(axis=0), p.max(axis=0)] for p in points]))
    patches = {
        name: replace(model.patches[name], control_points=model.patches[name].control_points + move)
        for move, names in zip(moves, model.bodies.values(), strict=True)
        for name in names
    }
    return replace(model, patches={name: patches[name] for name in model.patches})


def _moves(boxes: Array) -> list[Array]:
    """Moves (3,) of bodies whose boxes (b, 2, 3) hold their lowest and highest coordinates."""
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    size = (high - low).max()
    moves: list[Array] = []
    for box in boxes:
        away = (box.mean(axis=0) - (low + high) / 2) / (high - low)
        distance = np.linalg.norm(away)
        central = distance < CENTRAL
        direction = np.eye(3)[2 - np.argmin((high - low)[::-1])] if central else away / distance
        placed = [other + move for other, move in zip(boxes, moves, strict=False)]
        moves.append(direction * _clear(box, placed, direction, 0.0 if central else APART * size, CLEAR * size))
    return moves


def _clear(box: Array, placed: Sequence[Array], direction: Array, least: float, between: float) -> float:
    """Smallest distance, from `least` on, at which a box has moved clear of others."""
    distance = least
    for enters, leaves in sorted(_meeting(box, other, direction, between) for other in placed):
        if enters < distance < leaves:
            distance = leaves
    return distance


def _meeting(box: Array, other: Array, direction: Array, between: float) -> tuple[float, float]:
    """Distances between which a moving box is nearer to another than `between`; the first is larger where never."""
    ends = np.stack([other[0] - box[1] - between, other[1] - box[0] + between])
    moving = direction != 0
    if np.any(ends[0, ~moving] >= 0) or np.any(ends[1, ~moving] <= 0):
        return np.inf, -np.inf
    times = np.sort(ends[:, moving] / direction[moving], axis=0)
    return float(times[0].max()), float(times[1].min())
