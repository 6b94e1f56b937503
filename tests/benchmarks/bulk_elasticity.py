"""How long linear elasticity takes by ours and by the peers that are installed: one patch, clamped, body force.

python -m tests.benchmarks.bulk_elasticity                                    1 to 4, 16 and 32 spans: hours
python -m tests.benchmarks.bulk_elasticity --degrees 2 --spans 16 --geometries cube
python -m tests.benchmarks.bulk_elasticity --write tests/benchmarks/README.md

All solve the same space, from the same knots, control points and weights, to a residual of 1e-8 of the load. Each run
is a process of its own; all take turns. The job is what follows the imports, the compiling of forms and the making or
reading of the geometry. Not measured: the writing of results, other materials, several patches.
"""

import argparse
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path

from tests.benchmarks import harness
from tests.benchmarks.harness import Found, Peer, Settings

OURS = Peer("ours", "elasticity_ours.py", harness.OURS)
PEERS = (
    Peer("igaops", "elasticity_igaops.py", "igaops"),
    Peer("nutils", "elasticity_nutils.py", "nutils"),
    Peer("MFEM", "elasticity_mfem.py", "mfem"),
    Peer("sfepy", "elasticity_sfepy.py", "sfepy"),
    Peer("Yeti", "elasticity_yeti.py", "yeti_iga"),
    Peer("pyiga", "elasticity_pyiga.py", "pyiga"),
    Peer("psydac", "elasticity_psydac.py", "psydac"),
)
PREPARE = Peer("prepare", "prepare.py", harness.OURS)
GEOMETRIES = ("cube", "ring")
JOB = ("set-up", "assembly", "solve")
HEADER = (
    *("code", "version", "imports s", "compiling s", "set-up s", "solve s", "job s", "times ours"),
    *("iterations", "solver", "peak MB", "energy off by", "runs"),
)
AGREES = 1e-4  # relative difference of energies, for other rules of quadrature
AGREES_NEARLY = 1e-2  # of those that solve another space


def jobs(options: argparse.Namespace) -> Iterator[tuple[str, int, int]]:
    """Geometry, degree and spans of each job; a quarter circle needs degree 2."""
    for geometry, degree, spans in product(options.geometries, options.degrees, options.spans):
        if geometry == "cube" or degree > 1:
            yield geometry, degree, spans


def prepared(folder: str, job: tuple[str, int, int], how: Settings) -> str:
    """Write the files of a job."""
    path = str(Path(folder) / ("-".join(map(str, job)) + ".npz"))
    found = harness.run(PREPARE, (path, *map(str, job)), how)
    if not Path(path).exists():
        raise SystemExit(f"no job: {found['failed']}")
    return path


def rows(runs: dict[Peer, list[Found]], first: Peer) -> Iterator[list[str]]:
    """What each code took."""
    ours = runs[first]
    for peer, found in runs.items():
        last = found[-1]
        off = abs(last["energy"] / ours[-1]["energy"] - 1)
        unlike = last.get("unlike_space", False)
        wrong = off > (AGREES_NEARLY if unlike else AGREES)
        compiling = harness.seconds(found, "compiling")
        yield [
            peer.name,
            last["version"],
            f"{harness.seconds(found, 'imports'):.2f}",
            f"{compiling:.2f}" if compiling else "",
            f"{harness.seconds(found, 'set-up', 'assembly'):.2f}",
            f"{harness.seconds(found, 'solve'):.2f}",
            f"{harness.seconds(found, *JOB):.2f}",
            f"{harness.ratio(found, ours, *JOB):.1f}",
            str(last["iterations"]),
            last["solver"],
            f"{last['peak'] / 1e6:.0f}",
            f"{off:.0e}" + (" (not rational)" if unlike else "") + (" WRONG" if wrong else ""),
            str(len(found)),
        ]


def section(job: tuple[str, int, int], runs: dict[Peer, list[Found]], first: Peer) -> str:
    """Heading, table and what has no numbers of one job."""
    held = harness.with_numbers(runs)
    unmeasured = "; ".join(harness.reasons(runs))
    if not held:
        return f"**{job}**: {unmeasured}."
    first = first if first in held else next(iter(held))  # without ours the ratios are to the first that has numbers
    last = held[first][-1]
    heading = (
        f"**{job[0]}, degree {job[1]}, {job[2]}³ spans, {last['unknowns']} unknowns**, energy {last['energy']:.10g}"
    )
    table = harness.markdown(HEADER, rows(held, first))
    return "\n\n".join([heading, table] + ([f"Without numbers: {unmeasured}."] if unmeasured else []))


def arguments(description: str) -> argparse.ArgumentParser:
    """The options of the elasticity benchmarks."""
    options = harness.parser(description)
    options.add_argument("--geometries", nargs="+", default=list(GEOMETRIES), choices=GEOMETRIES)
    options.add_argument("--degrees", nargs="+", type=int, default=[1, 2, 3, 4])
    options.add_argument("--spans", nargs="+", type=int, default=[16, 32])
    return options


def main() -> None:
    """Print the tables, and put them into a file where one is named."""
    parser = arguments(__doc__)
    parser.add_argument(
        "--method", default="auto", choices=("auto", "direct", "iterative"), help="linear solver of ours"
    )
    options = parser.parse_args()
    how = harness.settings(options)
    ours = Peer(OURS.name, OURS.script, OURS.module, (options.method,))
    peers, missing = harness.installed((ours, *PEERS), how)
    sections = [harness.machine(how.threads) + ".", harness.not_installed(missing)]
    with harness.scratch() as folder:
        for job in jobs(options):
            runs = harness.interleaved(peers, (prepared(folder, job, how),), how)
            sections.append(section(job, runs, ours))
            print(sections[-1], file=sys.stderr, flush=True)
    harness.publish("\n\n".join(sections), "bulk elasticity", how.write)


if __name__ == "__main__":
    main()
