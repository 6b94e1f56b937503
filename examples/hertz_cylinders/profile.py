"""Contact pressure across the strip against Hertz: python profile.py [profile.png]."""

import sys
from pathlib import Path

from post.exact import HertzCylinders
from post.profile import compare_with_hertz

EXACT = HertzCylinders(force=10.0, radii=(8.0, 8.0), young=(200.0, 200.0), poisson=(0.3, 0.3))


def main(picture: str | None = None) -> dict[str, float]:
    """Return the relative errors of pressure and reach of contact; save the picture where it is named."""
    return compare_with_hertz(
        Path(__file__).with_name("case.toml"), EXACT, lambda points: points[:, 0], picture=picture
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
