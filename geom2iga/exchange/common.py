"""What the exchange formats have in common: outer faces by group, numbers of sides, numbers and names as text."""

import io
from collections import defaultdict

import numpy as np
from numpy.typing import ArrayLike

from geom2iga.glue import all_faces
from geom2iga.model import Model
from geom2iga.patch import Face

NO_GROUP = "no group"


def outer_faces(model: Model) -> dict[str, tuple[Face, ...]]:
    """Sort the faces that are not glued by their group.

    The other programs want every outer face exactly once: of several groups that hold a face the first one gets it.

    Returns
    -------
    name to faces
        In the sequence of the model's groups, without empty ones; last, under NO_GROUP, the faces of no group.
    """
    inside = {face for pair in model.glued for face in (pair.first, pair.second)}
    outer = dict.fromkeys(face for face in all_faces(list(model.patches.values())) if face not in inside)
    sorted_faces = defaultdict(list)
    for name, faces in (*model.groups.items(), (NO_GROUP, tuple(outer))):
        for face in faces:
            if face in outer:
                del outer[face]
                sorted_faces[one_line(name)].append(face)
    return {name: tuple(faces) for name, faces in sorted_faces.items()}


def side_number(face: Face) -> int:
    """Number the six sides of a patch from 1 to 6, as G+Smo and GeoPDEs both do."""
    return 2 * face.axis + face.side + 1


def rows(values: ArrayLike) -> str:
    """Write an array (n, k) as n lines, or (n,) as one, with the digits that make each number come back exactly."""
    text = io.StringIO()
    np.savetxt(text, np.atleast_2d(np.asarray(values, dtype=float)), fmt="%.17g")
    return text.getvalue()


def one_line(name: str) -> str:
    r"""Keep a name from breaking a line, or a file.

    >>> one_line("inlet\n of the\x00 pipe ")
    'inlet of the pipe'
    """
    return " ".join("".join(letter if letter.isprintable() else " " for letter in name).split())
