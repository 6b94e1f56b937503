"""Equilibrium under a contact law: Newton's method alone, updates of a multiplier, or the multiplier as an unknown."""

import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from geom2iga.bspline import Array, Mask
from solve.case import Augmentation, Newton
from solve.contact.laws import Law
from solve.linear import SingularMatrixError
from solve.newton import RECENT, ROUNDING, SETTLED, Solution, Status, Step, minimise
from solve.system import System
from solve.tangents import Tangents

ROUNDED = 1e-10  # pressures and gaps below this fraction of the largest are zero


class Start(NamedTuple):
    """Where to begin: displacement and multiplier of a state near by."""

    free: Array  # (free,)
    multiplier: Array  # (m,)


class Settings(NamedTuple):
    """When iterations end."""

    newton: Newton
    augmentation: Augmentation
    size: float  # of the smaller body [length]


def find_equilibrium(
    system: System,
    law: Law,
    settings: Settings,
    tangents: Tangents,
    report: Callable[[Step], None] = lambda step: None,
    start: Start | None = None,
) -> Solution:
    """Find displacement and contact pressure.

    Parameters
    ----------
    system : System
        With the springs of the law.
    report : function
        Is told of each Newton step.

    Returns
    -------
    Solution
        Its pressure is that of the law; its history is that of all Newton steps, and so is what is recent.
    """
    task = _Task(system, law, settings, tangents, report, [], deque(maxlen=RECENT))
    run = {"none": _sprung, "updated": _updated, "solved": _solved}[law.multiplier]
    return run(task, start)._replace(history=tuple(task.history), recent=tuple(task.recent))


class _Task(NamedTuple):
    """What is to be solved, and the steps so far."""

    system: System
    law: Law
    settings: Settings
    tangents: Tangents
    report: Callable[[Step], None]
    history: list[Step]
    recent: deque[Mask]  # which gaps (m,) touched at the end of each of the last steps

    def record(self, step: Step, update: int) -> None:
        """Put down a step and report it."""
        self.history.append(replace(step, number=len(self.history) + 1, update=update))
        self.report(self.history[-1])

    def sprung(self, multiplier: Array, update: int, free: Array | None) -> Solution:
        """Find equilibrium with the springs, for a given multiplier (m,), from a displacement (free,)."""
        shifted = self.system.shifted(self.law.softness * multiplier)
        found = minimise(shifted, self.settings.newton, self.tangents, lambda step: self.record(step, update), free)
        self.recent.extend(found.recent)
        return found


def _sprung(task: _Task, start: Start | None) -> Solution:
    """Penalty: the springs are the law."""
    return task.sprung(np.zeros(len(task.system.area)), 0, start and start.free)


def _updated(task: _Task, start: Start | None) -> Solution:
    """Augmented Lagrange: take the pressure as the multiplier until no gap changes any more (Uzawa).

    Where updates leave the active set as it is, conjugate gradients take all further ones at once. If a gap does not
    agree with that, twice as many plain updates come before the next try; these converge by themselves.
    """
    system, settings = task.system, task.settings.augmentation
    multiplier = start.multiplier if start else np.zeros(len(system.area))
    free, before, plain, wanted = start and start.free, None, 0, 1
    for update in range(settings.max_steps + 1):
        found = task.sprung(multiplier, update, free)
        overlap = np.abs(found.pressure - multiplier) * task.law.softness
        if found.status is not Status.CONVERGED or overlap.max(initial=0.0) <= settings.tolerance * task.settings.size:
            return found
        free, multiplier, active = found.free, found.pressure, found.pressure > 0
        steady = before is not None and np.array_equal(active, before)
        before, plain = active, plain + 1
        if steady and plain > wanted and system.holds(active):
            plain, wanted = 0, 2 * wanted
            with suppress(SingularMatrixError):  # then plain updates go on
                free, pressure = task.tangents.equalised(system, task.law, active, multiplier)
                multiplier = np.maximum(pressure, 0.0)
    return found._replace(status=Status.PENETRATION)


def _solved(task: _Task, start: Start | None) -> Solution:
    """Multiplier as an unknown: primal-dual active set, from where springs settle (Hintermüller, Ito & Kunisch 2003).

    An active set that comes back is a cycle; then the springs take over for ever more updates of the multiplier, which
    converge by themselves (Rockafellar 1976).
    """
    multiplier, free = (start.multiplier, start.free) if start else (np.zeros(len(task.system.area)), None)
    sprung = task.sprung(multiplier, 0, free)
    active, pressure = sprung.pressure > 0, sprung.pressure
    seen, updates = set[bytes](), 0
    while sprung.status is Status.CONVERGED and sprung.pressure.any():
        if len(task.history) > task.settings.newton.max_steps:
            return sprung._replace(status=Status.UNSETTLED)
        if active.tobytes() in seen or not task.system.holds(active):
            for update in range(updates + 1, 2 * updates + 2):
                multiplier = sprung.pressure
                sprung = task.sprung(multiplier, update, sprung.free)
            overlap = np.abs(sprung.pressure - multiplier) * task.law.softness
            if overlap.max() <= ROUNDED * _size(task.law, sprung.free, sprung.pressure):
                return sprung
            active, pressure, updates = sprung.pressure > 0, sprung.pressure, 2 * updates + 1
            seen.clear()
        seen.add(active.tobytes())
        began = time.perf_counter()
        try:
            free, pressure = task.tangents.equalised(task.system, task.law, active, pressure)
        except SingularMatrixError:  # more gaps than displacements that close them: updates decide
            continue
        inner = task.system.stiffness @ free
        step, following, off = _judged(task, free, inner, pressure, active, ROUNDING / SETTLED * sprung.scale)
        task.record(replace(step, seconds=time.perf_counter() - began), updates)
        task.recent.append(following)
        if step.changes == 0:
            status = Status.CONVERGED if max(off, step.residual) <= SETTLED else Status.INACCURATE
            return sprung._replace(status=status, free=free, inner=inner, pressure=pressure)
        active = following
    return sprung


def _judged(
    task: _Task, free: Array, inner: Array, pressure: Array, active: Mask, least: float
) -> tuple[Step, Mask, float]:
    """Put down a step, find the gaps that press next, and by how much those that press are off, relative.

    Inner forces are K v. Those that pull let go, those that overlap close. The residual is relative to a force that is
    not below the least.
    """
    system, law = task.system, task.law
    gap = system.control_gaps(free) + law.compliance * pressure
    size = _size(law, free, pressure)
    pulled = active & (pressure < -ROUNDED * np.abs(pressure).max(initial=0.0))
    closed = ~active & (gap < -ROUNDED * size)
    following = (active & ~pulled) | closed
    forces = (system.load, inner, system.gap_operator.T @ pressure)
    residual = forces[0] - forces[1] + forces[2]
    largest = max(least, *(np.abs(force).max(initial=0.0) for force in forces))
    energy = float(free @ (forces[1] / 2 - forces[0]) + pressure @ (law.compliance * system.area * pressure) / 2)
    relative = float(np.abs(residual).max(initial=0.0) / max(largest, np.finfo(float).tiny))
    changes = int(np.count_nonzero(following != active))
    off = float(np.abs(gap[active]).max(initial=0.0) / max(size, np.finfo(float).tiny))
    return Step(0, relative, int(active.sum()), changes, 1.0, energy, 0.0), following, off


def _size(law: Law, free: Array, pressure: Array) -> float:
    """Largest displacement or overlap, to compare gaps with [length]."""
    return float(max(np.abs(free).max(initial=0.0), np.abs(pressure * law.compliance).max(initial=0.0)))
