"""Try every extreme of scale against problems with known answers.

    python -m tests.robustness.scales                   # the whole table, some minutes
    python -m tests.robustness.scales --only far        # extremes whose name holds a word
    python -m tests.robustness.scales --problem tubes   # one of pressed, squeezed, tubes, bar

Each line: the problem, the extreme, how contact is enforced and the system solved, the error of the stresses, the error
that the condition of the problem allows (`tests.verification.scaled.Scale.tolerance`), a verdict and what the program
said. "ok": within the condition; "warned": beyond it, and said to be; "refused": no result, with a reason, where the
condition allows no equilibrium within 1e-8; "WRONG": anything else, for which the exit status is 1.

`squeezed` presses by an overlap: where the extreme is a gap or overlap, by one of that size. `tubes` is compared with
Lamé's closed form, which its mesh approaches to about 1e-5: what is allowed is the larger of the condition's error and
LIKE times what tubes of ordinary material, size and place show on the same mesh, which must be below FINE.
"""

import argparse
import logging
import sys
from collections import Counter
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from geom2iga.errors import UserError
from solve import Result, Status
from solve.newton import SETTLED
from tests.verification.scaled import STRAIN, Scale, bar, pressed_blocks, squeezed_blocks, stress_error, tubes

EXTREMES = {
    "ordinary": Scale(),
    "size 1e-9": Scale(length=1e-9),
    "size 1e9": Scale(length=1e9),
    "modulus 1e-6": Scale(stress=1e-6),
    "modulus 1e15": Scale(stress=1e15),
    "size 1e-9, modulus 1e15": Scale(length=1e-9, stress=1e15),
    "size 1e9, modulus 1e-6": Scale(length=1e9, stress=1e-6),
    "moduli 1 : 1e8": Scale(ratio=1e8),
    "moduli 1e8 : 1": Scale(ratio=1e-8),
    "spans 1e4 : 1 : 1": Scale(stretch=(1e4, 1.0, 1.0)),
    "spans 1 : 1 : 1e-4": Scale(stretch=(1.0, 1.0, 1e-4)),
    "spans 1 : 1 : 1e4": Scale(stretch=(1.0, 1.0, 1e4)),
    "weights x 1e-3": Scale(weights=1e-3),
    "weights x 1e3": Scale(weights=1e3),
    "weights 1 ... 1e2": Scale(uneven=1e2),
    "weights 1e-3 ... 1e3": Scale(uneven=1e6),
    "Poisson 0": Scale(poisson=0.0),
    "Poisson 0.4999": Scale(poisson=0.4999),
    "1e3 sizes away": Scale(far=1e3),
    "1e6 sizes away": Scale(far=1e6),
    "1e8 sizes away": Scale(far=1e8),
    "size 1e-9, 1e6 sizes away": Scale(length=1e-9, far=1e6),
    **{f"gap {gap:g}": Scale(gap=gap) for gap in (1e-3, 1e-6, 1e-10, 1e-14)},
    **{f"overlap {gap:g}": Scale(gap=-gap) for gap in (1e-3, 1e-6, 1e-10, 1e-14)},
}
ENFORCED: dict[str, dict[str, Any]] = {
    "penalty": {},
    "augmented Lagrange": {"enforcement": "augmented-lagrange"},
    "Lagrange": {"enforcement": "lagrange"},
}
WAYS: dict[str, dict[str, Any]] = {
    **{
        f"{name}, {linear}": {**way, "linear": linear}
        for name, way in ENFORCED.items()
        for linear in ("direct", "iterative")
    },
    "kts": {"method": "kts"},
    "penalty, matching": {"matching": True},
    "penalty, matching, element": {"matching": True, "integration": "element"},
}
PROBLEMS = ("pressed", "squeezed", "tubes", "bar")
BAR = ("penalty, direct", "penalty, iterative")  # the bar has no contact
LIKE = 2.0  # times the error of ordinary tubes: other materials and gaps have another of the same mesh
FINE = 1e-4  # the most that this mesh may be off


class Heard(logging.Handler):
    """What was logged."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a message."""
        self.said.append(record.getMessage())


def tried(problem: str, scale: Scale, way: dict[str, Any]) -> tuple[float, float, Result]:
    """Solve: the error of the stresses, what the condition allows, the result."""
    if problem == "tubes":
        return _with(stress_error(tubes(scale, **way)), scale.tolerance())
    if problem == "bar":
        return _with(stress_error(bar(scale, way.get("linear", "direct"))), scale.tolerance())
    if problem == "pressed":
        return _with(stress_error(pressed_blocks(scale, **way)), scale.tolerance())
    overlap = abs(scale.gap) or STRAIN
    squeezed = squeezed_blocks(replace(scale, gap=0.0), overlap, **way)
    return _with(stress_error(squeezed), scale.tolerance(overlap))


def _with(found: tuple[float, Result], tolerance: float) -> tuple[float, float, Result]:
    return found[0], tolerance, found[1]


@cache
def _of_mesh(**way: Any) -> float:
    """Error that the mesh of the tubes may make: that of ordinary ones, times some, or FINE where these fail."""
    return min(LIKE * stress_error(tubes(Scale(), **way))[0], FINE)


def judged(error: float, tolerance: float, condition: float, status: Status, said: list[str]) -> str:
    """Tell right from wrong."""
    if error <= tolerance:
        return "ok"
    if status is not Status.CONVERGED:
        return "refused" if condition > SETTLED or said else "WRONG"
    return "warned" if said else "WRONG"


def line(problem: str, name: str, way: str) -> tuple[str, str]:
    """Try one combination: a line of the table, and the verdict."""
    heard = Heard()
    logger = logging.getLogger("geom2iga")
    logger.addHandler(heard)
    try:
        error, condition, result = tried(problem, EXTREMES[name], WAYS[way])
        tolerance = max(condition, _of_mesh(**WAYS[way])) if problem == "tubes" else condition
        said = [*heard.said, *(warning for contact in result.contacts for warning in contact.warnings)]
        verdict = judged(error, tolerance, condition, result.status, said)
        said += [] if result.status is Status.CONVERGED else [result.status.value]
    except UserError as stopped:
        error, tolerance, said, verdict = np.inf, 0.0, [str(stopped)], "WRONG"
    finally:
        logger.removeHandler(heard)
    return (
        f"{problem:8} | {name:26} | {way:29} | {error:7.1e} | {tolerance:7.1e} | {verdict:7} | {'; '.join(said)}",
        verdict,
    )


def combinations(only: str, problem: str | None) -> list[tuple[str, str, str]]:
    """What to try: problem, extreme, way."""
    return [
        (each, name, way)
        for each in ([problem] if problem else PROBLEMS)
        for name, scale in EXTREMES.items()
        for way in WAYS
        if only in name
        and not (each == "bar" and way not in BAR)
        and not (each == "tubes" and (scale.uneven > 1 or scale.stretch[0] != scale.stretch[1]))  # rings no longer
        and not (scale.uneven > 1 and "element" in way)  # uneven weights move knot lines: nothing matches any more
    ]


def main() -> int:
    """Print the table; 1 where something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="extremes whose name holds this")
    parser.add_argument("--problem", choices=PROBLEMS, help="left out, all")
    arguments = parser.parse_args()
    logging.getLogger("geom2iga").propagate = False
    verdicts: Counter[str] = Counter()
    for combination in combinations(arguments.only, arguments.problem):
        text, verdict = line(*combination)
        verdicts[verdict] += 1
        print(text, flush=True)
    parts = ", ".join(f"{verdicts[name]} {name}" for name in ("ok", "warned", "refused"))
    print(f"{verdicts.total()} problems: {parts}; {verdicts['WRONG']} wrong")
    return int(verdicts["WRONG"] > 0)


if __name__ == "__main__":
    sys.exit(main())
