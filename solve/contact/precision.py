"""What rounding leaves of the digits of a contact: how well gaps, and so pressures, are known."""

from collections.abc import Iterator, Sequence

import numpy as np

from geom2iga.bspline import Array
from geom2iga.patch import ROUNDED
from solve.case import Contact
from solve.contact.cells import Cells
from solve.contact.laws import Law

LOST = 1e-4  # of the largest pressure: what rounding may take of it without a word
LEFT = 1e-3  # of what the bodies yield: overlap that a multiplier may leave without a word
NOTHING = 1e-12  # of the largest force: forces below it are none
FAR = 100.0  # sizes from the origin from which on the place of the bodies is what costs digits


def find_losses(
    contact: Contact,
    law: Law,
    cells: Sequence[Cells],
    pressure: Array,
    gap: Array,
    area: Array,
    size: float,
    force: float,
) -> Iterator[str]:
    """Say what rounding, or a multiplier that is not updated to the end, has taken from a pressure.

    A gap that is off by r makes a pressure of r E/h: the bodies resist so. It is compared with the largest pressure, or
    where nothing presses with the largest force.

    Parameters
    ----------
    pressure, gap, area : (m,)
        Averaged gaps of the same state [length], and the areas that they are averaged over.
    size : float
        Of the smallest body [length].
    force : float
        The largest that acted on the way to this state.
    """
    largest, resistance = float(pressure.max(initial=0.0)), float(np.max(law.bodies, initial=0.0))
    rounding, hidden = (max(getattr(part, name) for part in cells) for name in ("rounding", "hidden"))
    if area @ pressure <= NOTHING * force:
        least = max(ROUNDED * size, LOST * float(np.abs(gap).max(initial=0.0)))
        if hidden > least and hidden * resistance * area.sum() > LOST * force:
            yield f"gaps of up to {hidden:.1g} are taken as none: {_remedy(rounding, size)}"
        return
    if rounding * resistance > LOST * largest:
        share = rounding * resistance / largest
        known = f"pressures to {share:.0e} of the largest" if share < 1 else "no digit of the pressures is right"
        yield f"gaps are known to {rounding:.1g} only, and {known}: {_remedy(rounding, size)}"
    left = max(0.0, -float(gap.min(initial=0.0)))
    if contact.enforcement == "augmented-lagrange" and left * resistance > LEFT * largest:
        yield (
            f"the overlap that is left, {left:.1g}, is {left * resistance / largest:.0e} of what the bodies yield "
            "under the pressure: lower solve.augmentation.tolerance"
        )


def _remedy(rounding: float, size: float) -> str:
    """Why gaps are known so badly, and what to do."""
    away = rounding / ROUNDED / size
    if away > FAR:
        return f"the bodies lie {away:.0e} sizes from the origin, move them to it"
    return "overlaps this small drown in the rounding of the control points"
