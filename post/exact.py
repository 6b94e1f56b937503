"""Closed-form solutions, each with its source."""

from dataclasses import dataclass, replace
from math import inf, pi, sqrt
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from geom2iga.bspline import Array


@dataclass(frozen=True)
class StackedBlocks:
    """Blocks pressed onto each other and onto a smooth table by a uniform pressure; sides free, or two walls.

    Statics: the stress is uniaxial and uniform, in plane strain but for what the two walls hold. Blocks may be of
    different width where what an upper one leaves bare is under the same pressure. The penalty lets two blocks
    overlap by pressure / penalty.
    Taylor & Papadopoulos 1991 (On a patch test for contact problems in two dimensions); Hooke's law.

    Parameters
    ----------
    pressure : float
        [stress]
    young : float, or one for each block
        [stress]
    heights : (n,)
        Of the blocks, the lowest first [length].
    penalty : float
        [stress/length]
    poisson : float
        Of blocks that smooth walls hold along y: plane strain; 0 where nothing holds them.
    """

    pressure: float
    young: float | tuple[float, ...]
    heights: tuple[float, ...]
    penalty: float = inf
    poisson: float = 0.0

    @property
    def stress(self) -> Array:
        """Stress (6,) as xx yy zz xy yz xz."""
        return np.array([0.0, -self.poisson * self.pressure, -self.pressure, 0.0, 0.0, 0.0])

    @property
    def settlement(self) -> tuple[float, ...]:
        """Vertical displacement [length] of the lowest block's top, the next one's bottom and top, and so on.

        >>> StackedBlocks(1.0, 1000.0, (1.0, 1.0), 1e5).settlement
        (-0.001, -0.00101, -0.00201)
        """
        each = self.young if isinstance(self.young, tuple) else (self.young,) * len(self.heights)
        found: list[float] = []
        for height, young in zip(self.heights, each, strict=True):
            if found:
                found.append(found[-1] - self.pressure / self.penalty)
            below = found[-1] if found else 0.0
            found.append(below - self.pressure * height * (1 - self.poisson**2) / young)
        return tuple(found)


@dataclass(frozen=True)
class Hertz:
    """Two smooth elastic bodies, of which contact takes up a small part.

    Hertz 1882; Johnson, Contact Mechanics, chapter 4.

    Parameters
    ----------
    force : float
        Of spheres the force [force], of parallel cylinders the force per length.
    radii : (2,)
        Of the bodies at the first point of contact [length]; infinite where plane, negative where hollow.
    young : (2,)
        [stress], infinite where rigid.
    poisson : (2,)
    """

    force: float
    radii: tuple[float, float]
    young: tuple[float, float]
    poisson: tuple[float, float]

    @property
    def radius(self) -> float:
        """Effective radius R of curvature: 1/R = 1/R1 + 1/R2 [length]."""
        return 1 / sum(1 / radius for radius in self.radii)

    @property
    def modulus(self) -> float:
        """Effective modulus E*: 1/E* = (1 - ν1²)/E1 + (1 - ν2²)/E2 [stress]."""
        return 1 / sum((1 - nu**2) / young for young, nu in zip(self.young, self.poisson, strict=True))

    @property
    def reach(self) -> float:
        """Radius of the circle, or half the width of the strip, in contact [length]."""
        raise NotImplementedError

    @property
    def largest_pressure(self) -> float:
        """Pressure p0 in the middle [stress]."""
        raise NotImplementedError

    def pressure(self, distance: ArrayLike) -> Array:
        """Pressure [stress] at distances [length] from the middle: p0 √(1 - (r/a)²), outside zero."""
        return self.largest_pressure * np.sqrt(np.maximum(0.0, 1 - (np.asarray(distance) / self.reach) ** 2))


@dataclass(frozen=True)
class HertzSpheres(Hertz):
    """Two spheres, or a sphere and a plane.                                          Johnson, eqs. (4.22) to (4.24)

    >>> sphere_on_plane = HertzSpheres(60 * pi, (8.0, inf), (1000.0, inf), (0.3, 0.3))
    >>> round(sphere_on_plane.reach, 5), round(sphere_on_plane.largest_pressure, 2)
    (1.00964, 88.29)
    """

    @property
    def reach(self) -> float:
        """Radius a of the circle in contact: a³ = 3 F R / (4 E*) [length]."""
        return (3 * self.force * self.radius / (4 * self.modulus)) ** (1 / 3)

    @property
    def largest_pressure(self) -> float:
        """Pressure p0 = 3 F / (2 π a²) in the middle [stress]."""
        return 3 * self.force / (2 * pi * self.reach**2)

    @property
    def approach(self) -> float:
        """How much distant points of the two bodies come closer: a²/R [length]."""
        return self.reach**2 / self.radius


@dataclass(frozen=True)
class HertzCylinders(Hertz):
    """Two parallel cylinders, or a cylinder and a plane, in plane strain.            Johnson, eqs. (4.43) to (4.45)

    >>> pair = HertzCylinders(10.0, (8.0, 8.0), (200.0, 200.0), (0.3, 0.3))
    >>> round(pair.reach, 5), round(pair.largest_pressure, 5)
    (0.68078, 9.35135)
    """

    @property
    def reach(self) -> float:
        """Half the width b of the strip in contact: b² = 4 F R / (π E*) [length]."""
        return sqrt(4 * self.force * self.radius / (pi * self.modulus))

    @property
    def largest_pressure(self) -> float:
        """Pressure p0 = 2 F / (π b) in the middle [stress]."""
        return 2 * self.force / (pi * self.reach)


@dataclass(frozen=True)
class Shell:
    """A hollow sphere, or a ring in plane strain, under pressure inside and outside.

    With n = 3 of the sphere and 2 of the ring: σ_r = m - d/rⁿ, σ_t = m + d/((n - 1) rⁿ).
    Lamé 1852; Timoshenko & Goodier, Theory of Elasticity, sections 28 and 136.

    Parameters
    ----------
    inner, outer : float
        Radii [length].
    young : float
        [stress]
    poisson : float
    inside, outside : float
        Pressures [stress].
    dimension : 3 or 2
        Of a sphere or a ring.
    """

    inner: float
    outer: float
    young: float
    poisson: float
    inside: float = 0.0
    outside: float = 0.0
    dimension: Literal[2, 3] = 3

    @property
    def _mean(self) -> float:
        a, b = self.inner**self.dimension, self.outer**self.dimension
        return (self.inside * a - self.outside * b) / (b - a)

    @property
    def _deviation(self) -> float:
        a, b = self.inner**self.dimension, self.outer**self.dimension
        return (self.inside - self.outside) * a * b / (b - a)

    def radial_stress(self, radius: ArrayLike) -> Array:
        """σ_r at radii, tension positive [stress]."""
        return self._mean - self._deviation / np.asarray(radius, dtype=float) ** self.dimension

    def hoop_stress(self, radius: ArrayLike) -> Array:
        """σ_t at radii, tension positive [stress]."""
        power = np.asarray(radius, dtype=float) ** self.dimension
        return self._mean + self._deviation / ((self.dimension - 1) * power)

    def displacement(self, radius: ArrayLike) -> Array:
        """Radial displacement at radii, outward positive [length]."""
        r, nu = np.asarray(radius, dtype=float), self.poisson
        plane = 1 + nu if self.dimension == 2 else 1.0
        uniform = plane * (1 - 2 * nu) * self._mean * r
        return (uniform + (1 + nu) / (self.dimension - 1) * self._deviation * r ** (1 - self.dimension)) / self.young


@dataclass(frozen=True)
class NestedShells:
    """Two concentric hollow spheres, or rings, that touch without friction all around.

    The interface pressure q follows from the displacements on its two sides: u_outer - u_inner = interference - q/ε.
    Shells that pull apart, q < 0, have no contact and are not described.

    Parameters
    ----------
    inner, outer : Shell
        Their pressures at the interface are ignored.
    penalty : float
        ε: pressure over overlap [stress/length].
    interference : float
        By how much the inner shell is too large [length].

    Examples
    --------
    >>> inner, outer = Shell(20, 30, 2000, 0.3, inside=25), Shell(30, 40, 2000, 0.3)
    >>> round(NestedShells(inner, outer).pressure, 4)
    4.8942
    """

    inner: Shell
    outer: Shell
    penalty: float = inf
    interference: float = 0.0

    @property
    def pressure(self) -> float:
        """Interface pressure [stress]."""
        apart = self._opening(0.0)
        return (self.interference - apart) / (self._opening(1.0) - apart + 1 / self.penalty)

    @property
    def loaded(self) -> tuple[Shell, Shell]:
        """Both shells under the pressures that they bear, the inner one first."""
        return self._under(self.pressure)

    def _under(self, pressure: float) -> tuple[Shell, Shell]:
        return replace(self.inner, outside=pressure), replace(self.outer, inside=pressure)

    def _opening(self, pressure: float) -> float:
        """How far the two sides of the interface move apart under a pressure [length]."""
        inner, outer = self._under(pressure)
        return float(outer.displacement(outer.inner) - inner.displacement(inner.outer))
