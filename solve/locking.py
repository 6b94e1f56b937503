"""Nearly incompressible bodies, which low degrees make too stiff."""

import logging
from collections.abc import Mapping

from geom2iga.model import Model
from solve.material import Material

log = logging.getLogger("geom2iga")

# From which 1/(1 - 2 nu) on a degree locks, and how much of the settlement it then shows: of a cube of 4 x 4 x 4 spans
# on a rigid base, pressed from above between symmetry planes. Measured by tests/verification/test_scales.py.
LOCKS = {
    1: (50.0, "four fifths of them at a Poisson's ratio of 0.49, a twentieth at 0.4999"),
    2: (500.0, "95 % of them at a Poisson's ratio of 0.499, 89 % at 0.4999"),
}


def warn_of_locking(model: Model, materials: Mapping[str, Material]) -> None:
    """Log a warning for each body whose degree makes it too stiff for its Poisson's ratio."""
    for body, patches in model.bodies.items():
        degree, poisson = min(min(model.patches[name].degrees) for name in patches), materials[body].poisson
        least, shown = LOCKS.get(degree, (float("inf"), ""))
        if 1 / (1 - 2 * poisson) >= least * (1 - 1e-9):
            log.warning(
                'warning: body "%s" is nearly incompressible, Poisson\'s ratio %g, and of degree %d, which may lock: '
                "displacements come out too small, on a coarse mesh %s; raise the degree or refine",
                *(body, poisson, degree, shown),
            )
