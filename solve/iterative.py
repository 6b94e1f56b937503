"""Solves with tangents by conjugate gradients: the stiffness is applied, not stored, and only contact is factorised."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from geom2iga.bspline import Array, Indices, Mask
from geom2iga.progress import tracked
from solve.bricks import Floats
from solve.complement import DENSE, Complement, Factors, Iterations
from solve.contact.laws import Law
from solve.inverse import Inverse
from solve.linear import SlowError
from solve.operator import Stiffness
from solve.problem import Problem
from solve.rules import smooth_rules
from solve.system import System

MOST_ITERATIONS = 1000
FINEST = 1e-5  # relative tolerance that single precision allows for
CORRECTED = 1e-4  # relative tolerance of each correction of a solution with multipliers
CORRECTIONS = 10  # at most, by the residual in double precision
EXACT = 1e-13  # relative residual at which they end


class Saddle(NamedTuple):
    """K v - G' p = f, G v + C p = h for active gaps: springs where C > 0, multipliers where C = 0.

    With an approximate inverse B of K, elimination of v leaves (C + G B G') p = h - G B f, which is small and dense
    and is factorised: Woodbury's formula where C > 0, the constraint preconditioner of Keller, Gould & Wathen (2000)
    where C = 0. The pressures of a direction are carried along with it, so that nothing is ever divided by C.
    """

    stiffness: Stiffness
    inverse: Inverse
    freedom: csr_array  # (dofs, dofs)
    operator: csr_array  # G (k, dofs)
    complement: Complement  # C + G B G'

    def conditioned(self, force: Floats, gap: Floats) -> tuple[Floats, Floats]:
        """Solve with B in place of K."""
        modes = self.inverse.modes(force)
        pressure = gap
        if len(gap):
            pressure = self.complement.solved(gap - self.operator @ self.inverse.traced(modes))
            pushed = self.inverse.pushed(self.operator.T @ pressure)
            modes = [one + other for one, other in zip(modes, pushed, strict=True)]
        return self.freedom @ self.inverse.displacements(modes), pressure

    def forces(self, displacement: Floats, pressure: Floats) -> Floats:
        """K v - G' p."""
        return self.freedom @ (self.stiffness @ displacement) - self.operator.T @ pressure

    def solved(self, force: Floats, gap: Floats, tolerance: float) -> tuple[Floats, Floats, int]:
        """Displacement (dofs,), pressure (k,) and iterations of preconditioned conjugate gradients."""
        still = np.zeros_like(gap)
        found, pressure = self.conditioned(force, gap) if gap.any() else (np.zeros_like(force), still)
        residual = force - self.forces(found, pressure) if gap.any() else force
        direction, pull = self.conditioned(residual, still)
        power = first = float(residual @ direction)
        for iteration in tracked(iter(range(MOST_ITERATIONS)), "conjugate gradients"):
            if power <= tolerance**2 * first:
                return found, pressure, iteration
            if not np.isfinite(power):  # single precision does not reach that far
                break
            pushed = self.forces(direction, pull)
            length = np.float32(power / float(direction @ pushed))
            found, pressure = found + length * direction, pressure + length * pull
            residual = residual - length * pushed
            better, pulled = self.conditioned(residual, still)
            share = np.float32(float(residual @ better) / power)
            power *= float(share)
            direction, pull = better + share * direction, pulled + share * pull
        raise SlowError


class Iterated:
    """Tangents of which only the contact part is factorised, in single precision: corrections are up to the caller.

    Parameters
    ----------
    problem : Problem
    """

    name = "conjugate gradients"

    def __init__(self, problem: Problem) -> None:
        space, materials, mortar = problem.space, problem.materials, problem.mortar
        self._matrix, self._law, self._area = problem.allowed.matrix, problem.law, mortar.area
        self._points = problem.points
        freedom = csr_array(self._matrix @ self._matrix.T)
        self._stiffness = Stiffness(space, materials, smooth_rules(space), np.float32)
        self._inverse = Inverse(space, materials, freedom, problem.touching)
        self._unit = _pressure_unit(self._law, self._area)
        operator = csr_array(self._unit * (mortar.gap_operator @ freedom))
        self._dense = self._inverse.between(operator) if len(self._area) <= DENSE else None
        self._freedom, self._operator = freedom.astype(np.float32), operator.astype(np.float32)
        self.factorisations = self.iterations = 0
        self._key: bytes | None = None
        self._last: Saddle

    def solved(self, active: Mask, right: Array, tolerance: float) -> Array:
        """Solve with springs."""
        rows = np.flatnonzero(active)
        compliance = self._area[rows] / self._law.stiffness[rows]
        return self._corrected(rows, compliance, right, np.zeros(len(rows)), tolerance)[0]

    def equalised(self, system: System, law: Law, active: Mask, guess: Array) -> tuple[Array, Array]:
        """Solve with multipliers, and correct the solution with its residual."""
        rows = np.flatnonzero(active)
        operator, compliance = system.gap_operator[rows], law.compliance[rows] * self._area[rows]
        free, pressure, best = np.zeros(len(system.load)), np.zeros(len(active)), np.inf
        for _ in range(CORRECTIONS):
            inner = system.stiffness @ free
            force = system.load - inner + operator.T @ pressure[rows]
            gap = -(operator @ free + system.initial_gap[rows] + compliance * pressure[rows])
            opened = _relative(gap, system.initial_gap[rows], abs(operator) @ np.abs(free))
            before, best = best, max(opened, _relative(force, system.load, inner))
            if best <= EXACT or best > before / 2:
                break
            moved, pushed = self._corrected(rows, compliance, force, gap, CORRECTED)
            free, pressure[rows] = free + moved, pressure[rows] + pushed
        return free, pressure

    def _corrected(
        self, rows: Indices, compliance: Array, force: Array, gap: Array, tolerance: float
    ) -> tuple[Array, Array]:
        """Solve for forces (free,) and gaps (k,): displacement (free,), pressure (k,)."""
        saddle, gap = self._saddle(rows, self._unit**2 * compliance), self._unit * gap
        sizes = (np.abs(part).max(initial=0.0) for part in (force, gap))
        scale = max(*sizes, np.finfo(float).tiny)  # so that single precision is enough
        right = (self._matrix @ (force / scale)).astype(np.float32)
        found, pressure, iterations = saddle.solved(right, (gap / scale).astype(np.float32), max(tolerance, FINEST))
        self.iterations += iterations
        return scale * (self._matrix.T @ found.astype(float)), self._unit * scale * pressure.astype(float)

    def _saddle(self, rows: Indices, compliance: Array) -> Saddle:
        """Make ready for some active gaps, unless they are those of the last solution."""
        key = rows.tobytes() + compliance.tobytes()
        if key != self._key:
            operator = csr_array(self._operator[rows])
            complement = self._complement(operator, rows, compliance)
            self._last = Saddle(self._stiffness, self._inverse, self._freedom, operator, complement)
            self._key = key
        return self._last

    def _complement(self, operator: csr_array, rows: Indices, compliance: Array) -> Complement:
        """Factorise C + G B G' of active gaps, or make ready to iterate where they may be too many."""
        if self._dense is None:
            area = self._unit**2 * self._area[rows]
            return Iterations(self._inverse, operator, compliance, area, self._points[rows], self._unit)
        complement = self._dense[np.ix_(rows, rows)]
        complement.flat[:: len(rows) + 1] += compliance
        self.factorisations += 1
        return Factors(complement)


def _pressure_unit(law: Law, area: Array) -> float:
    """Unit of pressures in which gaps yield about as much as single precision can hold, at any size and modulus."""
    return float(np.median((law.bodies / area) ** 0.5)) if len(area) else 1.0


def _relative(rest: Array, *parts: Array) -> float:
    """Largest entry of what is left over, over the largest of what it is the sum of."""
    largest = max(np.abs(part).max(initial=0.0) for part in parts)
    return float(np.abs(rest).max(initial=0.0) / largest) if largest else 0.0
