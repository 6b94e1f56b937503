"""Models whose patches share control points in different ways."""

import numpy as np

from geom2iga.model import Face, Glued, Model
from geom2iga.patch import Patch, refined
from tests.cases import bent_patch, model_of
from tests.verification.glued_bodies import glued_model, star, wall


def closed_ring(name="ring"):
    """A square ring of one patch, glued to itself."""
    corners = np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 0]])
    points = np.array([[[[*(radius * xy), z] for z in (0, 1)] for xy in corners] for radius in (1.0, 2.0)])
    patch = Patch(name, (1, 1, 1), ([0, 0, 1, 1], [0, 0, 1, 2, 3, 4, 4], [0, 0, 1, 1]), points)
    return Model({name: patch}, {name: (name,)}, {}, (Glued(Face(name, 1, 0), Face(name, 1, 1), 0),))


MODELS = {
    "two bodies": lambda: model_of(bent_patch(0, (1, 2, 3), name="first"), bent_patch(1, (2, 1, 1), name="second")),
    "five around an edge": lambda: glued_model({"star": star("star", 5, degree=2)}),
    "eight around a point": lambda: glued_model({"wall": wall("wall", degree=2, spans=((2, 1), (1, 2), (1, 1)))}),
    "closed ring": closed_ring,
    "closed ring of smooth splines": lambda: Model(
        {"ring": refined(closed_ring().patches["ring"], spans=3)}, {"ring": ("ring",)}, {}, closed_ring().glued
    ),
}
