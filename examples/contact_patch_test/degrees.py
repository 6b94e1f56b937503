"""The patch test for degrees 1, 2 and 3 from one case file."""

from pathlib import Path

import geom2iga
import post
import solve


def main() -> dict[int, float]:
    """Return the largest error of the stress tensor for each degree."""
    case = geom2iga.read_case(Path(__file__).with_name("case.toml"))
    errors = {}
    for degree in (1, 2, 3):
        varied = case.changed({"geometry.degree": degree})
        result = solve.solve(geom2iga.build(varied), varied)
        errors[degree] = post.verify(result, varied)[0].difference
        print(f"degree {degree}: stress error {errors[degree]:.1e}, {result}")
    return errors


if __name__ == "__main__":
    main()
