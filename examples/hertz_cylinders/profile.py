"""Contact pressure across the strip against Hertz: python profile.py [profile.png]."""

import sys
from pathlib import Path

import geom2iga
import solve
from geom2iga.picture import scene
from post.exact import HertzCylinders
from post.plots import draw_profile
from post.profile import pressure_profile

EXACT = HertzCylinders(force=10.0, radii=(8.0, 8.0), young=(200.0, 200.0), poisson=(0.3, 0.3))


def main(picture: str | None = None) -> dict[str, float]:
    """Return the relative errors of pressure and half width; save the picture where it is named."""
    case = geom2iga.read_case(Path(__file__).with_name("case.toml"))
    result = solve.solve(geom2iga.build(case), case)
    profile = pressure_profile(result, lambda points: points[:, 0])
    errors = profile.errors(EXACT)
    print(result, *(f"{key}: {100 * error:+.2f} %" for key, error in errors.items()), sep="\n")
    if picture:
        near = profile.within(1.5 * EXACT.reach)
        scene.save(draw_profile(*near, EXACT.pressure, "mm", "N/mm²"), Path(picture))
    return errors


if __name__ == "__main__":
    main(*sys.argv[1:])
