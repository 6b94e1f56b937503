"""Contact pressure over a distance, and how far it is from Hertz."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import solve
from geom2iga.bspline import Array
from geom2iga.build import build
from geom2iga.picture import scene
from geom2iga.tables import Source, checked
from post.case import PostCase
from post.exact import Hertz
from post.fields import sample_contact
from post.plots import Curve, draw_profile
from solve.result import Result

SAMPLES = 6  # per span and direction
EDGE = 0.01  # contact ends where less than this part of the largest pressure is left


class Profile(NamedTuple):
    """Contact pressure (q,) at distances (q,) [length] from the middle, in any sequence."""

    distance: Array
    pressure: Array

    def within(self, reach: float) -> "Profile":
        """Keep the points up to a distance [length]."""
        near = self.distance <= reach
        return Profile(self.distance[near], self.pressure[near])

    def errors(self, exact: Hertz) -> dict[str, float]:
        """Relative errors of the pressure in the middle, the largest pressure, and the reach of contact."""
        largest = exact.largest_pressure
        edge = self.distance[self.pressure > EDGE * largest].max()
        return {
            "pressure in the middle": float(self.pressure[self.distance.argmin()] / largest - 1),
            "largest pressure": float(self.pressure.max() / largest - 1),
            "reach of contact": float(edge / exact.reach - 1),
        }


def pressure_profile(result: Result, distance: Callable[[Array], Array]) -> Profile:
    """Sample the pressure of the first contact.

    Parameters
    ----------
    distance :
        Distances (q,) from the middle of contact of points (q, 3), undeformed [length].
    """
    parts = sample_contact(result, result.pairs[0], SAMPLES)
    return Profile(
        np.concatenate([distance(part.points) for part in parts]), np.concatenate([part.pressure for part in parts])
    )


def radius(points: Array) -> Array:
    """Distances (q,) of points (q, 3) from the z axis [length]."""
    return np.hypot(points[:, 0], points[:, 1])


def compare_with_hertz(
    source: Source, exact: Hertz, distance: Callable[[Array], Array] = radius, picture: str | Path | None = None
) -> dict[str, float]:
    """Solve a case, print how far its contact pressure is from Hertz, and draw it where a picture is named.

    Parameters
    ----------
    source : path, dict or Case
    exact : Hertz
    distance :
        As of `pressure_profile`.
    picture : path
        PNG file to write.

    Returns
    -------
    dict
        As `Profile.errors` has it.
    """
    result = solve.solve(build(source), source)
    profile = pressure_profile(result, distance)
    errors = profile.errors(exact)
    print(result, *(f"{key}: {100 * error:+.2f} %" for key, error in errors.items()), sep="\n")
    if picture:
        units = checked(source, PostCase).units
        near = profile.within(1.5 * exact.reach)
        scene.save(draw_profile([Curve("computed", *near)], exact.pressure, units), Path(picture))
    return errors
