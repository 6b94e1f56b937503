"""Transfinite interpolation of homogeneous splines: four edges to a surface, six faces to a volume."""

from collections.abc import Sequence

import numpy as np

from geom2iga import bspline
from geom2iga.bspline import Array
from geom2iga.spline import Spline, adapted, united

Sides = Sequence[tuple[Spline, Spline]]


def coons(sides: Sides) -> Spline:
    """Blend the sides of a square or a cube.

    The Boolean sum of the linear interpolations between opposite sides (Gordon & Hall 1973), in homogeneous
    coordinates: P = F - (I - L_1) ... (I - L_d) F, where L_a blends the ends of direction a. It reproduces every
    homogeneous map that is linear in one direction.

    Parameters
    ----------
    sides : d pairs of splines of d - 1 directions
        The lower and the upper end of each direction, their own directions in increasing sequence; where two sides
        meet, their homogeneous values agree.

    Returns
    -------
    Spline
        In the smallest space that holds the sides.
    """
    count = len(sides)
    spaces = []
    for axis in range(count):
        others = [other for other in range(count) if other != axis]
        held = [(side, axis - (axis > other)) for other in others for side in sides[other]]
        spaces.append(united([(side.degrees[place], side.knots[place]) for side, place in held]))
    shape = [len(knots) - degree - 1 for degree, knots in spaces]
    filled = np.zeros((*shape, sides[0][0].coefficients.shape[-1]))
    for axis, pair in enumerate(sides):
        kept = [space for other, space in enumerate(spaces) if other != axis]
        for side, spline in enumerate(pair):
            np.moveaxis(filled, axis, 0)[-side] = adapted(spline, kept).coefficients
    remainder = filled
    for axis, (degree, knots) in enumerate(spaces):
        remainder = remainder - _blended_ends(remainder, axis, bspline.greville(knots, degree))
    blended = filled - remainder
    return Spline(tuple(p for p, _ in spaces), tuple(k for _, k in spaces), blended)


def _blended_ends(values: Array, axis: int, at: Array) -> Array:
    """Interpolate linearly between the ends of an axis; Greville abscissae are the coefficients of the identity."""
    front = np.moveaxis(values, axis, 0)
    share = at.reshape(-1, *(1,) * (front.ndim - 1))
    return np.moveaxis((1 - share) * front[0] + share * front[-1], 0, axis)
