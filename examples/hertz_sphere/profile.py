"""Contact pressure along the radius against Hertz.

python profile.py                          the paraboloid
python profile.py sphere.toml sphere.png   the sphere, with its picture
"""

import sys
from math import inf
from pathlib import Path

import numpy as np

import geom2iga
import solve
from geom2iga.picture import scene
from post.exact import HertzSpheres
from post.plots import draw_profile
from post.profile import pressure_profile

EXACT = HertzSpheres(force=0.6, radii=(10.0, inf), young=(1000.0, 1000.0), poisson=(0.3, 0.3))


def main(name: str = "case.toml", picture: str | None = None) -> dict[str, float]:
    """Return the relative errors of pressure and contact radius; save the picture where it is named."""
    case = geom2iga.read_case(Path(__file__).with_name(name))
    result = solve.solve(geom2iga.build(case), case)
    profile = pressure_profile(result, lambda points: np.hypot(*points[:, :2].T))
    errors = profile.errors(EXACT)
    print(result, *(f"{key}: {100 * error:+.2f} %" for key, error in errors.items()), sep="\n")
    if picture:
        near = profile.within(1.5 * EXACT.reach)
        scene.save(draw_profile(*near, EXACT.pressure, "mm", "N/mm²"), Path(picture))
    return errors


if __name__ == "__main__":
    main(*sys.argv[1:])
