"""Scalar fields of the bodies, as pictures, probes and files name them."""

from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

import numpy as np

from geom2iga.bspline import Array
from post.fields import BodySamples
from solve.material import VOIGT


class Quantity(NamedTuple):
    """A scalar field.

    Parameters
    ----------
    title : str
        In words.
    symbol : str
        As a formula for matplotlib, without the dollar signs.
    dimension :
        What its unit is made of.
    values :
        From samples to values (q,).
    signed : bool
        Whether zero is a value amid others, so that a diverging colour map fits.
    """

    title: str
    symbol: str
    dimension: Literal["length", "stress"]
    values: Callable[[BodySamples], Array]
    signed: bool = True

    @property
    def label(self) -> str:
        """Title and symbol, for an axis or a colour bar."""
        return f"{self.title} ${self.symbol}$"


def _displacement(axis: int) -> Quantity:
    name = "xyz"[axis]
    return Quantity(f"displacement along {name}", f"u_{name}", "length", lambda part: part.displacement[:, axis])


def _stress(number: int) -> Quantity:
    first, second = VOIGT[number]
    title = "normal stress" if first == second else "shear stress"
    symbol = rf"\sigma_{{{'xyz'[first]}{'xyz'[second]}}}"
    return Quantity(title, symbol, "stress", lambda part: part.stress[:, number])


def _principal(number: int) -> Quantity:
    title = ("largest", "middle", "smallest")[number] + " principal stress"
    return Quantity(title, rf"\sigma_{number + 1}", "stress", lambda part: part.principal_stress[:, number])


QUANTITIES: Mapping[str, Quantity] = {
    **{f"u{'xyz'[axis]}": _displacement(axis) for axis in range(3)},
    "displacement_magnitude": Quantity(
        "displacement", r"|\boldsymbol{u}|", "length", lambda part: np.linalg.norm(part.displacement, axis=1), False
    ),
    **{f"stress_{'xyz'[i]}{'xyz'[j]}": _stress(number) for number, (i, j) in enumerate(VOIGT)},
    "von_mises": Quantity("von Mises stress", r"\sigma_\mathrm{vM}", "stress", lambda part: part.von_mises, False),
    **{f"principal_{number + 1}": _principal(number) for number in range(3)},
    "hydrostatic_pressure": Quantity("hydrostatic pressure", "p", "stress", lambda part: part.hydrostatic_pressure),
}
