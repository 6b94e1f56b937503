"""The case of the elasticity benchmarks: a block or a quarter of a thick ring, clamped below, under a body force."""

from typing import Any

GEOMETRIES = ("cube", "ring")


def elasticity_case(geometry: str, degree: int, spans: int) -> dict[str, Any]:
    """Unit cube, or quarter annulus of radii 1 and 2 and height 1; all directions have as many spans."""
    body: dict[str, Any] = {"name": "body", "spans": [spans] * 3}
    if geometry == "cube":
        held = {"block": [body | {"size": [1.0, 1.0, 1.0]}]}
    else:
        held = {"pipe": [body | {"inner": 1.0, "outer": 2.0, "height": 1.0, "angle": 90.0}]}
    return {
        "geometry": {"degree": degree, **held},
        "solve": {
            "material": [{"young": 1000.0, "poisson": 0.3}],
            "support": [{"on": "body/bottom", "ux": 0.0, "uy": 0.0, "uz": 0.0}],
            "body_force": [{"force": [1.0, 2.0, -3.0]}],
            "newton": {"tolerance": 1e-8},
        },
    }
