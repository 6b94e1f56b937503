"""Semismooth Newton's method with exact line search on the energy."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from geom2iga.bspline import Array
from solve.case import Newton
from solve.linear import DirectSolver, SingularMatrixError, solved
from solve.system import System

SETTLED = 1e-8  # largest relative residual at which rounding may end the iteration


class Status(Enum):
    """How the iteration ended; the text says what to do."""

    CONVERGED = "converged"
    MAX_STEPS = "no equilibrium within the allowed Newton steps: raise solve.newton.max_steps"
    UNBOUNDED = "a body is pulled off and nothing holds it: check the direction of the loads, or add a support"
    SINGULAR = "the tangent is singular: check that every body is held, and that moduli and penalty are not extreme"
    INACCURATE = "rounding errors stop the iteration before equilibrium: lower the penalty or bring the bodies closer"


@dataclass(frozen=True)
class Step:
    """One Newton step, as seen after it."""

    number: int
    residual: float  # largest force out of balance, over the largest force seen so far
    active: int  # control points with pressure
    changes: int  # control points that opened or closed
    length: float  # line search factor
    energy: float
    seconds: float


class Solution(NamedTuple):
    """Where the iteration ended."""

    status: Status
    free: Array  # (free,)
    history: tuple[Step, ...]
    scale: float  # largest force seen


class Iterate(NamedTuple):
    """A point of the iteration."""

    free: Array  # (free,)
    gap: Array  # (m,) control-point gaps [length]
    residual: Array  # (free,) forces out of balance
    scale: float  # largest force seen so far
    relative: float  # largest residual over it


def minimise(
    system: System, settings: Newton, solver: DirectSolver, report: Callable[[Step], None] = lambda step: None
) -> Solution:
    """Minimise the energy.

    The energy is convex and piecewise quadratic: every direction of the semismooth Newton method descends, the line
    search is exact, and the iteration ends after finitely many steps. Where the pressed control points do not hold
    every body, bodies first follow their loads along the rigid motions that nothing resists, until a gap closes.

    Parameters
    ----------
    report : function
        Is told of each step.
    """
    history: list[Step] = []
    at = _iterate(system, np.zeros(len(system.load)))
    floating = not system.holds(np.zeros(len(system.area), dtype=bool))
    held = not floating
    try:
        while (status := _verdict(at.relative, history, settings, held)) is None:
            began = time.perf_counter()
            held = system.holds(at.gap <= 0)
            if floating and not history:
                direction, length = solved(solver, *_tied(system, at)), 1.0
            else:
                direction = _direction(system, at, held, settings, solver)
                length = exact_step(system, at.free, direction)
            if not np.isfinite(length):
                return Solution(Status.UNBOUNDED, at.free, tuple(history), at.scale)
            before, at = at, _iterate(system, at.free + length * direction, at.scale)
            history.append(_step(system, before, at, length, len(history) + 1, time.perf_counter() - began))
            report(history[-1])
    except SingularMatrixError:
        status = Status.SINGULAR
    return Solution(status, at.free, tuple(history), at.scale)


def _step(system: System, before: Iterate, after: Iterate, length: float, number: int, seconds: float) -> Step:
    """Put down what a step did."""
    active = after.gap <= 0
    changes = int(np.count_nonzero(active != (before.gap <= 0)))
    return Step(number, after.relative, int(active.sum()), changes, length, system.energy(after.free), seconds)


def _iterate(system: System, free: Array, scale: float = np.finfo(float).tiny) -> Iterate:
    residual = system.residual(free)
    scale = max(system.force_scale(free), scale)
    return Iterate(free, system.control_gaps(free), residual, scale, float(np.abs(residual).max(initial=0.0)) / scale)


def _verdict(relative: float, history: list[Step], settings: Newton, held: bool) -> Status | None:
    """Decide whether to go on (None).

    Parameters
    ----------
    held : bool
        Whether supports and contact held every body in the last step: only then is a residual that stays rounding.
    """
    if relative <= settings.tolerance:
        return Status.CONVERGED
    if held and len(history) > 1 and history[-1].changes == 0 and relative > history[-2].residual / 2:
        return Status.CONVERGED if relative <= SETTLED else Status.INACCURATE
    return Status.MAX_STEPS if len(history) >= settings.max_steps else None


def _direction(system: System, at: Iterate, held: bool, settings: Newton, solver: DirectSolver) -> Array:
    """Direction (free,) of the next step: Newton's, or a push along rigid motions that nothing resists yet."""
    active = at.gap <= 0
    if not held:
        loose = system.loose(active)
        push = loose @ (loose.T @ at.residual)
        if np.abs(push).max(initial=0.0) > settings.tolerance * at.scale:
            return push
        active = np.ones_like(active)  # nothing pushes: any springs will do
    return solved(solver, system.tangent(active), at.residual)


def _tied(system: System, at: Iterate) -> tuple[csr_array, Array]:
    """First step for bodies that contact alone holds: every candidate is tied by its penalty and pulls too."""
    everywhere = np.ones(len(at.gap), dtype=bool)
    pulling = system.gap_operator.T @ (system.law.stiffness * np.maximum(at.gap, 0.0))
    return system.tangent(everywhere), at.residual - pulling


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
