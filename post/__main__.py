"""The command iga-post: solution.h5 to VTU files, pictures, summary and checks."""

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from geom2iga.build import build
from geom2iga.errors import CaseError, NotConvergedError, VerificationError
from geom2iga.files import check_stamp
from geom2iga.seal import check_no_folder, listed, read_sealed
from geom2iga.stage import Stage, fingerprint, log, run_command
from geom2iga.tables import Case, checked
from post.case import PostCase
from post.export import export
from post.memory import check_post
from post.source import case_text
from post.wanted import check_wanted
from solve import __main__ as solution
from solve.case import SolveCase
from solve.output import write_summary

FILE = "summary.json"


def stamp(case: Case, folder: Path) -> str:
    """Fingerprint the solution, what [post] and [[verify]] ask for, and the text that the report shows."""
    before = solution.stamp(case, folder)
    try:
        check_stamp(folder / solution.FILE, solution.FORMAT, solution.VERSION, before, "run iga-solve first")
    except CaseError:
        solution.read_shown(case, folder)  # raises where there is nothing to show
    wanted = checked(case, PostCase)
    return fingerprint(before, wanted.model_dump(), case_text(case) if wanted.post.report else "")


def written(folder: Path) -> str | None:
    """Return the stamp of summary.json, if it converged, all files that it lists are there and all checks passed."""
    check_no_folder(folder / FILE)
    if not (folder / FILE).exists():
        return None
    try:
        found = read_sealed(folder / FILE, "making it anew")
        whole = all((folder / name).is_file() for name in found["files"])
        passed = found["status"] == "converged" and all(check["passed"] for check in found["verify"])
        return str(found["stamp"]) if whole and passed else None
    except CaseError as error:
        log.warning("%s", error)
    except (KeyError, TypeError):  # of a run that was cut off
        pass
    return None


def run(case: Case, folder: Path, stamp: str) -> None:
    """Write everything.

    Raises
    ------
    NotConvergedError
        What was written shows the last load step that converged, not the last one of the case.
    VerificationError
        A known answer was missed.
    """
    began = time.perf_counter()
    result = solution.read_shown(case, folder)
    with _accounted(folder) as before:
        found = export(result, case, folder, stamp)
    for name in before.difference(found["files"]):
        (folder / name).unlink(missing_ok=True)
    seconds, start = time.perf_counter() - began, "; open report.html" if "report.html" in found["files"] else ""
    log.info("iga-post: %d files in %s, %.2f s%s", len(found["files"]) + 1, folder, seconds, start)
    for contact in found["contact"]:
        gap = "none" if contact["gap_min"] is None else f"{contact['gap_min']:.3g}"
        names = contact["secondary"], contact["primary"]
        log.info(
            'iga-post: "%s" on "%s": largest pressure %.6g, smallest gap of a point %s',
            *names,
            contact["pressure_max"],
            gap,
        )
    if result.diagnosis:
        raise NotConvergedError(f"iga-post: {result.diagnosis.shown}: {result.status.value}")
    missed = [check for check in found["verify"] if not check["passed"]]
    for check in found["verify"]:
        log.info(
            "iga-post: %s within %.1e of the exact answer (allowed %.1e): %s",
            check["quantity"] if check["on"] is None else f'{check["quantity"]} on "{check["on"]}"',
            check["difference"],
            check["tolerance"],
            "passed" if check["passed"] else "MISSED",
        )
    if missed:
        first = missed[0]
        raise VerificationError(
            f"{len(missed)} of {len(found['verify'])} checks missed: {first['quantity']} is {_listed(first['found'])}, "
            f"expected {_listed(first['expected'])} within {first['tolerance']:g}"
        )


@contextmanager
def _accounted(folder: Path) -> Iterator[set[str]]:
    """Say in summary.json that what lies there is not up to date, yet whose it is; yield the names that it listed."""
    before, present = listed(folder / FILE), set(os.listdir(folder))
    write_summary(folder / FILE, {"files": sorted(before)})
    try:
        yield before
    except BaseException:
        with suppress(OSError):  # of a full disk
            found = before.union(os.listdir(folder)) - (present - before) - {FILE}
            write_summary(folder / FILE, {"files": sorted(found)})
        raise


def _listed(value: float | list[float]) -> str:
    """Write a number, or a list of them, in as many digits as people read; summary.json has all."""
    return f"[{', '.join(map(_listed, value))}]" if isinstance(value, list) else f"{value:.6g}"


def summary(folder: Path) -> Mapping[str, Any]:
    """Read summary.json."""
    return read_sealed(folder / FILE)


def plan(case: Case) -> str:
    """Check that what is asked for exists."""
    wanted = checked(case, PostCase)
    model, contacts = build(case), checked(case, SolveCase).solve.contact
    check_wanted(model, contacts, wanted)
    check_post(model, contacts, wanted.post)
    return f"VTU files, tables, pictures, report, summary and {len(wanted.verify)} checks"


STAGE = Stage("iga-post", PostCase, stamp, written, plan, run, summary)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command("Write files, pictures and checks of a solved case.", [STAGE], arguments)


if __name__ == "__main__":
    raise SystemExit(main())
