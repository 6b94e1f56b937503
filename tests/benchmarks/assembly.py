"""How long the assembly of the stiffness takes by ours and by the peers that assemble, and how much memory.

python -m tests.benchmarks.assembly
python -m tests.benchmarks.assembly --degrees 2 3 --spans 16 --write tests/benchmarks/README.md

The matrix of all degrees of freedom of one patch, in rows. Time and memory are those of set-up and assembly together;
"growth" is how far the memory rises above where it stood before, the matrix included. Not measured: several patches.
"""

import sys
from collections.abc import Iterator

from tests.benchmarks import harness
from tests.benchmarks.bulk_elasticity import OURS, PEERS, arguments, jobs, prepared
from tests.benchmarks.harness import Found, Peer

JOB = ("set-up", "assembly")
HEADER = (
    "code",
    "version",
    "compiling s",
    "assembly s",
    "times ours",
    "matrix MB",
    "growth MB",
    "growth / matrix",
    "runs",
)


def rows(runs: dict[Peer, list[Found]], first: Peer) -> Iterator[list[str]]:
    """What each code took."""
    for peer, found in runs.items():
        last = found[-1]
        growth = sum(last["growth"].get(phase, 0) for phase in JOB)
        compiling = harness.seconds(found, "compiling")
        yield [
            peer.name,
            last["version"],
            f"{compiling:.2f}" if compiling else "",
            f"{harness.seconds(found, *JOB):.2f}",
            f"{harness.ratio(found, runs[first], *JOB):.1f}",
            f"{last['matrix'] / 1e6:.0f}",
            f"{growth / 1e6:.0f}",
            f"{growth / last['matrix']:.1f}",
            str(len(found)),
        ]


def section(job: tuple[str, int, int], runs: dict[Peer, list[Found]]) -> str:
    """Heading, table and what has no numbers of one job."""
    held = harness.with_numbers(runs)
    unmeasured = "; ".join(harness.reasons(runs))
    heading = f"**{job[0]}, degree {job[1]}, {job[2]}³ spans**; times ours: those of the first line"
    table = [harness.markdown(HEADER, rows(held, next(iter(held))))] if held else []
    return "\n\n".join([heading, *table] + ([f"Without numbers: {unmeasured}."] if unmeasured else []))


def main() -> None:
    """Print the tables, and put them into a file where one is named."""
    options = arguments(__doc__).parse_args()
    how = harness.settings(options)
    peers, missing = harness.installed((OURS, *PEERS), how)
    sections = [harness.machine(how.threads) + ".", harness.not_installed(missing)]
    with harness.scratch() as folder:
        for job in jobs(options):
            runs = harness.interleaved(peers, (prepared(folder, job, how), "assembly"), how)
            sections.append(section(job, runs))
            print(sections[-1], file=sys.stderr, flush=True)
    harness.publish("\n\n".join(sections), "assembly", how.write)


if __name__ == "__main__":
    main()
