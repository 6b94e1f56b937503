"""Why a load step did not converge: what is seen of its last steps, and what to try."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from geom2iga.bspline import Array, Mask
from solve.contact.laws import AUTOMATIC
from solve.newton import Solution, Status
from solve.problem import Pass, Problem
from solve.rigid import Pieces, describe, find_pieces
from solve.system import System

USUAL = f'"auto", {AUTOMATIC:g} E/h'
SHOWN = 3  # points or steps of which a remark speaks
TINY, HUGE = 1e-4, 1e6  # times E/h: penalties below and above lose digits
UNEQUAL = 1e8  # ratio of Young's moduli from which digits are lost
INCOMPRESSIBLE = 1e-6  # distance of Poisson's ratio from 0.5 at which digits are lost
FAR = 1e6  # gaps above this multiple of the smallest body lose digits
STILL = 1e-6  # motions below this fraction of the largest are none
LARGEST_TOLERANCE = 1e-3  # largest tolerance that can be asked for


@dataclass(frozen=True)
class Diagnosis:
    """What is known of a load step that did not converge.

    Parameters
    ----------
    load_step, load_steps : int
        Which one it was, from 1, and of how many.
    seen : tuple of str
        What its last steps show.
    advice : tuple of str
        What to try, the most promising first.
    """

    load_step: int
    load_steps: int
    seen: tuple[str, ...]
    advice: tuple[str, ...]

    @property
    def shown(self) -> str:
        """Say which load step a result that holds those before shows."""
        return f"NOT CONVERGED: shows load step {self.load_step - 1} of {self.load_steps}"

    @property
    def lines(self) -> tuple[str, ...]:
        """What is seen, and what to try."""
        return (*self.seen, *(f"try {number}: {text}" for number, text in enumerate(self.advice, start=1)))

    def __str__(self) -> str:
        return "\n".join([f"load step {self.load_step} of {self.load_steps} did not converge", *self.lines])


class Remark(NamedTuple):
    """Something that is seen, and what to try because of it."""

    seen: str
    advice: tuple[str, ...] = ()


class Failure(NamedTuple):
    """Where the iteration gave up."""

    problem: Problem
    system: System  # under the loads of the step
    solution: Solution

    def passes(self, *values: Array | Mask) -> Iterator[tuple[Pass, list[Any]]]:
        """Yield each pass that has gaps with its part of values of all gaps (..., m)."""
        ends = np.cumsum([len(part.mortar.area) for part in self.problem.passes])[:-1]
        parts = [np.split(each, ends, axis=-1) for each in values]
        for number, part in enumerate(self.problem.passes):
            if len(part.mortar.area):
                yield part, [each[number] for each in parts]


Look = Callable[[Failure], Iterator[Remark]]


def diagnose(problem: Problem, system: System, solution: Solution, load_step: int) -> Diagnosis:
    """Look for what kept a load step from convergence.

    Parameters
    ----------
    system : System
        Under the loads of the step.
    solution : Solution
        Where its iteration ended; not converged.
    load_step : int
        From 1.
    """
    failure = Failure(problem, system, solution)
    remarks = [remark for look in LOOKS[solution.status] for remark in look(failure)]
    advice = dict.fromkeys([text for remark in remarks for text in remark.advice])
    seen = tuple(remark.seen for remark in remarks)
    return Diagnosis(load_step, len(problem.case.steps.shares), seen, tuple(advice))


def _flickering(failure: Failure) -> Iterator[Remark]:
    """Find the gaps that opened or closed again and again."""
    recent = np.array(failure.solution.recent)
    for part, (active,) in failure.passes(recent) if len(recent) > 1 else ():
        count = np.count_nonzero(active[1:] != active[:-1], axis=0)
        changed = int(np.count_nonzero(count))
        if changed:
            worst = _places(part.mortar.centres[np.argsort(-count, kind="stable")[: min(SHOWN, changed)]])
            steps = "step" if len(recent) == 2 else f"{len(recent) - 1} steps"
            yield Remark(
                f"{_named(part)}: {changed} of {len(count)} gaps opened or closed in the last {steps}, most often near "
                f"{worst}",
                tuple(_calming(part)),
            )


def _calming(part: Pass) -> Iterator[str]:
    """Say what lets fewer gaps of a pass open and close."""
    if AUTOMATIC < _stiffness(part) < np.inf:
        yield f"a lower penalty in the {_named(part)}, such as {USUAL}; now {_stiffness(part):.3g} E/h"
    if part.definition.method == "kts":
        yield f'method = "mortar" in the {_named(part)}'
    if part.definition.two_pass:
        yield f"two_pass = false in the {_named(part)}"
    if part.definition.enforcement == "lagrange":
        yield f'enforcement = "penalty" in the {_named(part)}'


def _steps(failure: Failure) -> Iterator[Remark]:
    """Say how the residual went, and that there may be too few steps."""
    allowed = failure.problem.case.newton.max_steps
    residuals = [step.residual for step in failure.solution.history[-SHOWN:]]
    advice = f"solve.newton.max_steps above {allowed}"
    yield Remark(f"residuals of the last steps: {', '.join(f'{each:.2g}' for each in residuals)}", (advice,))


def _unbalanced(failure: Failure) -> Iterator[Remark]:
    """Find the control point where forces are farthest from balance."""
    system, solution, space = failure.system, failure.solution, failure.problem.space
    free = system.load - solution.inner + system.gap_operator.T @ solution.pressure
    residual = (failure.problem.allowed.matrix @ free).reshape(-1, 3)
    if not residual.any() or not np.isfinite(residual).all():
        return
    point, axis = (int(n) for n in np.unravel_index(np.argmax(np.abs(residual)), residual.shape))
    body = next(name for name in space.model.bodies if point in space.body_numbers(name))
    case = failure.problem.case
    groups = [g for contact in case.contact for g in (contact.secondary, contact.primary)]
    groups += [support.on for support in case.support] + [load.on for load in case.load]
    faces = [f'"{group}"' for group in dict.fromkeys(groups) if point in space.group_numbers(group)]
    on = f", on {' and '.join(faces)}" if faces else ""
    yield Remark(
        f'the largest force out of balance is {np.abs(residual).max():.3g} along {"xyz"[axis]} in body "{body}" near '
        f"{_places(space.control_points[[point]])}{on}"
    )


def _overlapping(failure: Failure) -> Iterator[Remark]:
    """Find the worst gap that updates of the multiplier have left: one that overlaps, or presses though it is open."""
    settings, solution = failure.problem.case.augmentation, failure.solution
    for part, (gap, pressure) in failure.passes(failure.system.control_gaps(solution.free), solution.pressure):
        wrong = np.where(pressure > 0, np.abs(gap), -gap)
        worst, stiffness = int(np.argmax(wrong)), _stiffness(part)
        if part.law.multiplier != "updated" or wrong[worst] <= 0:
            continue
        what = "the bodies overlap by" if gap[worst] < 0 else "a gap that presses is open by"
        higher = f"a higher penalty in the {_named(part)}, such as {USUAL}; now {stiffness:.3g} E/h"
        yield Remark(
            f"{_named(part)}: {what} {wrong[worst]:.3g} near {_places(part.mortar.centres[[worst]])}, "
            f"{wrong[worst] / failure.problem.size:.2g} of the smallest body; allowed {settings.tolerance:.2g}",
            (
                f'enforcement = "lagrange", without a penalty, in the {_named(part)}',
                *((higher,) if stiffness < AUTOMATIC else ()),
                f"solve.augmentation.max_steps above {settings.max_steps}",
            ),
        )


def _pulled(failure: Failure) -> Iterator[Remark]:
    """Say which bodies the loads pull off, and which way."""
    drift = failure.solution.drift
    if drift is None:
        return
    pieces = find_pieces(failure.problem.space)
    motions = _motions(pieces, failure.problem.allowed.matrix @ drift[:, None])[:, :, 0]
    moved = np.abs(motions).max(axis=1)
    for name, motion in zip(pieces.names, motions, strict=True):
        if np.abs(motion).max() > STILL * moved.max():
            yield Remark(
                f"{name} is pulled off: it {_moves(motion)}, and no gap closes on the way",
                ("loads of the other sign, here or in [solve.steps]", f"a support that resists this motion of {name}"),
            )


def _loose(failure: Failure) -> Iterator[Remark]:
    """Say which bodies contact alone holds."""
    pieces = find_pieces(failure.problem.space)
    for name, motions in zip(pieces.names, _motions(pieces, failure.problem.rigid), strict=True):
        ways = describe(motions)
        if ways:
            yield Remark(f"contact alone holds {name}, which else can {ways}", (f"a support of {name}",))


def _extremes(failure: Failure) -> Iterator[Remark]:
    """Find numbers of the case that differ too much in size."""
    problem = failure.problem
    for part, _ in failure.passes():
        stiffness = _stiffness(part)
        if part.law.multiplier != "solved" and not TINY <= stiffness <= HUGE:
            advice = f"another penalty in the {_named(part)}, such as {USUAL}"
            yield Remark(f"{_named(part)}: the penalty is {stiffness:.3g} E/h", (advice,))
        gap = float(np.abs(part.mortar.initial_gap / part.mortar.area).max(initial=0.0))
        if gap > FAR * problem.size:
            far = f"{_named(part)}: gaps of {gap:.3g} are {gap / problem.size:.2g} times as large as the smallest body"
            yield Remark(far, ("bodies that lie closer together",))
    moduli = [material.young for material in problem.materials.values()]
    if max(moduli) > UNEQUAL * min(moduli):
        seen = f"Young's moduli lie between {min(moduli):.3g} and {max(moduli):.3g}"
        yield Remark(seen, ("moduli nearer to each other: the stiffer body is as good as rigid long before",))
    for name, material in problem.materials.items():
        if 0.5 - material.poisson < INCOMPRESSIBLE:
            seen = f'body "{name}" is all but incompressible: Poisson\'s ratio is {material.poisson:.15g}'
            yield Remark(seen, (f'a lower Poisson\'s ratio of body "{name}", such as 0.4999',))


def _rounded(failure: Failure) -> Iterator[Remark]:
    """Say how far the residual came."""
    reached = failure.solution.history[-1].residual if failure.solution.history else np.inf
    if reached < LARGEST_TOLERANCE:
        advice = f"solve.newton.tolerance above {reached:.1e}, if that is close enough"
        yield Remark(f"the residual does not fall below {reached:.1e}", (advice,))


def _slow(failure: Failure) -> Iterator[Remark]:
    """Say that there is another linear solver."""
    yield Remark("conjugate gradients were stopped", ('solve.linear.method = "direct"',))


def _divided(failure: Failure) -> Iterator[Remark]:
    """Say how many load steps there are."""
    count = len(failure.problem.case.steps.shares)
    seen = "all loads act at once" if count == 1 else f"there are {count} load steps"
    advice = "more load steps, by solve.steps: each begins nearer to its end, and those that converge can be looked at"
    yield Remark(seen, (advice,))


LOOKS: Mapping[Status, tuple[Look, ...]] = {
    Status.MAX_STEPS: (_steps, _flickering, _unbalanced, _divided),
    Status.UNSETTLED: (_flickering, _divided),
    Status.PENETRATION: (_overlapping, _flickering),
    Status.UNBOUNDED: (_pulled,),
    Status.SINGULAR: (_extremes, _loose),
    Status.SLOW: (_extremes, _slow, _unbalanced),
    Status.INACCURATE: (_extremes, _rounded, _unbalanced),
}


def _named(part: Pass) -> str:
    """Name the contact of a pass."""
    return f'contact of "{part.definition.secondary}" with "{part.definition.primary}"'


def _stiffness(part: Pass) -> float:
    """Penalty of a pass in units of E/h; infinite for a multiplier."""
    return float(part.penalty / np.min(part.law.bodies, initial=np.inf))


def _places(points: Array) -> str:
    """Write some points (k, 3)."""
    names = [f"({', '.join(f'{x + 0.0:.4g}' for x in point)})" for point in points]
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _motions(pieces: Pieces, motions: Array) -> Array:
    """Slides and turns (pieces, 6, k), about their centres, of rigid motions (dofs, k)."""
    count = len(pieces.names)
    moved, found = motions.reshape(len(pieces.owner), 3, -1), np.zeros((count, 6, motions.shape[1]))
    for piece in range(count):
        own: Mask = pieces.owner == piece
        arm, slide = pieces.arm[own], moved[own].mean(axis=0)
        turning = np.cross(np.eye(3)[None], arm[:, None]).swapaxes(1, 2).reshape(-1, 3)
        rest = (moved[own] - slide).reshape(len(turning), -1)
        found[piece] = np.concatenate([slide, np.linalg.lstsq(turning, rest)[0]])
    return found


def _moves(motion: Array) -> str:
    """Say in words how a body moves, slides before turns (6,)."""
    parts = [
        f"{verb} {_heading(part)}"
        for verb, part in (("moves along", motion[:3]), ("turns about", motion[3:]))
        if np.abs(part).max() > STILL * np.abs(motion).max()
    ]
    return " and ".join(parts)


def _heading(vector: Array) -> str:
    """Name a direction (3,): an axis with its sign, or components."""
    unit = vector / np.linalg.norm(vector)
    axis = int(np.argmax(np.abs(unit)))
    if abs(unit[axis]) > 1 - STILL:
        return f"{'-' if unit[axis] < 0 else '+'}{'xyz'[axis]}"
    return f"({', '.join(f'{x + 0.0:.2g}' for x in unit)})"
