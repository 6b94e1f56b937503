"""What a case asks to see: whether it can be shown."""

from collections.abc import Sequence

import numpy as np

from geom2iga.errors import CaseError, suggestion
from geom2iga.model import Model
from post.case import Picture, PostCase
from post.probes import check_probes
from post.verify import check_names
from solve.case import Contact


def check_wanted(model: Model, contacts: Sequence[Contact], case: PostCase) -> None:
    """Raise CaseError for a check, a picture or a probe of something that the model does not have."""
    check_names(model, contacts, case.verify)
    check_probes(model, case)
    for number, picture in enumerate(case.post.picture):
        _check_picture(model, picture, f"post.picture[{number}]")


def _check_picture(model: Model, picture: Picture, key: str) -> None:
    """Raise CaseError where a body does not exist, or a cut leaves nothing of those drawn."""
    bodies = model.bodies if picture.bodies is None else picture.bodies
    for body in bodies:
        if body not in model.bodies:
            raise CaseError(f'{key}.bodies: there is no body "{body}"; {suggestion(body, model.bodies)}')
    if picture.cut is None:
        return
    patches = [model.patches[name] for body in bodies for name in model.bodies[body]]
    points = np.concatenate([patch.control_points.reshape(-1, 3) for patch in patches])
    if (picture.cut.heights(points) >= 0).all():
        low, high = (", ".join(f"{x:.6g}" for x in end) for end in (points.min(axis=0), points.max(axis=0)))
        raise CaseError(
            f"{key}.cut: nothing lies behind the plane through {list(picture.cut.origin)} with normal "
            f"{list(picture.cut.normal)}, the bodies drawn lie within [{low}] to [{high}]: move its origin, or turn "
            "its normal round"
        )
