import pytest
from scipy.spatial.transform import Rotation

from geom2iga.errors import CaseError
from geom2iga.limits import limited
from solve.case import Contact
from solve.contact.cells import find_cells
from solve.size import check_contact, check_points, quadrature_points
from tests.cases import block_patch, model_of


def blocks(degree=1, spans=8, turn=None):
    """A block on another one, its knot lines turned against the other's."""
    lower = block_patch("lower", (-1, -1, -1), (2, 2, 1), degree, (2 * spans, 2 * spans, 1))
    upper = block_patch("upper", (-0.5, -0.5, 0), (1, 1, 1), degree, (spans + 3, spans + 2, 1), turn)
    return model_of(lower, upper)


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("angle", [0, 20])
@pytest.mark.parametrize("keys", [{}, {"two_pass": True}, {"integration": "element"}])
def test_quadrature_points_of_plane_faces_are_estimated_within_a_factor_of_two(degree, angle, keys):
    contact = Contact(secondary="upper/bottom", primary="lower/top", **keys)
    model = blocks(degree, turn=Rotation.from_euler("z", angle, degrees=True))
    found = sum(len(part.area) for part in find_cells(model, contact)) * (2 if contact.two_pass else 1)
    assert found / 2 < quadrature_points(model, contact)[0] < 2 * found


def test_what_does_not_fit_is_refused_before_it_is_searched_or_numbered():
    contact = Contact(secondary="upper/bottom", primary="lower/top")
    model = blocks(spans=60)
    with limited(memory=5e9):
        check_contact(model, contact)
        check_points(model)
    with limited(memory=1e12), pytest.raises(CaseError, match=r"quadrature points need about .* take fewer spans"):
        check_contact(model, contact.model_copy(update={"points": 64_000}))
