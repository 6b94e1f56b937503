"""Isotropic linear elasticity."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from geom2iga.bspline import Array
from geom2iga.errors import CaseError, suggestion
from geom2iga.model import Model
from solve.case import Solve

VOIGT = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))  # xx yy zz xy yz xz


@dataclass(frozen=True)
class Material:
    """Young's modulus [stress] and Poisson's ratio."""

    young: float
    poisson: float

    @property
    def lame(self) -> tuple[float, float]:
        """Lamé's constants lambda and mu [stress]."""
        mu = self.young / (2 * (1 + self.poisson))
        return 2 * mu * self.poisson / (1 - 2 * self.poisson), mu

    def stress(self, gradient: Array) -> Array:
        """Stress (q, 6) as xx yy zz xy yz xz, tension positive, from displacement gradients (q, 3, 3) u_i,j."""
        lame, mu = self.lame
        strain = (gradient + np.swapaxes(gradient, 1, 2)) / 2
        stress = 2 * mu * strain + lame * np.trace(strain, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        return np.stack([stress[:, i, j] for i, j in VOIGT], axis=1)


def von_mises(stress: Array) -> Array:
    """Von Mises stress (q,) from stresses (q, 6).

    >>> von_mises(np.array([[3.0, 0, 0, 0, 0, 0], [0, 0, 0, 1, 0, 0]])).round(12).tolist()
    [3.0, 1.732050807569]
    """
    xx, yy, zz, xy, yz, xz = stress.T
    normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.sqrt(normal / 2 + 3 * (xy**2 + yz**2 + xz**2))


def principal_stress(stress: Array) -> Array:
    """Principal stresses (q, 3), the largest first, from stresses (q, 6); not a number where one of these is none.

    >>> principal_stress(np.array([[1.0, 1, 5, 2, 0, 0]])).round(12).tolist()
    [[5.0, 3.0, -1.0]]
    """
    full = np.empty((len(stress), 3, 3))
    for number, (i, j) in enumerate(VOIGT):
        full[:, i, j] = full[:, j, i] = stress[:, number]
    missing = ~np.isfinite(stress).all(axis=1)
    full[missing] = 0.0
    principal = np.asarray(np.linalg.eigvalsh(full)[:, ::-1], dtype=np.float64).copy()
    principal[missing] = np.nan
    return principal


def hydrostatic_pressure(stress: Array) -> Array:
    """Hydrostatic pressure (q,), positive in compression, from stresses (q, 6).

    >>> hydrostatic_pressure(np.array([[-1.0, -2, -3, 7, 7, 7]])).tolist()
    [2.0]
    """
    return -stress[:, :3].sum(axis=1) / 3


def find_materials(model: Model, case: Solve) -> Mapping[str, Material]:
    """Give each body its material.

    Raises
    ------
    CaseError
        An unknown body, a body with no material or with two.
    """
    found: dict[str, Material] = {}
    for number, entry in enumerate(case.material):
        for body in named_bodies(model, entry.bodies, f"solve.material[{number}].bodies"):
            if body in found:
                raise CaseError(f'solve.material[{number}]: body "{body}" has a material already')
            found[body] = Material(entry.young, entry.poisson)
    for body in model.bodies:
        if body not in found:
            raise CaseError(f'body "{body}" has no material: name it in a [[solve.material]]')
    return found


def named_bodies(model: Model, names: tuple[str, ...] | None, key: str) -> tuple[str, ...]:
    """Return the named bodies, all where none are named; raise CaseError for an unknown one."""
    for name in names or ():
        if name not in model.bodies:
            raise CaseError(f'{key}: there is no body "{name}"; {suggestion(name, model.bodies)}')
    return tuple(model.bodies) if names is None else names
