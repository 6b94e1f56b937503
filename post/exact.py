"""Closed-form solutions, each with its source."""

from dataclasses import dataclass

import numpy as np

from geom2iga.bspline import Array


@dataclass(frozen=True)
class StackedBlocks:
    """Two blocks pressed onto each other and onto a smooth table by a uniform pressure; sides free.

    Statics: the stress is uniaxial and uniform. The penalty lets the blocks overlap by pressure / penalty.
    Taylor & Papadopoulos 1991 (On a patch test for contact problems in two dimensions); Hooke's law.

    Parameters
    ----------
    pressure : float
        [stress]
    young : float
        Of both blocks [stress].
    heights : (float, float)
        Of the lower and the upper block [length].
    penalty : float
        [stress/length]
    """

    pressure: float
    young: float
    heights: tuple[float, float]
    penalty: float = np.inf

    @property
    def stress(self) -> Array:
        """Stress (6,) as xx yy zz xy yz xz."""
        return np.array([0.0, 0.0, -self.pressure, 0.0, 0.0, 0.0])

    @property
    def settlement(self) -> tuple[float, float, float]:
        """Vertical displacement [length] of the lower block's top, the upper block's bottom and its top.

        >>> StackedBlocks(1.0, 1000.0, (1.0, 1.0), 1e5).settlement
        (-0.001, -0.00101, -0.00201)
        """
        lower = -self.pressure * self.heights[0] / self.young
        upper = lower - self.pressure / self.penalty
        return lower, upper, upper - self.pressure * self.heights[1] / self.young
