"""Knot lines of faces at their sample points."""

from collections.abc import Sequence

import numpy as np

from geom2iga.bspline import Array
from geom2iga.patch import Face
from post.fields import Samples
from post.grid import face_grid

WIDEST, THINNEST = 2.0, 0.4  # of knot lines [pixels]
DENSITY = 130.0  # that width of knot lines over their distance in sizes of the model: so much is black
Family = tuple[Array, Array]  # points (lines, q, 3) of knot lines, undeformed, and their displacements


def families(samples: Samples, face: Face) -> tuple[Family, Family]:
    """Return the knot lines of a face across its first and its second direction."""
    part = samples.face(face)
    lines = face_grid(samples.result.model.patches[face.patch], face, samples.count).lines
    first, second = (lines[axis] for axis in face.axes)
    points, moved = (each.reshape(len(first.rule.points), -1, 3) for each in (part.points, part.displacement))
    return (
        (points[first.knots], moved[first.knots]),
        (points.swapaxes(0, 1)[second.knots], moved.swapaxes(0, 1)[second.knots]),
    )


def knot_lines(samples: Samples, faces: Sequence[Face], size: float, wanted: bool = True) -> tuple[list[Family], float]:
    """Return knot lines of faces and their width [pixels].

    They are thinner where they are dense; where they would be too dense to see anything else, borders alone are left.

    Parameters
    ----------
    size :
        Of what the picture shows [length].
    wanted : bool
        Whether to draw them; if not, borders alone are left.
    """
    found = [family for face in faces for family in families(samples, face)]
    between = np.median(np.concatenate([np.linalg.norm(np.diff(p, axis=0), axis=2).ravel() for p, _ in found]))
    width = min(WIDEST, DENSITY * between / size)
    if width < THINNEST or not wanted:
        return [borders(family) for family in found], WIDEST
    return found, width


def borders(family: Family) -> Family:
    """Keep the first and the last line."""
    return family[0][[0, -1]], family[1][[0, -1]]
