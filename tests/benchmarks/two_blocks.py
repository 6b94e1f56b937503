"""How long contact of two blocks takes by ours and by finite-element codes: the patch test, whole processes.

python -m tests.benchmarks.two_blocks
python -m tests.benchmarks.two_blocks --spans 16 --write tests/benchmarks/README.md

Two unit cubes stand on each other, their meshes do not match, a pressure acts on the top: the stress is uniform, and
how far it is off is measured. All have the same number of unknowns: linear hexahedra, 16³ on 15³ or 24³ on 23³, and
ours as many control points at each degree. Kratos, GetFEM and ours are measured with their imports and with reading or
making the mesh, CalculiX with reading its input; writing what is read is not counted. All take turns. Kratos and
CalculiX show their stress in the elements next to the contact, GetFEM at all nodes, ours at random points everywhere.
Not measured: curved faces, sliding, friction, faces that only partly touch, results on disk.
"""

import sys
from collections.abc import Iterator

from tests.benchmarks import harness
from tests.benchmarks.harness import Found, Peer

KRATOS = "KratosMultiphysics.ContactStructuralMechanicsApplication"
PEERS = (
    Peer("CalculiX", "contact_calculix.py", "numpy", program="ccx"),
    Peer("Kratos", "contact_kratos.py", KRATOS),
    Peer("Kratos, zero_tolerance_factor 1e3", "contact_kratos.py", KRATOS, ("tight",)),
    Peer("GetFEM", "contact_getfem.py", "getfem"),
)
HEADER = ("code", "version", "unknowns", "whole s", "times ours", "stress off by", "steps", "solver", "peak MB", "runs")


def rows(runs: dict[Peer, list[Found]], first: Peer) -> Iterator[list[str]]:
    """What each code took."""
    for peer, found in runs.items():
        last = found[-1]
        yield [
            peer.name,
            last["version"],
            str(last["unknowns"]),
            f"{harness.seconds(found, 'whole'):.2f}",
            f"{harness.ratio(found, runs[first], 'whole'):.1f}",
            f"{last['error']:.0e}",
            str(last["steps"]),
            last["solver"],
            f"{last['peak'] / 1e6:.0f}",
            str(len(found)),
        ]


def section(spans: int, runs: dict[Peer, list[Found]]) -> str:
    """Heading, table and what has no numbers of one size."""
    held = harness.with_numbers(runs)
    unmeasured = "; ".join(harness.reasons(runs))
    heading = f"**{spans}³ on {spans - 1}³ spans**, or as many unknowns; times ours: those of the first line"
    table = [harness.markdown(HEADER, rows(held, next(iter(held))))] if held else []
    return "\n\n".join([heading, *table] + ([f"Without numbers: {unmeasured}."] if unmeasured else []))


def main() -> None:
    """Print the tables, and put them into a file where one is named."""
    parser = harness.parser(__doc__)
    parser.add_argument("--spans", nargs="+", type=int, default=[16, 24], help="of the lower block of hexahedra")
    parser.add_argument("--degrees", nargs="+", type=int, default=[1, 2, 3], help="of ours")
    parser.add_argument(
        "--method", default="auto", choices=("auto", "direct", "iterative"), help="linear solver of ours"
    )
    options = parser.parse_args()
    how = harness.settings(options)
    ours = [
        Peer(f"ours, degree {degree}", "contact_ours.py", harness.OURS, (str(degree), options.method))
        for degree in options.degrees
    ]
    peers, missing = harness.installed((*ours, *PEERS), how)
    sections = [harness.machine(how.threads) + ".", harness.not_installed(missing)]
    for spans in options.spans:
        sections.append(section(spans, harness.interleaved(peers, (str(spans),), how)))
        print(sections[-1], file=sys.stderr, flush=True)
    harness.publish("\n\n".join(sections), "two blocks", how.write)


if __name__ == "__main__":
    main()
