"""Contact from ten thousand to a million unknowns: time, memory, iterations; and the two ways to solve side by side.

python -m tests.benchmarks.scaling

The patch test of two blocks whose knot lines do not match, pressed between supports, and Hertz' sphere on a block with
its spans cut into halves. Each run is a process of its own; times are those of `solve.solve`, cells, loads and supports
included, gmsh and imports left out. Does not measure post-processing.
"""

import argparse
import multiprocessing
import statistics
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

from geom2iga.threads import thread_count
from tests.benchmarks.harness import machine, markdown, publish

EXAMPLE = Path(__file__).parents[2] / "examples" / "hertz_sphere" / "case.toml"
BLOCKS = ((2, 12, 10), (2, 24, 22), (2, 38, 36), (2, 56, 52), (1, 57, 53), (3, 54, 52), (4, 53, 51))
HERTZ = ((2, 1), (3, 1), (2, 2), (3, 2))
BOTH = (("two blocks", (2, 20, 18)), ("two blocks", (3, 18, 17)), ("Hertz", (2, 1)))
HEADER = (
    *("job", "degree", "linear systems", "unknowns", "s", "µs per unknown"),
    *("Newton steps", "iterations", "residual", "MB"),
)
QUICK = 10.0  # seconds; what takes longer is run once

Row = dict[str, Any]


def blocks(degree: int, lower: int, upper: int) -> tuple[Any, Row]:
    """Two blocks of so many spans in each direction."""
    import geom2iga
    from tests.cases import patch_test_case

    case = patch_test_case(degree, (lower,) * 3, (upper,) * 3, penalty="auto")
    return geom2iga.build(case), case


def hertz(degree: int, parts: int) -> tuple[Any, Row]:
    """The example of that name, every span cut into so many."""
    import geom2iga
    from geom2iga.patch import refined

    case = tomllib.loads(EXAMPLE.read_text())
    case["geometry"]["degree"] = degree
    model = geom2iga.build(case)
    fine = {name: refined(patch, spans=parts) for name, patch in model.patches.items()}
    return replace(model, patches=fine), case


def analyse(job: str, settings: tuple[int, ...], method: str) -> Row:
    """Solve one job in this process."""
    import solve

    model, case = (blocks if job == "two blocks" else hertz)(*settings)
    case["solve"]["linear"] = {"method": method}
    result = solve.solve(model, case)
    if result.status is not solve.Status.CONVERGED:
        raise RuntimeError(f"{job} {settings}: {result.status.value}")
    statistics_ = result.statistics
    return {
        "job": job,
        "degree": settings[0],
        "way": statistics_["linear_solver"],
        "unknowns": statistics_["dofs"],
        "seconds": sum(statistics_["seconds"].values()),
        "newton": statistics_["newton_iterations"],
        "linear": statistics_["linear_iterations"],
        "memory": statistics_["peak_memory"] / 2**20,
        "residual": result.history[-1].residual,
    }


def measured(repeats: int, *job: Any) -> Row:
    """Run a job in processes of its own; the run of median time."""
    runs: list[Row] = []
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        while not runs or (len(runs) < repeats and runs[0]["seconds"] < QUICK):
            runs.append(pool.apply(analyse, job))
    middle = statistics.median_low([run["seconds"] for run in runs])
    found = next(run for run in runs if run["seconds"] == middle)
    print(job, found, flush=True)
    return found


def cells(row: Row) -> list[str]:
    """One row of the table."""
    each = 1e6 * row["seconds"] / row["unknowns"]
    return [
        *(str(row[name]) for name in ("job", "degree", "way")),
        f"{row['unknowns']:,}",
        f"{row['seconds']:.2f}",
        f"{each:.0f}",
        *(str(row[name]) for name in ("newton", "linear")),
        f"{row['residual']:.0e}",
        f"{row['memory']:.0f}",
    ]


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    options.add_argument("--repeats", type=int, default=5, help="of what takes less than 10 s")
    options.add_argument("--write", type=Path, help="put the table between its marks in this file, too")
    chosen = options.parse_args()
    jobs = [("two blocks", settings, "iterative") for settings in BLOCKS]
    jobs += [("Hertz", settings, "iterative") for settings in HERTZ]
    jobs += [(job, settings, method) for job, settings in BOTH for method in ("iterative", "direct")]
    rows = [measured(chosen.repeats, *job) for job in jobs]
    table = markdown(HEADER, map(cells, rows))
    publish(f"{machine(thread_count())}.\n\n{table}", "scaling", chosen.write)


if __name__ == "__main__":
    main()
