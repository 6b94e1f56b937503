"""What a case asks to see: whether it can be shown."""

from collections.abc import Sequence

import numpy as np

from geom2iga.bspline import Array
from geom2iga.errors import CaseError
from geom2iga.model import Model
from post.case import Cut, Picture, PostCase
from post.probes import check_probes
from post.verify import check_names
from solve.case import Contact
from solve.material import named_bodies


def check_wanted(model: Model, contacts: Sequence[Contact], case: PostCase) -> None:
    """Raise CaseError for a check, a picture or a probe of something that the model does not have."""
    check_names(model, contacts, case.verify)
    check_probes(model, case)
    for number, picture in enumerate(case.post.picture):
        _check_picture(model, picture, f"post.picture[{number}]")


def _check_picture(model: Model, picture: Picture, key: str) -> None:
    """Raise CaseError where a body does not exist, or a cut leaves nothing of those drawn."""
    bodies = named_bodies(model, picture.bodies, f"{key}.bodies")
    if picture.cut is None:
        return
    patches = [model.patches[name] for body in bodies for name in model.bodies[body]]
    points = np.concatenate([patch.control_points.reshape(-1, 3) for patch in patches])
    if (picture.cut.heights(points) >= 0).all():
        raise CaseError(f"{key}.{nothing_behind(picture.cut, points)}")


def nothing_behind(cut: Cut, points: Array) -> str:
    """Say that a plane leaves nothing of bodies to draw, whose points (q, 3) all lie in front of it."""
    low, high = (", ".join(f"{x:.6g}" for x in end) for end in (points.min(axis=0), points.max(axis=0)))
    return (
        f"cut: nothing lies behind the plane through {list(cut.origin)} with normal {list(cut.normal)}, the bodies "
        f"drawn lie within [{low}] to [{high}]: move its origin, or turn its normal round"
    )
