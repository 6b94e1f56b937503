"""The table of the README: stress errors of the patch test, degree x integration x arrangement.

python examples/contact_patch_test/table.py             prints it
python examples/contact_patch_test/table.py README.md   puts it between the marks in a file
"""

import sys
from pathlib import Path

import numpy as np

import geom2iga
import solve
from post.exact import StackedBlocks
from post.fields import sample_at

EXACT = StackedBlocks(pressure=1.0, young=1000.0, heights=(1.0, 1.0)).stress
POINTS = 1000  # random points per block
MARKS = ("<!-- patch test table -->", "<!-- end of patch test table -->")
NON_MATCHING = {"geometry.block.0.spans": [5, 4, 3], "geometry.block.1.spans": [3, 5, 2]}
ARRANGEMENTS = {
    "matching": {},
    "non-matching": NON_MATCHING,
    "turned by 17°": {"geometry.block.1.rotate": {"angle": 17.0}},
    "lower side secondary": {
        **NON_MATCHING,
        "solve.contact.0.secondary": "lower/top",
        "solve.contact.0.primary": "upper/bottom",
    },
    "overhanging": {
        "geometry.block.1.origin": [1.3, 0.5, 1.0],
        "solve.load.2": {"on": "upper/bottom", "pressure": 1.0, "exposed": True},
    },
}


def largest_error(case: geom2iga.Case) -> float:
    """Return the largest error of any stress component at random points of both blocks."""
    result = solve.solve(geom2iga.build(case), case)
    random = np.random.default_rng(0)
    return max(
        float(np.abs(sample_at(result, name, random.random((POINTS, 3))).stress - EXACT).max())
        for name in result.model.patches
    )


def table(case: geom2iga.Case, degrees: tuple[int, ...] = (1, 2, 3)) -> list[list[str]]:
    """Return the rows of the table, the header first."""
    rows = [["degree", "integration", *ARRANGEMENTS]]
    for degree in degrees:
        for integration in ("segment", "element"):
            changes = {"geometry.degree": degree, "solve.contact.0.integration": integration}
            errors = [largest_error(case.changed({**changes, **arrangement})) for arrangement in ARRANGEMENTS.values()]
            rows.append([str(degree), integration, *(f"{error:.0e}" for error in errors)])
    return rows


def main() -> None:
    """Print the table, or put it into the file named on the command line."""
    header, *rows = table(geom2iga.read_case(Path(__file__).with_name("case.toml")))
    text = "\n".join("| " + " | ".join(row) + " |" for row in [header, ["---"] * len(header), *rows])
    print(text)
    for name in sys.argv[1:]:
        before, rest = Path(name).read_text(encoding="utf-8").split(MARKS[0])
        after = rest.split(MARKS[1])[1]
        Path(name).write_text(f"{before}{MARKS[0]}\n{text}\n{MARKS[1]}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
