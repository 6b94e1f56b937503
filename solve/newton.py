"""Semismooth Newton's method with exact line search on the energy."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from geom2iga.bspline import Array
from solve.case import Newton
from solve.linear import SingularMatrixError, Tangents
from solve.system import System

SETTLED = 1e-8  # largest relative residual at which rounding may end the iteration
ROUNDING = 1e-14  # residual, over the largest force that ever acted, that is a rounding error


class Status(Enum):
    """How the iteration ended; the text says what to do."""

    CONVERGED = "converged"
    MAX_STEPS = "no equilibrium within the allowed Newton steps: raise solve.newton.max_steps"
    PENETRATION = (
        "the bodies still overlap after the allowed updates of the multiplier: raise the penalty, "
        "solve.augmentation.tolerance or solve.augmentation.max_steps"
    )
    UNSETTLED = (
        "it stays open which gaps press, as there are more of them than the bodies can follow: lower the penalty, or "
        'use method = "mortar" in one pass'
    )
    UNBOUNDED = "a body is pulled off and nothing holds it: check the direction of the loads, or add a support"
    SINGULAR = "the tangent is singular: check that every body is held, and that moduli and penalty are not extreme"
    INACCURATE = (
        "rounding errors stop the iteration short of equilibrium: penalty, moduli or gaps differ too much in size"
    )


@dataclass(frozen=True)
class Step:
    """One Newton step, as seen after it."""

    number: int  # from the start of the analysis
    residual: float  # largest force out of balance, over the largest force
    active: int  # control points with pressure
    changes: int  # control points that opened or closed
    length: float  # fraction of the Newton direction
    energy: float
    seconds: float
    load_step: int = 1
    update: int = 0  # of the multiplier


class Solution(NamedTuple):
    """Where the iteration ended."""

    status: Status
    free: Array  # (free,)
    pressure: Array  # (m,)
    history: tuple[Step, ...]
    scale: float  # largest force seen


class Iterate(NamedTuple):
    """A point of the iteration."""

    free: Array  # (free,)
    gap: Array  # (m,) control-point gaps [length]
    residual: Array  # (free,) forces out of balance
    energy: float
    scale: float  # largest force that acts now
    largest: float  # largest force that ever acted

    @property
    def active(self) -> bytes:
        """Which control points touch, as a key."""
        return np.packbits(self.gap <= 0).tobytes()

    @property
    def relative(self) -> float:
        """Largest residual over the largest force."""
        return self.error / max(self.scale, np.finfo(float).tiny)

    @property
    def error(self) -> float:
        """Largest residual."""
        return float(np.abs(self.residual).max(initial=0.0))


def minimise(
    system: System,
    settings: Newton,
    tangents: Tangents,
    report: Callable[[Step], None] = lambda step: None,
    start: Array | None = None,
) -> Solution:
    """Minimise the energy.

    The energy is convex and piecewise quadratic. A full step of the semismooth Newton method depends on the active set
    alone, so full steps end at the minimum unless they come back to a set that they had before. Then the iteration
    returns to the iterate of least energy and takes the step that is exactly best along its direction. So the energy
    falls from cycle to cycle, and the iteration ends after finitely many steps. Where the pressed control points do
    not hold every body, bodies first follow their loads along the rigid motions that nothing resists, until a gap
    closes.

    Parameters
    ----------
    report : function
        Is told of each step.
    start : (free,)
        Where to begin; left out, undeformed, and bodies that contact alone holds are first tied to it.
    """
    history: list[Step] = []
    at = _iterate(system, np.zeros(len(system.load)) if start is None else start)
    floating = not system.holds(np.zeros(len(system.area), dtype=bool))
    held, best, seen = not floating, (at, at.residual), set[bytes]()
    try:
        while (status := _verdict(at, history, settings, held)) is None:
            began = time.perf_counter()
            tied = floating and start is None and not history
            held = system.holds(at.gap <= 0)
            direction = _tied(system, at, tangents) if tied else _direction(system, at, held, settings, tangents)
            exact = 1.0 if tied else exact_step(system, at.free, direction)
            if not np.isfinite(exact):
                status = Status.UNBOUNDED
                break
            length = 1.0 if held else exact
            before, at = at, _iterate(system, at.free + length * direction, at.largest)
            if held and not tied:
                best = min(best, (before, direction), key=lambda pair: pair[0].energy)
                if before.active in seen and at.active != before.active and at.energy >= best[0].energy:
                    length = exact_step(system, best[0].free, best[1])
                    at = _iterate(system, best[0].free + length * best[1], at.largest)
                    seen.clear()
                seen.add(before.active)
            history.append(_step(before, at, length, len(history) + 1, time.perf_counter() - began))
            report(history[-1])
    except SingularMatrixError:
        status = Status.SINGULAR
    return Solution(status, at.free, system.law.pressure(at.gap), tuple(history), at.largest)


def _step(before: Iterate, after: Iterate, length: float, number: int, seconds: float) -> Step:
    """Put down what a step did."""
    active = after.gap <= 0
    changes = int(np.count_nonzero(active != (before.gap <= 0)))
    return Step(number, after.relative, int(active.sum()), changes, length, after.energy, seconds)


def _iterate(system: System, free: Array, largest: float = 0.0) -> Iterate:
    scale = system.force_scale(free)
    gap, residual = system.control_gaps(free), system.residual(free)
    return Iterate(free, gap, residual, system.energy(free), scale, max(scale, largest))


def _verdict(at: Iterate, history: list[Step], settings: Newton, held: bool) -> Status | None:
    """Decide whether to go on (None).

    Parameters
    ----------
    held : bool
        Whether supports and contact held every body in the last step: only then is a residual that stays rounding.
    """
    if at.relative <= settings.tolerance:
        return Status.CONVERGED
    last = history[-1] if held and len(history) > 1 else None
    if last and last.length == 1 and last.changes == 0 and at.relative > history[-2].residual / 2:
        small = at.relative <= SETTLED or at.error <= ROUNDING * at.largest
        return Status.CONVERGED if small else Status.INACCURATE
    return Status.MAX_STEPS if len(history) >= settings.max_steps else None


def _direction(system: System, at: Iterate, held: bool, settings: Newton, tangents: Tangents) -> Array:
    """Direction (free,) of the next step: Newton's, or a push along rigid motions that nothing resists yet."""
    active = at.gap <= 0
    if not held:
        loose = system.loose(active)
        push = loose @ (loose.T @ at.residual)
        if np.abs(push).max(initial=0.0) > settings.tolerance * at.largest:
            return push
        active = np.ones_like(active)  # nothing pushes: any springs will do
    return tangents.solved(active, at.residual)


def _tied(system: System, at: Iterate, tangents: Tangents) -> Array:
    """First step for bodies that contact alone holds: to where the nearest candidates, tied by their penalty, pull."""
    nearest = np.argsort(at.gap, kind="stable")
    count, tied = max(1, system.rigid.shape[1]), np.zeros(len(at.gap), dtype=bool)
    tied[nearest[:count]] = True
    while count < len(nearest) and not system.holds(tied):
        count *= 2
        tied[nearest[:count]] = True
    pulling = system.gap_operator.T @ (system.law.stiffness * np.where(tied, np.maximum(at.gap, 0.0), 0.0))
    return tangents.solved(tied | (at.gap <= 0), at.residual - pulling)


def exact_step(system: System, free: Array, direction: Array) -> float:
    """Minimise the energy along a direction exactly.

    Its slope there is φ'(t) = a + b t + Σ_A ε A_A min(g_A + t s_A, 0) s_A, which rises piecewise linearly: sort where
    control points open or close, add up the pieces, find the one that crosses zero.

    Returns
    -------
    float
        The minimiser t >= 0; infinite where the energy falls without end.
    """
    gap = system.control_gaps(free)
    rate = (system.gap_operator @ direction) / system.area
    stiffness = system.law.stiffness * system.area
    intercept = float(direction @ (system.stiffness @ free - system.load))
    slope = float(direction @ (system.stiffness @ direction))
    touching = (gap < 0) | ((gap == 0) & (rate < 0))
    intercept += np.sum((stiffness * gap * rate)[touching])
    slope += np.sum((stiffness * rate**2)[touching])
    crosses = (touching & (rate > 0)) | (~touching & (rate < 0))
    times = -gap[crosses] / rate[crosses]
    sign = np.where(touching[crosses], -1.0, 1.0)
    order = np.argsort(times)
    intercepts = intercept + np.concatenate(
        [[0.0], np.cumsum((sign * stiffness[crosses] * (gap * rate)[crosses])[order])]
    )
    slopes = slope + np.concatenate([[0.0], np.cumsum((sign * stiffness[crosses] * rate[crosses] ** 2)[order])])
    starts = np.concatenate([[0.0], times[order]])
    ends = np.concatenate([times[order], [np.inf]])
    with np.errstate(divide="ignore", invalid="ignore"):
        roots = np.where(slopes > 0, -intercepts / slopes, np.inf)
    found = np.flatnonzero(roots <= ends)
    return float(max(roots[found[0]], starts[found[0]])) if found.size else np.inf
