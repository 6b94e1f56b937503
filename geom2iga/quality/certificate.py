"""What is proven or measured of a patch: that it is the CAD shape, and that its Jacobian is positive."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

from geom2iga.errors import GeometryError
from geom2iga.patch import Patch
from geom2iga.quality.jacobian import Jacobian, prove_jacobian
from geom2iga.quality.volume import volume

log = logging.getLogger("geom2iga")


@dataclass(frozen=True)
class Certificate:
    """What is known of a patch.

    Parameters
    ----------
    way : str
        "exact", "fitted" where a face is an approximation, "given" where there is no other shape to compare with.
    distance : float or None
        Largest distance of its faces from the CAD faces, at sample points [length].
    jacobian : Jacobian
    volume : float
        By quadrature over the patch [length³].
    enclosed_volume : float
        By the divergence theorem over its six faces [length³].
    """

    way: str
    distance: float | None
    jacobian: Jacobian
    volume: float
    enclosed_volume: float

    @property
    def data(self) -> Mapping[str, Any]:
        """All of it as numbers and words, for files."""
        return {
            "way": self.way,
            "distance": self.distance,
            "jacobian": self.jacobian.status,
            "jacobian_minimum": self.jacobian.sampled_minimum,
            "jacobian_bound": self.jacobian.bound,
            "jacobian_mean": self.jacobian.mean,
            "volume": self.volume,
            "enclosed_volume": self.enclosed_volume,
        }


def certify(patch: Patch, way: str, distance: float | None) -> Certificate:
    """Measure a patch.

    Raises
    ------
    GeometryError
        It is folded or left-handed. Where the Jacobian is zero somewhere, or not proven positive, a warning is logged.
    """
    jacobian = prove_jacobian(patch)
    if jacobian.status in ("folded", "left-handed"):
        raise GeometryError(f'patch "{patch.name}" is {jacobian.message}: split the volume into more regular blocks')
    if jacobian.status != "proven":
        log.warning('warning: patch "%s": %s', patch.name, jacobian.message)
    enclosed = jacobian.mean * prod(float(at[-1] - at[0]) for at in patch.breaks)
    return Certificate(way, distance, jacobian, volume(patch), enclosed)


def summarised(certificates: Sequence[Certificate]) -> str:
    """Say in one clause what is known of all patches of a body."""
    words = [word for word in ("exact", "fitted", "given") if any(each.way == word for each in certificates)]
    distances = [each.distance for each in certificates if each.distance is not None]
    shape = " and ".join(words) + (f", faces within {max(distances):.1e} of the CAD faces" if distances else "")
    worst = min(certificates, key=lambda each: (each.jacobian.status == "proven", each.jacobian.relative_minimum))
    bounds = [each.jacobian.relative_bound for each in certificates]
    proven = [bound for bound in bounds if bound is not None]
    jacobian = (
        worst.jacobian.message if len(proven) < len(bounds) else f"det J >= {min(proven):.2g} of its mean, proven"
    )
    return f"{shape}; {jacobian}; volume {sum(each.volume for each in certificates):.12g}"
