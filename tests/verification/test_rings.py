"""Tubes under pressure in plane strain, whose closed form is Lamé's (Timoshenko & Goodier, sec. 28)."""

import numpy as np
import pytest

from geom2iga.patch import elevated, evaluate, refined
from solve.space import gauss_points
from tests.cases import converged, displacement_at, hollow_cylinder, model_of, stress_at
from tests.oracles import assert_order

YOUNG, POISSON, PRESSURE = 1000.0, 0.3, 10.0


def radial_displacement(radius, inner, outer, inside, outside):
    """Displacement of a tube between two radii under pressures inside and outside."""
    ring = outer**2 - inner**2
    swelling = (1 - 2 * POISSON) * (inside * inner**2 - outside * outer**2) / ring * radius
    return (1 + POISSON) / YOUNG * (swelling + (inside - outside) * inner**2 * outer**2 / ring / radius)


def radial_and_hoop_stress(radius, inner, outer, inside, outside):
    ring = outer**2 - inner**2
    mean = (inside * inner**2 - outside * outer**2) / ring
    swing = (inside - outside) * inner**2 * outer**2 / ring / radius**2
    return mean - swing, mean + swing


def interface_pressure(inner, middle, outer, overlap):
    """Pressure between two tubes of one material, the inner one under pressure, whose overlap is a share of it."""
    p = np.array([0.0, 1.0])
    difference = radial_displacement(middle, inner, middle, PRESSURE, p)
    difference = difference - radial_displacement(middle, middle, outer, p, 0.0) - overlap * p
    return difference[0] / (difference[0] - difference[1])


def tube(name, inner, outer, degree, spans):
    """A quarter of a tube of height 1, one span high."""
    patch = elevated(hollow_cylinder(inner, outer, 1.0, name), (degree, degree, 1))
    cuts = np.arange(1, spans) / spans
    return refined(patch, knots=(cuts, cuts, []))


def tube_case(names, **contact):
    case = {
        "material": [{"young": YOUNG, "poisson": POISSON}],
        "support": [{"on": f"{n}/{side}", "normal": 0.0} for n in names for side in ("front", "back", "bottom", "top")],
        "load": [{"on": f"{names[0]}/left", "pressure": PRESSURE}],
    }
    if contact:
        case["contact"] = [{"secondary": f"{names[0]}/right", "primary": f"{names[1]}/left", **contact}]
    return {"solve": case}


def errors_of(result, name, inner, outer, inside, outside):
    """Errors of displacement and stress in L2, relative."""
    patch = result.model.patches[name]
    points = gauss_points(patch)
    position, jacobian = evaluate(patch, points.xi, 1)
    volume = points.weights * np.linalg.det(jacobian)
    radius = np.linalg.norm(position[:, :2], axis=1)
    outward = position * [1, 1, 0] / radius[:, None]
    along = displacement_at(result, name, points.xi)
    exact = radial_displacement(radius, inner, outer, inside, outside)[:, None] * outward
    xx, yy, _, xy, _, _ = stress_at(result, name, points.xi).T
    x, y = outward[:, 0], outward[:, 1]
    found = np.array([xx * x**2 + yy * y**2 + 2 * xy * x * y, xx * y**2 + yy * x**2 - 2 * xy * x * y])
    wanted = np.array(radial_and_hoop_stress(radius, inner, outer, inside, outside))
    return np.sqrt(
        [
            volume @ np.sum((along - exact) ** 2, axis=1) / (volume @ np.sum(exact**2, axis=1)),
            np.sum((found - wanted) ** 2 @ volume) / np.sum(wanted**2 @ volume),
        ]
    )


@pytest.mark.parametrize(("degree", "spans"), [(2, (4, 8)), (3, (4, 8))])
def test_a_tube_approaches_lame_with_order_p_plus_1_in_displacement_and_p_in_stress(degree, spans):
    errors = []
    for count in spans:
        result = converged(model_of(tube("tube", 1.0, 2.0, degree, count)), tube_case(["tube"]))
        errors.append(errors_of(result, "tube", 1.0, 2.0, PRESSURE, 0.0))
    sizes = [1 / count for count in spans]
    assert_order([e[0] for e in errors], sizes, degree + 1, tolerance=0.3)
    assert_order([e[1] for e in errors], sizes, degree, tolerance=0.3)
    assert errors[-1][0] < 1e-4


def two_tubes(degree, inner_spans, outer_spans, penalty, swap=False):
    """A tube in a tube that fits: the result, and the errors in L2 of both together."""
    tubes = tube("inner", 1.0, 2.0, degree, inner_spans), tube("outer", 2.0, 3.0, degree, outer_spans)
    case = tube_case(["inner", "outer"], integration="element", penalty=penalty)
    if swap:
        contact = case["solve"]["contact"][0]
        contact["secondary"], contact["primary"] = contact["primary"], contact["secondary"]
    result = converged(model_of(*tubes), case)
    pressure = interface_pressure(1.0, 2.0, 3.0, 1 / penalty)
    inner = errors_of(result, "inner", 1.0, 2.0, PRESSURE, pressure)
    return result, np.maximum(inner, errors_of(result, "outer", 2.0, 3.0, pressure, 0.0))


@pytest.mark.parametrize("degree", [2, 3])
def test_two_tubes_in_contact_approach_lame_with_the_orders_of_one(degree):
    """The closed form has the compliance of the penalty in it, so that the penalty adds no error."""
    spans = (4, 8)
    errors = [two_tubes(degree, count, count, 1e4)[1] for count in spans]
    sizes = [1 / count for count in spans]
    assert_order([e[0] for e in errors], sizes, degree + 1, tolerance=0.3)
    assert_order([e[1] for e in errors], sizes, degree, tolerance=0.3)


@pytest.mark.parametrize("swap", [False, True], ids=["inner secondary", "outer secondary"])
@pytest.mark.parametrize(("degree", "within"), [(2, 1e-2), (3, 2e-3)])
def test_the_pressure_between_tubes_is_lames_whatever_their_knot_lines(degree, within, swap):
    result, errors = two_tubes(degree, 8, 9, 1e5, swap)
    pressure = interface_pressure(1.0, 2.0, 3.0, 1e-5)
    np.testing.assert_allclose(result.contacts[0].pressure, pressure, rtol=within)
    assert errors[0] < 1e-4
    assert errors[1] < 5e-3
