"""Cut runs off at random moments, in every way that runs are cut off, and see that nothing is lost or wrong.

python -m tests.robustness.interruption --count 200 --first 0

One small case with several load steps, a CAD file and all outputs is run to its end, then again and again into new
folders; at a random moment, or at one of its operations on files, something happens to each run. Then must hold:

- the exit code is one of those that the kind of interruption may have, and no traceback is printed;
- a file under its final name is whole, and holds what that of the uninterrupted run holds, but for times;
- stages that had ended and load steps that had converged are there;
- no process is left;
- the next run takes up what is there, leaves no temporary file, and ends with the files of the uninterrupted run.

Kinds that need to mount file systems are left out where that is not permitted.
"""

import argparse
import shutil
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.robustness.disks import can_mount, small_disk
from tests.robustness.kinds import KINDS, Kind
from tests.robustness.runs import WITHOUT_PICTURES, Run, contents, differing, faults_of, made, steps_in, write_case

MEGABYTES = 64  # of the disk: more than two folders of output, and quickly filled
FATAL = ("Traceback", "Logging error", "Exception ignored", "This is a bug", "HANGING")


class Campaign:
    """A case in a folder, and what an uninterrupted run makes of it."""

    def __init__(self, folder: Path, further: str = "") -> None:
        self.case, self._folder = write_case(folder, further), folder
        began = time.perf_counter()
        code, said = Run(self.case, folder / "reference").ended()
        if code != 0:
            raise RuntimeError(f"the uninterrupted run ended with {code}: {said}")
        self.seconds = time.perf_counter() - began
        self.expected = contents(folder / "reference")

    def attempt(self, kind: Kind, number: int) -> tuple[str, list[str]]:
        """Cut one run off; return how it ended and what is wrong."""
        random, out = np.random.default_rng(number), self._folder / f"out{number}"
        with ExitStack() as stack:
            run = Run(self.case, out, kind.before(out, random))
            if not kind.inside:
                run.wait(random.uniform(0, self.seconds))
            wrong = kind.happen(run, out, random, stack) if run.is_going else []
            code, said = run.ended()
            wrong += [f"{word!r} in: {said}" for word in FATAL if word in said]
            wrong += [] if code in (0, *kind.codes) else [f"ended with {code}: {said}"]
            wrong += [f"process {left} goes on" for left in run.left()]
        wrong += faults_of(out, self.expected) if kind.keeps or code == 0 else []
        wrong += self._finished(out)
        if not wrong:
            shutil.rmtree(out)
        return f"exit {code}", wrong

    def _finished(self, out: Path) -> list[str]:
        """Run again to the end, and compare with the uninterrupted run."""
        whole, steps = made(out, self.expected), steps_in(out)
        code, said = Run(self.case, out).ended()
        if code != 0 or any(word in said for word in FATAL):
            return [f"the next run ended with {code}: {said}"]
        now = made(out, self.expected)
        wrong = [f"{name} was made again" for name in whole if now.get(name) != whole[name]]
        if steps and "solution.h5" not in whole and f"going on after load step {steps}" not in said:
            wrong.append(f"{steps} load steps were kept, and are not used: {said}")
        return wrong + differing(contents(out), self.expected)


@contextmanager
def campaign(further: str = "") -> Iterator[Campaign]:
    """Run the case once, with further lines of [post], on a disk of its own where one can be mounted."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # where shells ignore it, so would all that we start
    with TemporaryDirectory(prefix="interruption-") as folder, ExitStack() as stack:
        if can_mount():
            stack.enter_context(small_disk(Path(folder), MEGABYTES))
        yield Campaign(Path(folder), further)


def main() -> int:
    """Run the campaign; return 1 where something was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="how many moments")
    parser.add_argument("--first", type=int, default=0, help="number of the first; a number and kind can be repeated")
    parser.add_argument("--kind", choices=KINDS, help="this kind alone; else all in turn")
    parser.add_argument("--quick", action="store_true", help="without pictures and report, which take most of the time")
    options = parser.parse_args()
    known = [name for name, kind in KINDS.items() if can_mount() or not kind.mounts]
    if len(known) < len(KINDS):
        print(f"left out, as nothing may be mounted here: {', '.join(KINDS.keys() - known)}")
    found: Counter[str] = Counter()
    failed = 0
    with campaign(WITHOUT_PICTURES if options.quick else "") as cut:
        print(f"the uninterrupted run took {cut.seconds:.1f} s", flush=True)
        for number in range(options.first, options.first + options.count):
            name = options.kind or known[number % len(known)]
            outcome, wrong = cut.attempt(KINDS[name], number)
            found[f"{name}: {outcome}"] += 1
            failed += bool(wrong)
            for fault in wrong:
                print(f"{number} ({name}, {outcome}): {fault}", flush=True)
    counts = ", ".join(f"{what} {count}" for what, count in sorted(found.items()))
    print(f"{options.count} moments: {counts}; {failed} wrong")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
