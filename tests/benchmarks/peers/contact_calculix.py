"""CalculiX: hexahedra, surface-to-surface penalty, conjugate gradients with scaling.

python contact_calculix.py SPANS

The time is that of ccx alone, the memory, too: writing its input is not counted.
"""

import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from two_blocks import POISSON, PRESSURE, STRESS, YOUNG, Block, blocks, report

PENALTY = 10 * YOUNG  # pressure per overlap, times the spans below


def rows(numbers: Any, values: Any) -> str:
    """Lines of a number and what belongs to it."""
    return "\n".join(", ".join(map(str, [n, *v])) for n, v in zip(numbers.tolist(), values.tolist(), strict=True))


def listed(numbers: Any) -> str:
    """Numbers, one a line."""
    return "\n".join(map(str, numbers.tolist()))


def keywords(lower: Block, upper: Block) -> Iterator[str]:
    """The input file, part by part."""
    shift, later = len(lower.points), len(lower.elements)
    points = np.concatenate([lower.points, upper.points])
    elements = np.concatenate([lower.elements, upper.elements + shift])
    yield "*NODE\n" + rows(np.arange(len(points)) + 1, points)
    yield "*ELEMENT, TYPE=C3D8, ELSET=ALL\n" + rows(np.arange(len(elements)) + 1, elements + 1)
    for axis, name in enumerate("XYZ"):
        held = np.flatnonzero(points[:, axis] < 1e-9) + 1
        yield f"*NSET, NSET=HELD{name}\n" + listed(held)
    yield f"*MATERIAL, NAME=M\n*ELASTIC\n{YOUNG}, {POISSON}\n*SOLID SECTION, ELSET=ALL, MATERIAL=M"
    sides = {"MASTER": lower.layer(True), "SLAVE": upper.layer(False) + later, "TOP": upper.layer(True) + later}
    for name, numbers in sides.items():
        yield f"*ELSET, ELSET=E{name}\n" + listed(numbers + 1)
    for name, side in (("MASTER", "S2"), ("SLAVE", "S1")):
        yield f"*SURFACE, NAME={name}, TYPE=ELEMENT\nE{name}, {side}"
    spans = round(later ** (1 / 3))
    yield f"*SURFACE INTERACTION, NAME=I\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n{PENALTY * spans}"
    yield "*CONTACT PAIR, INTERACTION=I, TYPE=SURFACE TO SURFACE\nSLAVE, MASTER"
    yield "*STEP\n*STATIC, SOLVER=ITERATIVE SCALING\n1., 1."
    yield "*BOUNDARY\n" + "\n".join(f"HELD{name}, {axis + 1}" for axis, name in enumerate("XYZ"))
    yield f"*DLOAD\nETOP, P2, {PRESSURE}"
    for name in ("EMASTER", "ESLAVE"):
        yield f"*EL PRINT, ELSET={name}\nS"
    yield "*END STEP\n"


def stresses(path: Path) -> Any:
    """Stresses (q, 6) at the points of integration next to the contact."""
    number = r"[-+]?\d\.\d+E[-+]\d+"
    found = re.findall(rf"^\s*\d+\s+\d+((?:\s+{number}){{6}})", path.read_text(), re.MULTILINE)
    return np.array([line.split() for line in found], dtype=float)


def main() -> None:
    """Write, run, read."""
    program, (lower, upper) = shutil.which("ccx"), blocks()
    version = subprocess.run([program, "-v"], capture_output=True, text=True).stdout.split()[-1]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "job"
        path.with_suffix(".inp").write_text("\n".join(keywords(lower, upper)))
        began = time.perf_counter()
        process = subprocess.Popen([program, "-i", "job"], cwd=folder, stdout=subprocess.PIPE, text=True)
        text = process.stdout.read()
        usage = os.wait4(process.pid, 0)[2]
        seconds = time.perf_counter() - began
        error = np.abs(stresses(path.with_suffix(".dat")) - STRESS).max() / PRESSURE
    report(
        version=version,
        unknowns=3 * (len(lower.points) + len(upper.points)),
        seconds={"whole": seconds},
        peak=1024 * usage.ru_maxrss,
        error=float(error),
        steps=text.count("iteration "),
        solver="CG, scaling",
    )


if __name__ == "__main__":
    main()
