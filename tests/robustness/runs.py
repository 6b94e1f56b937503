"""Runs of one small case in processes of their own, and what their folders hold."""

import csv
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gmsh
import h5py
import numpy as np
import psutil

from geom2iga.errors import CaseError
from geom2iga.temporary import NAME

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
PATIENCE = 300.0  # seconds until a run counts as hanging
COMMAND = "import runpy, sys; sys.argv[0] = 'iga-run'; runpy.run_module('post.pipeline', run_name='__main__')"
LOAD_STEP = re.compile(r"iga-solve: +\d+ +(\d+) +\d+ ")

PASSING = (  # what no two runs have in common, and how much work an analysis was that could not use older factors
    *("seconds", "peak_memory", "digest"),
    *("factorisations", "linear_iterations"),
)
PAGES = ("report.html", "newton.png")  # show times

CASE = """
title = "A punch with a round bottom on a block from a CAD file"

[geometry]
degree = [2, 1, 2]

[[geometry.domed_block]]
name = "punch"
size = [0.8, 0.2, 0.5]
radius = 2.0
bottom = "cylinder"
origin = [0.0, 0.0, 0.4]
spans = [6, 1, 2]

[[geometry.cad]]
name = "base"
file = "base.brep"
degree = 2
spans = 3
faces = [
    { name = "floor", z = 0.0 },
    { name = "top", z = 0.4 },
]

[[solve.material]]
young = 1000.0
poisson = 0.3

[[solve.support]]
on = "floor"
ux = 0.0
uy = 0.0
uz = 0.0

[[solve.support]]
on = "punch/top"
ux = 0.0
uy = 0.0
uz = -0.02

[[solve.contact]]
secondary = "punch/bottom"
primary = "top"

[solve.steps]
factors = [0.1, 0.4, 0.7, 1.0]

[post]
samples = 2
load_steps = true
gauss_points = true
"""


WITHOUT_PICTURES = "pictures = false\nreport = false\n"


def write_case(folder: Path, further: str = "") -> Path:
    """Write the case, with further lines of [post], and its CAD file."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addBox(-0.5, -0.3, 0.0, 1.0, 0.6, 0.4)
    gmsh.model.occ.synchronize()
    gmsh.write(str(folder / "base.brep"))
    gmsh.finalize()
    (folder / "case.toml").write_text(CASE + further, encoding="utf-8")
    return folder / "case.toml"


class Run:
    """The command iga-run at work.

    Parameters
    ----------
    case, out : Path
        Case file and output folder.
    before : str
        Python that the process runs first.
    """

    def __init__(self, case: Path, out: Path, before: str = "") -> None:
        self.case = case
        self._process = subprocess.Popen(
            [sys.executable, "-c", f"{before}\n{COMMAND}", str(case), "-o", str(out)],
            env=os.environ | ENVIRONMENT,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    @property
    def number(self) -> int:
        """Of the process."""
        return self._process.pid

    @property
    def is_going(self) -> bool:
        """Whether it goes on."""
        return self._process.poll() is None

    def wait(self, seconds: float) -> None:
        """Let it go on for a while."""
        end = time.monotonic() + seconds
        while self.is_going and time.monotonic() < end:
            time.sleep(0.002)

    def send(self, number: signal.Signals) -> None:
        """Send a signal, to what else it started in its group too, as terminals do."""
        if self.is_going:
            os.killpg(self.number, number)

    def ended(self) -> tuple[int, str]:
        """Wait for its end; return exit code, negative where a signal ended it, and what it said."""
        try:
            said = self._process.communicate(timeout=PATIENCE)[1]
        except subprocess.TimeoutExpired:
            self._process.kill()
            said = "HANGING\n" + self._process.communicate()[1]
        return self._process.returncode, said

    def left(self) -> list[int]:
        """Processes that it started and that still go on, after a moment to end."""
        end = time.monotonic() + 5.0
        while (found := self._session()) and time.monotonic() < end:
            time.sleep(0.05)
        return found

    def _session(self) -> list[int]:
        """Processes of its session."""
        found = []
        for number in psutil.pids():
            try:
                if os.getsid(number) == self.number and psutil.Process(number).status() != psutil.STATUS_ZOMBIE:
                    found.append(number)
            except (ProcessLookupError, psutil.Error):
                continue
        return found


def contents(folder: Path) -> dict[str, Any]:
    """What lies in a folder but for log.txt, by name: of each file what two runs of one case have in common."""
    return {path.name: _content(path) for path in sorted(folder.iterdir()) if path.name != "log.txt"}


def _content(path: Path) -> Any:
    if path.name in PAGES:
        return path.name, path.read_bytes()[-7:]  # the last line of a page, the end of a picture
    if path.suffix == ".h5":
        return _tree(path)
    if path.suffix == ".json":
        return _lasting(json.loads(path.read_text(encoding="utf-8")))
    if path.suffix == ".csv":
        rows = csv.DictReader(io.StringIO(path.read_text(encoding="utf-8")))
        return [{key: value for key, value in row.items() if key not in PASSING} for row in rows]
    return path.read_bytes()


def _tree(path: Path) -> dict[str, Any]:
    """All arrays and attributes of an HDF5 file, by place."""
    found: dict[str, Any] = {}

    def visit(place: str, item: Any) -> None:
        found.update({f"{place}@{key}": _attribute(value) for key, value in item.attrs.items()})
        if isinstance(item, h5py.Dataset):
            value = np.asarray(item[()])
            found[place] = value.tolist() if value.dtype == object else (str(value.dtype), value.shape, value.tobytes())

    with h5py.File(path) as file:
        visit("", file)
        file.visititems(visit)
    return found


def _attribute(value: Any) -> Any:
    """An attribute without times; tables lie there as JSON."""
    if isinstance(value, str) and value[:1] in ("{", "["):
        return _lasting(json.loads(value))
    return value.tolist() if hasattr(value, "tolist") else value


def _lasting(value: Any) -> Any:
    """Leave out what no two runs have in common."""
    if isinstance(value, Mapping):
        return {key: _lasting(each) for key, each in value.items() if key not in PASSING}
    return [_lasting(each) for each in value] if isinstance(value, list) else value


def differing(found: Mapping[str, Any], expected: Mapping[str, Any]) -> list[str]:
    """Say what lies in one folder and not in another, or holds something else."""
    wrong = [f"{name} is left" for name in found.keys() - expected.keys()]
    wrong += [f"{name} is missing" for name in expected.keys() - found.keys()]
    for name in found.keys() & expected.keys():
        one, other = found[name], expected[name]
        if one != other:
            where = [key for key in other if one.get(key) != other[key]] if isinstance(other, dict) else ""
            wrong.append(f"{name} differs {where}")
    return wrong


def faults_of(folder: Path, expected: Mapping[str, Any]) -> list[str]:
    """Say which files under final names are not whole or not right, and which that should be there are not."""
    names = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    wrong = []
    for name in sorted(name for name in names if name != "log.txt" and not NAME.fullmatch(name)):
        try:
            found = _content(folder / name)
        except (CaseError, OSError, ValueError) as error:
            wrong.append(f"{name} is not whole: {error}")
            continue
        begun = name == "steps.h5" or (name == "summary.json" and found.keys() == {"files"})
        if not begun and found != expected.get(name):
            wrong.append(f"{name} differs")
    log = (folder / "log.txt").read_text(encoding="utf-8") if "log.txt" in names else ""
    if "geom2iga: 2 bodies" in log and "geometry.h5" not in names:
        wrong.append("geometry.h5 had been written and is lost")
    if "iga-solve: converged" in log and "solution.h5" not in names:
        wrong.append("solution.h5 had been written and is lost")
    begun = max(map(int, LOAD_STEP.findall(log)), default=1)
    if "solution.h5" not in names and steps_in(folder) < begun - 1:
        wrong.append(f"load step {begun} had begun, {steps_in(folder)} are kept")
    return wrong


def steps_in(folder: Path) -> int:
    """How many load steps of an analysis that was cut off are kept."""
    path = folder / "steps.h5"
    if not path.exists():
        return 0
    with h5py.File(path) as file:
        return len(file["states"])


def made(folder: Path, expected: Mapping[str, Any]) -> dict[str, tuple[int, int]]:
    """When the files between the stages were made that are what they should be."""
    found = {}
    for name in ("geometry.h5", "solution.h5"):
        path = folder / name
        if path.exists() and _content(path) == expected[name]:
            found[name] = (path.stat().st_mtime_ns, path.stat().st_ino)
    return found
