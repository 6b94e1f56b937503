"""Contact patch tests on curved faces that fit: pressed all around, every body has that pressure inside.

The closed form has no overlap, so the contact has a multiplier.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

import geom2iga
from geom2iga.patch import evaluate, refined
from solve.face import area_vectors, surface_of
from tests.cases import block_patch, converged, largest_stress_error, model_of

EXAMPLES = Path(__file__).parents[2] / "examples"
TOLERANCE = 1e-9
YOUNG, POISSON = 1000.0, 0.3
SHRINKAGE = (1 - 2 * POISSON) / YOUNG  # strain under a pressure of 1
WAYS = [
    {"enforcement": "lagrange"},
    {"enforcement": "augmented-lagrange"},
    {"enforcement": "lagrange", "multiplier": "p-2"},
]
ENFORCEMENTS = pytest.mark.parametrize("way", WAYS, ids=["lagrange", "augmented", "p-2"])
SLOW = pytest.mark.slow


def on_paraboloid(name, origin, size, degree, spans, angle, bottom):
    """A block, turned about z, one of whose faces lies on z = (x² + y²) / 4: its bottom, or its top."""
    turn = Rotation.from_euler("z", angle, degrees=True)
    coarse = block_patch(name, (*origin, 0), (*size, 1), degree, (1, 1, spans[2]), turn)
    nodes = np.linspace(0, 1, degree + 1)
    at = np.stack(np.meshgrid(nodes, nodes, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    x, y, _ = evaluate(coarse, at)[0].T
    inverse = np.linalg.inv(BSpline.design_matrix(nodes, coarse.knots[0], degree).toarray())
    curved = (inverse @ ((x**2 + y**2) / 4).reshape(degree + 1, degree + 1) @ inverse.T)[:, :, None]
    points = np.array(coarse.control_points)
    below, above = (curved, 1.0) if bottom else (-1.0, curved)
    points[..., 2] = below + (above - below) * points[..., 2]
    cuts = [np.arange(1, count) / count for count in spans[:2]]
    return refined(replace(coarse, control_points=points), knots=[*cuts, []])


def sides(model, body):
    """Names, places and outward normals of the four upright sides of a block, and of its top and bottom."""
    for side in ("left", "right", "front", "back", "bottom", "top"):
        surface = surface_of(model, model.faces(f"{body}/{side}")[0])
        point, normal, _ = area_vectors(surface, np.array([[0.5, 0.5]]))
        yield side, point[0], normal[0]


def squeezed(model, contact, curved):
    """Press all sides with 1; three of the lower body and two of the upper move as the uniform strain has it."""
    supports, loads = [], []
    for body in model.bodies:
        for side, point, normal in sides(model, body):
            name = f"{body}/{side}"
            if name in curved:
                loads.append({"on": name, "pressure": 1.0, "exposed": True})
            elif side in ("left", "front", "bottom"):
                supports.append({"on": name, "normal": float(-SHRINKAGE * point @ normal)})
            else:
                loads.append({"on": name, "pressure": 1.0})
    tables = {"material": [{"young": YOUNG, "poisson": POISSON}], "support": supports, "load": loads}
    return {"solve": {**tables, "contact": [contact]}}


def assert_uniform(result, stress):
    """The stress is uniform, and so is the pressure, but for control points with hardly any area."""
    assert largest_stress_error(result, stress) < TOLERANCE
    (contact,) = result.contacts
    area = contact.control_area / contact.control_area.max()
    np.testing.assert_allclose(area * contact.pressure, area, rtol=0, atol=1e-7)
    assert result.statistics["equilibrium_error"] < TOLERANCE


@ENFORCEMENTS
@pytest.mark.parametrize("swap", [False, True], ids=["upper secondary", "lower secondary"])
@pytest.mark.parametrize("angle", [17.0, pytest.param(0.0, marks=SLOW), pytest.param(45.0, marks=SLOW)])
@pytest.mark.parametrize("degree", [2, pytest.param(3, marks=SLOW)])
def test_blocks_that_fit_on_a_paraboloid_have_uniform_stress_however_knot_lines_cross(degree, angle, swap, way):
    lower = on_paraboloid("lower", (-1, -1), (2, 2), degree, (3, 4, 1), 0.0, bottom=False)
    upper = on_paraboloid("upper", (-0.5, -0.4), (1.1, 0.9), degree, (3, 2, 1), angle, bottom=True)
    model = model_of(lower, upper)
    pair = ("lower/top", "upper/bottom") if swap else ("upper/bottom", "lower/top")
    case = squeezed(model, {"secondary": pair[0], "primary": pair[1], **way}, pair)
    assert_uniform(converged(model, case), [-1, -1, -1, 0, 0, 0])


@ENFORCEMENTS
@pytest.mark.parametrize("swap", [False, True], ids=["inner secondary", "outer secondary"])
@pytest.mark.parametrize("degree", [2, 3])
def test_rings_that_fit_have_uniform_stress(degree, swap, way):
    case = geom2iga.read_case(EXAMPLES / "lame_rings" / "case.toml")
    pair = ("outer/inner", "inner/outer") if swap else ("inner/outer", "outer/inner")
    varied = case.changed(
        {
            "geometry.degree": degree,
            "geometry.pipe.0.spans": [2, 4, 1],
            "geometry.pipe.1.spans": [2, 3, 1],
            "solve.material": [{"young": YOUNG, "poisson": POISSON}],
            "solve.load": [{"on": on, "pressure": 1.0} for on in ("inner/inner", "outer/outer")],
            "solve.contact": [{"secondary": pair[0], "primary": pair[1], **way}],
        }
    )
    assert_uniform(converged(geom2iga.build(varied), varied), [-1, -1, -2 * POISSON, 0, 0, 0])


@pytest.mark.parametrize("swap", [False, True], ids=["inner secondary", "outer secondary"])
def test_spheres_that_fit_have_uniform_stress(swap):
    case = geom2iga.read_case(EXAMPLES / "lame_spheres" / "case.toml")
    pair = ("outer-interface", "inner-interface") if swap else ("inner-interface", "outer-interface")
    (cad,) = case.tables["geometry"]["cad"]
    varied = case.changed(
        {
            "geometry.cad.0.faces": [*cad["faces"], {"name": "outside", "sphere": 40.0}],
            "geometry.cad.0.bodies.0.spans": [3, 2, 1],
            "geometry.cad.0.bodies.1.spans": [2, 2, 1],
            "solve.material": [{"young": YOUNG, "poisson": POISSON}],
            "solve.load": [{"on": on, "pressure": 1.0} for on in ("hole", "outside")],
            "solve.contact": [{"secondary": pair[0], "primary": pair[1], "enforcement": "lagrange"}],
        }
    )
    assert_uniform(converged(geom2iga.build(varied), varied), [-1, -1, -1, 0, 0, 0])
