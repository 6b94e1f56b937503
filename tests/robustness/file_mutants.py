"""Damages the files that the commands read back, and insists that nothing wrong is believed.

    python -m tests.robustness.file_mutants --count 400 --first 0

A small case is run to its end. Each mutant is a copy of its output folder in which one file is flipped, cut off,
swapped, of another version or another case, no file at all, ...; then one command or reader runs on it. It must end
with exit 0 and the results of the untouched run, because what is damaged was made anew or is not read, or with exit 2
and one sentence. The number of a mutant repeats it.
"""

import argparse
import io
import json
import os
import shutil
import signal
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import h5py
import numpy as np

from geom2iga import __main__ as geometry
from geom2iga.errors import CaseError
from geom2iga.files import read_model
from geom2iga.seal import digest_of, read_sealed
from post import __main__ as post
from post import pipeline
from solve import __main__ as solution
from solve.files import read_result
from tests.sealed import altered, reseal

CASE = """
[geometry]
block = [
    {name = "lower", size = [2, 2, 1], spans = [2, 2, 1]},
    {name = "upper", origin = [0.5, 0.5, 1], size = [1, 1, 1]},
]

[solve]
material = [{young = 1000.0, poisson = 0.3}]
support = [
    {on = "lower/bottom", ux = 0, uy = 0, uz = 0},
    {on = "upper/left", ux = 0},
    {on = "upper/front", uy = 0},
]
load = [{on = "upper/top", pressure = 1.0}]
contact = [{secondary = "upper/bottom", primary = "lower/top"}]
steps = {factors = [0.4, 1.0]}

[post]
samples = 2
pictures = false
report = false
"""
OTHER = CASE.replace("size = [1, 1, 1]", "size = [1, 1, 2]")
UNKNOWN = ("cut off", "nested", "nonsense", "swapped", "text")  # may leave nothing by which a file of ours is known
SECONDS = 60  # a mutant that takes longer hangs
READ, LEFT = ("geometry.h5", "solution.h5", "steps.h5", "summary.json"), ("bodies.vtu", "history.csv")
COMMANDS = {"geom2iga": geometry.main, "iga-solve": solution.main, "iga-post": post.main, "iga-run": pipeline.main}
RUN = (
    "seconds",
    "peak_memory",
    "digest",
    "factorisations",
    "linear_iterations",
    "equilibrium_error",
)  # of the run itself


@dataclass(frozen=True)
class Finished:
    """Folders of a case and its output: whole, cut off after a load step, and of another case."""

    whole: Path
    begun: Path
    other: Path


@dataclass(frozen=True)
class Mutant:
    """What is done to which file, and what runs on it."""

    target: str
    damage: str
    command: str

    @property
    def codes(self) -> tuple[int, ...]:
        """The exit codes that are right: a later stage refuses what an earlier one must make anew."""
        needed = {"geom2iga": 0, "iga-solve": 1, "iga-post": 2, "iga-run": 0}[self.command]
        if self.target in READ[:needed] or (self.target == "steps.h5" and self.command == "iga-post"):
            return (2,)
        return (0, 2) if self.damage == "folder" or (self.target in READ and self.damage in UNKNOWN) else (0,)


def finish(folder: Path) -> Finished:
    """Run the case, the same one up to a load step, and another one."""
    found = Finished(*(folder / name for name in ("whole", "begun", "other")))
    for place, text in zip((found.whole, found.begun, found.other), (CASE, CASE, OTHER), strict=True):
        place.mkdir()
        (place / "case.toml").write_text(text)
        if place != found.begun:
            assert run("iga-run", place)[0] == 0

    def interrupt(step: Any) -> None:
        if step.load_step == 2:
            raise KeyboardInterrupt

    with patch.object(solution, "report_step", interrupt):
        assert run("geom2iga", found.begun)[0] == 0
        assert run("iga-solve", found.begun)[0] == 130
    assert (found.begun / "case.out/steps.h5").is_file()
    return found


def run(command: str, folder: Path) -> tuple[int, str]:
    """Run a command on the case of a folder; return its exit code and what it said."""
    said = io.StringIO()
    with redirect_stderr(said), redirect_stdout(io.StringIO()):
        code = COMMANDS[command](["-q", str(folder / "case.toml")])
    return code, said.getvalue()


def _flipped(random: np.random.Generator, content: bytes) -> bytes:
    place = int(random.integers(len(content)))
    return content[:place] + bytes([content[place] ^ (1 << int(random.integers(8)))]) + content[place + 1 :]


def _scrambled(random: np.random.Generator, content: bytes) -> bytes:
    start, length = int(random.integers(len(content))), int(random.integers(1, 200))
    return content[:start] + random.bytes(length) + content[start + length :]


def _zeroed(random: np.random.Generator, content: bytes) -> bytes:
    page = 256 * int(random.integers(1 + len(content) // 256))
    return content[:page] + bytes(len(content[page : page + 256])) + content[page + 256 :]


def _inserted(random: np.random.Generator, content: bytes) -> bytes:
    place = int(random.integers(len(content)))
    return content[:place] + random.bytes(1) + content[place:]


BYTES: dict[str, Callable[[np.random.Generator, bytes], bytes]] = {
    "flipped": _flipped,
    "scrambled": _scrambled,
    "zeroed": _zeroed,
    "inserted": _inserted,
    "cut off": lambda random, content: content[: int(random.integers(len(content)))],
    "appended": lambda random, content: content + random.bytes(int(random.integers(1, 1000))),
    "emptied": lambda random, content: b"",
    "nonsense": lambda random, content: random.bytes(int(random.integers(1, 5000))),
    "text": lambda random, content: b"geom2iga\n" * int(random.integers(1, 100)),
    "nested": lambda random, content: b"[" * 100_000,
}


def _older_layout(random: np.random.Generator, path: Path) -> None:
    """What this kind of file was before it had a first block."""
    with h5py.File(path, "w") as file:
        file.attrs.update({"format": "geom2iga geometry", "version": 2, "stamp": "x"})


def _unfit(random: np.random.Generator, path: Path) -> None:
    """Take a value away or spoil it, and seal the file as if that were right."""
    with altered(path) as file:
        names: list[str] = []
        file.visititems(lambda name, entry: names.append(name) if isinstance(entry, h5py.Dataset) else None)
        name = str(random.choice(names))
        if file[name].dtype.kind == "f" and random.random() < 0.7:
            values = np.array(file[name])
            values.flat[int(random.integers(values.size))] = np.nan
            file[name][...] = values
        else:
            del file[name]


def _linked(random: np.random.Generator, path: Path) -> None:
    path.unlink()
    path.symlink_to(random.choice([path.name, "nowhere", "/dev/null", "/dev/zero"]))


def _folder(random: np.random.Generator, path: Path) -> None:
    path.unlink()
    path.mkdir()


def _fifo(random: np.random.Generator, path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _foreign(random: np.random.Generator, path: Path) -> None:
    """List files outside, files of others and no files at all."""
    names = ["../outside.txt", "../../outside.txt", "/etc/passwd", "..", ".", "", "a\0b", "\ud800", 7, None, ["x"]]
    values: Any = {"files": [names[place] for place in random.permutation(len(names))[: random.integers(len(names))]]}
    values |= {"stamp": "x", "verify": []}
    if random.random() < 0.5:
        values |= {"digest": digest_of(values)}
    path.write_text(json.dumps(values))


FILES: dict[str, Callable[[np.random.Generator, Path], None]] = {
    "older layout": _older_layout,
    "older version": lambda random, path: reseal(path, -1),
    "newer version": lambda random, path: reseal(path, 1),
    "other form": lambda random, path: reseal(path, form="geom2iga other"),
    "unfit": _unfit,
    "foreign": _foreign,
    "linked": _linked,
    "folder": _folder,
    "pipe": _fifo,
    "removed": lambda random, path: path.unlink(),
}
HDF5_ONLY, JSON_ONLY = ("older layout", "older version", "newer version", "other form", "unfit"), ("foreign",)


def drawn(number: int) -> tuple[Mutant, np.random.Generator]:
    """Draw a mutant by its number."""
    random = np.random.default_rng(number)
    target = str(random.choice([*READ, *READ, *LEFT]))
    kinds = {*BYTES, *FILES, "swapped", "of another case"}
    kinds -= set(JSON_ONLY if target.endswith(".h5") else HDF5_ONLY)
    kinds -= set(JSON_ONLY if target in LEFT else ())
    kinds -= {"of another case"} if target == "steps.h5" else set()  # the other one ran to its end
    damage = str(random.choice(sorted(kinds)))
    command = str(random.choice(["reading", *COMMANDS]))
    if damage == "unfit" and target != "steps.h5":
        command = "reading"  # what is up to date by its digest and its stamp, commands do not look into
    return Mutant(target, damage, command), random


def damage(mutant: Mutant, random: np.random.Generator, finished: Finished, folder: Path) -> None:
    """Copy a finished folder and damage one of its files."""
    shutil.copytree(finished.begun if mutant.target == "steps.h5" else finished.whole, folder)
    path = folder / "case.out" / mutant.target
    before = path.read_bytes()
    if mutant.damage in BYTES:
        after = before
        while after == before:
            after = BYTES[mutant.damage](random, before)
        path.write_bytes(after)
    elif mutant.damage in FILES:
        FILES[mutant.damage](random, path)
    else:
        places = [finished.other / "case.out" / mutant.target]
        if mutant.damage == "swapped":
            places = [entry for entry in sorted((finished.whole / "case.out").iterdir()) if entry.name != mutant.target]
            places += [finished.begun / "case.out/steps.h5"] if mutant.target != "steps.h5" else []
        shutil.copy(places[int(random.integers(len(places)))], path)


def results(folder: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """What files of a folder hold, but for times and counts."""
    found: dict[str, Any] = {}
    for name in names:
        path = folder / "case.out" / name
        if name.endswith(".json"):
            found[name] = json.dumps({k: v for k, v in json.loads(path.read_text()).items() if k not in RUN})
        elif name.endswith(".h5"):
            found |= {f"{name}/{key}": value for key, value in _inside(path)}
        elif name != "history.csv":
            found[name] = path.read_bytes()
    return found


def _inside(path: Path) -> Iterator[tuple[str, Any]]:
    """Datasets and attributes of an HDF5 file."""
    entries: dict[str, Any] = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, entry: entries.update({name: entry}))
        for name, entry in {"": file, **entries}.items():
            kept = entry.attrs.keys() - {"statistics", "history"}
            yield from ((f"{name}@{key}", repr(entry.attrs[key])) for key in kept)
            if isinstance(entry, h5py.Dataset):
                yield name, (entry.dtype.str, entry.shape, np.array(entry).tolist())


MADE = {
    "geom2iga": ("geometry.h5",),
    "iga-solve": ("geometry.h5", "solution.h5"),
    "iga-post": ("geometry.h5", "solution.h5", "summary.json"),
    "iga-run": ("geometry.h5", "solution.h5", "summary.json"),
}


def fault(number: int, finished: Finished, folder: Path) -> tuple[Mutant, str, str | None]:
    """Try a mutant; return it, how it ended, and what is wrong with that, if anything."""
    mutant, random = drawn(number)
    outside = folder.parent / "outside.txt"
    outside.write_text("mine")
    damage(mutant, random, finished, folder)
    try:
        with _limited(SECONDS):
            if mutant.command == "reading":
                return mutant, "read", _fault_of_reading(mutant, finished, folder)
            code, said = run(mutant.command, folder)
        wrong = _fault_of_run(mutant, finished, folder, code, said)
        if not outside.is_file():
            wrong = "removed a file outside of the folder"
        return mutant, f"exit {code}", wrong
    except Exception as error:
        return mutant, "raised", f"{type(error).__name__}: {error}"
    finally:
        shutil.rmtree(folder)


def _fault_of_run(mutant: Mutant, finished: Finished, folder: Path, code: int, said: str) -> str | None:
    """Say what is wrong with the end of a command."""
    if code not in mutant.codes:
        return f"exit {code}, expected {mutant.codes}: {said}"
    lines = said.strip().splitlines()
    if code == 2:
        named = "solution.h5" if mutant.target == "steps.h5" and mutant.command == "iga-post" else mutant.target
        return None if 1 <= len(lines) <= 2 and named in lines[-1] else f"said {said!r}"
    made = tuple(name for name in MADE[mutant.command] if (folder / "case.out" / name).exists())
    if mutant.command != "geom2iga" and made != MADE[mutant.command]:
        return f"made only {made}"
    checked = tuple(name for name in MADE[mutant.command] if mutant.command != "geom2iga" or name == "geometry.h5")
    if results(folder, checked) != results(finished.whole, checked):
        return "other results than those of the untouched run"
    return None


def _fault_of_reading(mutant: Mutant, finished: Finished, folder: Path) -> str | None:
    """Say what is wrong with how a file is read from Python; what no reader reads is right."""
    source = finished.begun if mutant.target == "steps.h5" else finished.whole
    path, before = folder / "case.out" / mutant.target, source / "case.out" / mutant.target
    try:
        if mutant.target == "summary.json":
            read_sealed(path)
        elif mutant.target.endswith(".h5"):
            with h5py.File(before) as file:
                stamp = str(file.attrs["stamp"])
            (read_model if mutant.target == "geometry.h5" else read_result)(path, stamp)
        else:
            return None
    except CaseError as error:
        return None if str(path) in str(error) and "\n" not in str(error) else f"said {error}"
    if mutant.target != "summary.json":
        return "believed"
    if mutant.damage in ("of another case", "foreign"):  # sealed, and a reader knows of no stamp
        return None
    same = results(folder, (mutant.target,)) == results(finished.whole, (mutant.target,))
    return None if same else "believed"


@contextmanager
def _limited(seconds: int) -> Iterator[None]:
    """Raise TimeoutError after some seconds."""

    def end(number: int, frame: Any) -> None:
        raise TimeoutError(f"took more than {seconds} seconds")

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def main() -> int:
    """Try mutants one after the other, and count how they end."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--first", type=int, default=0, help="number of the first mutant")
    options = parser.parse_args()
    ends: Counter[str] = Counter()
    wrong = 0
    with tempfile.TemporaryDirectory() as place:
        finished = finish(Path(place))
        for number in range(options.first, options.first + options.count):
            mutant, end, problem = fault(number, finished, Path(place) / "mutant")
            ends[end] += 1
            if problem:
                wrong += 1
                print(f"{number}: {mutant.target} {mutant.damage}, {mutant.command}: {problem}", flush=True)
    counts = ", ".join(f"{count} {end}" for end, count in sorted(ends.items()))
    print(f"{options.count} mutants: {counts}; {wrong} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
