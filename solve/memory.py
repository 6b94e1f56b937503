"""Which way linear systems are solved, and whether the machine has the memory for it."""

from collections.abc import Mapping
from math import prod

from geom2iga.limits import check_memory, free_memory
from geom2iga.threads import thread_count
from solve.bricks import SPANS, THREADED
from solve.complement import DENSE
from solve.linear import DirectSolver
from solve.problem import Problem
from solve.rules import Rules, exact_rules, smooth_rules
from solve.space import Space, is_straight

FEW = 5_000  # unknowns up to which factors are faster
FEW_PER_PATCH = 500  # unknowns of a patch below which its part of an iteration costs more than it is worth
FILL = 240.0  # bytes of factors: so many times N^(4/3) p^1.5, measured with PARDISO on cubes of degree 1 to 4
COPIES = 3  # of the matrix: all, free, with contact; 3.6, 3.0 and 2.5 on two blocks in contact, degree 1, 2 and 3
KEPT = 40_000_000  # numbers of exactly integrated maps that are kept from one application to the next
VECTORS = 32  # of double precision that an analysis holds at once
SCRATCH = 250.0  # bytes per quadrature point of the brick that a thread works on, measured on cubes of degree 1 to 4


def is_iterative(problem: Problem) -> bool:
    """Whether linear systems are solved by conjugate gradients: as the case says, or where that is the faster way."""
    method, patches = problem.case.linear.method, len(problem.space.model.patches)
    return method == "iterative" or (method == "auto" and problem.allowed.size > FEW + FEW_PER_PATCH * (patches - 1))


def needed(problem: Problem, solver: DirectSolver | None) -> float:
    """Estimate the memory that a direct solver, or conjugate gradients, takes [bytes]."""
    return _of_factors(problem, solver.fill) if solver else _of_iterations(problem)


def fits(problem: Problem, solver: DirectSolver | None) -> bool:
    """Whether so much is free."""
    return needed(problem, solver) <= free_memory()


def check_solver(problem: Problem, solver: DirectSolver | None) -> None:
    """Raise CaseError where it is not."""
    advice = "take fewer spans or a lower degree"
    if solver:
        advice += ', or solve.linear.method = "iterative"'
    check_memory(f"{problem.allowed.size} unknowns", needed(problem, solver), advice)


def map_numbers(space: Space, rules: Mapping[str, Rules]) -> int:
    """How many numbers describe the maps of all patches at quadrature points."""
    return sum(
        (1 if is_straight(patch) else 12) * prod(len(rule.points) for rule in rules[name])
        for name, patch in space.model.patches.items()
    )


def _of_factors(problem: Problem, fill: float) -> float:
    """Memory of the matrix and its factors [bytes]."""
    patches = problem.space.model.patches.values()
    degree = max(max(patch.degrees) for patch in patches)
    entries = sum(9 * prod(patch.shape) * prod(2 * p + 1 for p in patch.degrees) for patch in patches)
    factors = fill * FILL * degree**1.5 * problem.allowed.size ** (4 / 3)
    return 8.0 * VECTORS * problem.space.dofs + 12.0 * COPIES * entries + factors


def _of_iterations(problem: Problem) -> float:
    """Memory of what conjugate gradients keep [bytes]."""
    space = problem.space
    exact = exact_rules(space)
    maps = map_numbers(space, smooth_rules(space)) + 2 * min(map_numbers(space, exact), KEPT)
    gaps = len(problem.mortar.area)
    sides = [prod(space.face_grid(face).shape) for face in problem.touching]
    dense = 2 * gaps**2 + 2 * max(sides, default=0) ** 2 if gaps <= DENSE else 0
    return 8.0 * (VECTORS * space.dofs + dense) + 4.0 * maps + _of_scratch(space, exact)


def _of_scratch(space: Space, rules: Mapping[str, Rules]) -> float:
    """Memory of what threads work on [bytes]."""
    threads = thread_count()
    most = SPANS * THREADED if threads > 1 else SPANS
    sizes = [
        (prod(len(rule.points) for rule in each), prod(len(rule.counts) for rule in each)) for each in rules.values()
    ]
    points = max(points * min(1.0, most / spans) for points, spans in sizes)
    return SCRATCH * threads * points
