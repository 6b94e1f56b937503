"""Contact pressure along the radius against Hertz: python profile.py [profile.png]."""

import sys
from math import inf, pi
from pathlib import Path

from post.exact import HertzSpheres
from post.profile import compare_with_hertz

EXACT = HertzSpheres(force=25 * pi, radii=(10.0, inf), young=(1000.0, 1000.0), poisson=(0.3, 0.3))


def main(picture: str | None = None) -> dict[str, float]:
    """Return the relative errors of pressure and reach of contact; save the picture where it is named."""
    return compare_with_hertz(Path(__file__).with_name("case.toml"), EXACT, picture=picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
