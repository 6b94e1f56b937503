"""What a case asks to see: whether it can be shown."""

from collections.abc import Sequence

from geom2iga.errors import CaseError, suggestion
from geom2iga.model import Model
from post.case import PostCase
from post.probes import check_probes
from post.verify import check_names
from solve.case import Contact


def check_wanted(model: Model, contacts: Sequence[Contact], case: PostCase) -> None:
    """Raise CaseError for a check, a picture or a probe of something that the model does not have."""
    check_names(model, contacts, case.verify)
    check_probes(model, case)
    for number, picture in enumerate(case.post.picture):
        for body in picture.bodies or ():
            if body not in model.bodies:
                known = suggestion(body, model.bodies)
                raise CaseError(f'post.picture[{number}].bodies: there is no body "{body}"; {known}')
