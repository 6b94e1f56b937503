"""Semismooth Newton's method with exact line search on the energy."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np

from geom2iga.bspline import Array, Mask
from solve.case import Newton
from solve.linear import SingularMatrixError, SlowError, SuperLU
from solve.system import System
from solve.tangents import Factorised, Tangents

APPROACHES = 5  # in which the area on which rigid bodies rest is found
SETTLED = 1e-8  # largest relative residual at which rounding may end the iteration without a word
ROUGH = 1e-6  # and at all
COARSE, FINE = 1e-3, 1e-5  # relative tolerance of linear solutions while gaps open and close, and when none does
SURPLUS = 10.0  # by which the last linear solution is better than the tolerance of the whole asks for
ROUNDING = 1e-14  # residual, over the largest force that ever acted, that is a rounding error
RECENT = 10  # last states of the gaps that are remembered


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
    SLOW = 'conjugate gradients do not converge: take solve.linear.method = "direct"'
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
    inner: Array  # (free,) forces of the stresses, K v
    pressure: Array  # (m,)
    history: tuple[Step, ...]
    scale: float  # largest force seen
    recent: tuple[Mask, ...]  # which gaps (m,) touched at the end of each of the last steps
    drift: Array | None = None  # (free,) motion along which the energy falls without end


class Iterate(NamedTuple):
    """A point of the iteration."""

    free: Array  # (free,)
    inner: Array  # (free,) forces of the stresses, K v
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

    The energy is convex and piecewise quadratic. A full step of the semismooth Newton method leads to the minimum for
    its active set; where the energy would rise, the step that is exactly best along the same direction is taken. So
    the energy falls from step to step, no active set comes back, and the iteration ends after finitely many steps.
    Where the pressed control points do not hold every body, bodies follow their loads along the rigid motions that
    nothing resists, until a gap closes.

    Parameters
    ----------
    report : function
        Is told of each step.
    start : (free,)
        Where to begin; left out, undeformed, bodies that contact alone holds where they balance as rigid ones.
    """
    history: list[Step] = []
    drift = None
    start = _balanced(system, settings) if start is None else start
    undeformed = np.zeros(len(system.load))
    at = iterate(system, start, system.force_scale(undeformed, undeformed))
    held, recent = system.holds(np.zeros(len(system.area), dtype=bool)), deque([at.gap <= 0], RECENT)
    try:
        while (status := _verdict(at, history, settings, held)) is None:
            began = time.perf_counter()
            held = system.holds(at.gap <= 0)
            direction, rigid = _direction(system, at, held, settings, tangents, history)
            before, at, length = at, iterate(system, at.free + direction, at.largest), 1.0
            if not held or (at.energy > before.energy and at.active != before.active):
                inner = np.zeros_like(direction) if rigid else system.stiffness @ direction
                length = exact_step(system, before, direction, inner)
                if not np.isfinite(length):
                    status, at, drift = Status.UNBOUNDED, before, direction
                    break
                at = _evaluated(system, before.free + length * direction, before.inner + length * inner, before.largest)
            history.append(_step(before, at, length, len(history) + 1, time.perf_counter() - began))
            recent.append(at.gap <= 0)
            report(history[-1])
    except SlowError:
        status = Status.SLOW
    except SingularMatrixError:
        status = Status.SINGULAR
    pressure = system.law.pressure(at.gap)
    return Solution(status, at.free, at.inner, pressure, tuple(history), at.largest, tuple(recent), drift)


def _balanced(system: System, settings: Newton) -> Array:
    """Displacement (free,) of bodies that contact alone holds, in equilibrium as rigid ones on elastic half-spaces."""
    motions, free = system.rigid.shape[1], len(system.load)
    if motions == free or system.holds(np.zeros(len(system.area), dtype=bool)):
        return np.zeros(free)
    rigid, count = system.rigidly(), 0
    for _ in range(APPROACHES):
        yielding = replace(rigid, law=system.law.yielding(count))
        found = minimise(yielding, settings, Factorised(yielding.tangent, SuperLU()))
        before, count = count, int(np.count_nonzero(found.pressure))
        if count == before:
            break
    return system.rigid @ found.free


def _step(before: Iterate, after: Iterate, length: float, number: int, seconds: float) -> Step:
    """Put down what a step did."""
    active = after.gap <= 0
    changes = int(np.count_nonzero(active != (before.gap <= 0)))
    return Step(number, after.relative, int(active.sum()), changes, length, after.energy, seconds)


def iterate(system: System, free: Array, largest: float = 0.0) -> Iterate:
    """Evaluate a displacement (free,)."""
    return _evaluated(system, free, system.stiffness @ free if free.any() else free, largest)


def _evaluated(system: System, free: Array, inner: Array, largest: float) -> Iterate:
    scale = system.force_scale(free, inner)
    gap, residual = system.control_gaps(free), system.residual(free, inner)
    return Iterate(free, inner, gap, residual, system.energy(free, inner), scale, max(scale, largest))


def _verdict(at: Iterate, history: list[Step], settings: Newton, held: bool) -> Status | None:
    """Decide whether to go on (None).

    Parameters
    ----------
    held : bool
        Whether supports and contact held every body in the last step: only then is a residual that stays rounding.
    """
    if at.relative <= settings.tolerance:
        return Status.CONVERGED
    if held and len(history) > 1 and at.relative > history[-2].residual / 2:
        if at.error <= ROUNDING * at.largest:
            return Status.CONVERGED
        if history[-1].length == 1 and history[-1].changes == 0:
            return Status.CONVERGED if at.relative <= ROUGH else Status.INACCURATE
    return Status.MAX_STEPS if len(history) >= settings.max_steps else None


def _direction(
    system: System, at: Iterate, held: bool, settings: Newton, tangents: Tangents, history: list[Step]
) -> tuple[Array, bool]:
    """Direction (free,) of the next step: Newton's, or a rigid push along motions that nothing resists yet."""
    active = at.gap <= 0
    if not held:
        loose = system.loose(active)
        push = loose @ (loose.T @ at.residual)
        if np.abs(push).max(initial=0.0) > settings.tolerance * at.largest:
            return push, True
        active = np.ones_like(active)  # nothing pushes: any springs will do
    return tangents.solved(active, at.residual, _sought(at, settings, history) if held else COARSE), False


def _sought(at: Iterate, settings: Newton, history: list[Step]) -> float:
    """Relative tolerance of the next linear solution: no less than the last one was worth, no more than is wanted."""
    if history and history[-1].changes:
        return COARSE
    before = [step.residual for step in history if step.changes == 0][-2:]
    worth = before[1] / before[0] if len(before) == 2 else 0.0
    return min(COARSE, max(FINE, worth / 2, settings.tolerance / at.relative / SURPLUS))


def exact_step(system: System, at: Iterate, direction: Array, inner: Array) -> float:
    """Minimise the energy along a direction (free,) with inner forces (free,) exactly.

    Its slope there is φ'(t) = a + b t + Σ_A ε A_A min(g_A + t s_A, 0) s_A, which rises piecewise linearly: sort where
    control points open or close, add up the pieces, find the one that crosses zero.

    Returns
    -------
    float
        The minimiser t >= 0; infinite where the energy falls without end.
    """
    gap = at.gap
    rate = (system.gap_operator @ direction) / system.area
    stiffness = system.law.stiffness * system.area
    intercept = float(direction @ (at.inner - system.load))
    slope = float(direction @ inner)
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
