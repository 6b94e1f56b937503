"""What the commands share: exit codes, stamps, resume."""

import argparse
import hashlib
import json
import logging
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from geom2iga.errors import CaseError, NotConvergedError, UserError, VerificationError
from geom2iga.flags import command_parser, completion
from geom2iga.limits import limited
from geom2iga.progress import turned_on
from geom2iga.schema import schema
from geom2iga.seal import check_ours, listed, read_sealed
from geom2iga.signals import exit_code, interruptible
from geom2iga.starter import write_starter
from geom2iga.tables import Case, Table, checked, read_case
from geom2iga.terminal import log_to, print_data, print_json, talking
from geom2iga.threads import threads

log = logging.getLogger("geom2iga")

OUR_BUG = 1
SUMMARY = "summary.json"


@dataclass(frozen=True)
class Stage:
    """One step of the pipeline, as the commands run it.

    Parameters
    ----------
    name : str
        Name of the command.
    tables : type
        The pydantic model of what the stage reads of a case.
    stamp : function of (case, folder)
        Fingerprint of all inputs; raises CaseError where an earlier stage has not been run.
    written : function of (folder)
        Fingerprint of the inputs that what lies there was made from, None where nothing whole does.
    plan : function of (case)
        Checks the case as far as it can without writing; one line on what would be done.
    run : function of (case, folder, stamp)
        Does the work and writes it.
    summary : function of (folder)
        What --json prints, from what has been written.
    flags : function of (parser)
        Adds flags of its own.
    extra : function of (case, folder, options)
        Does what these flags ask for, from what has been written, also where that was up to date.
    """

    name: str
    tables: type[Table]
    stamp: Callable[[Case, Path], str]
    written: Callable[[Path], str | None]
    plan: Callable[[Case], str]
    run: Callable[[Case, Path, str], None]
    summary: Callable[[Path], Mapping[str, Any]]
    flags: Callable[[argparse.ArgumentParser], None] = lambda parser: None
    extra: Callable[[Case, Path, Any], None] = lambda case, folder, options: None


def fingerprint(*parts: object) -> str:
    """Hash inputs, together with the version of the program.

    >>> fingerprint({"a": 1}, "x") == fingerprint({"a": 1}, "x") != fingerprint({"a": 2}, "x")
    True
    """
    text = json.dumps([program_version(), *parts], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def program_version() -> str:
    """Version of the distribution, "unknown" where it is not installed."""
    try:
        return version("geom2iga")
    except PackageNotFoundError:
        return "unknown"


def run_command(description: str, stages: Sequence[Stage], arguments: Sequence[str] | None = None) -> int:
    """Run the stages of one command on a case file and return the exit code.

    0 done or up to date; 1 our bug; 2 bad command or case; 3 geometry; 4 not converged; 5 verification missed;
    130 interrupted, 143 or 129 by SIGTERM or SIGHUP.
    """
    program = stages[0].name if len(stages) == 1 else "iga-run"
    parser = command_parser(program, description, program_version(), [stage.flags for stage in stages])
    options = parser.parse_args(arguments)
    with talking(options.quiet, options.verbose) as console, turned_on(console):
        if options.print_completion:
            return _guarded(program, lambda: print_data(completion(parser, options.print_completion)))
        if options.schema:
            return _guarded(program, lambda: print_json(schema([stage.tables for stage in stages], program)))
        return _guarded(program, lambda: _limited(program, options, stages))


def _guarded(program: str, work: Callable[[], int | None]) -> int:
    """Turn what goes wrong into messages and exit codes."""
    try:
        with interruptible():
            return work() or 0
    except UserError as error:
        return _failed(error.exit_code, str(error))
    except KeyboardInterrupt as error:
        return _failed(exit_code(error), "interrupted; stages that had ended are kept")
    except MemoryError:
        return _failed(CaseError.exit_code, "there is not enough memory for this case: take fewer spans or samples")
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _failed(
            CaseError.exit_code, f"{where}{(error.strerror or str(error)).lower()}; no file was half written"
        )
    except Exception as error:
        log.debug("%s", traceback.format_exc())
        files = [handler.baseFilename for handler in log.handlers if isinstance(handler, logging.FileHandler)]
        where = f"the traceback is in {files[0]}" if files else "run it again with -v for the traceback"
        return _failed(
            OUR_BUG, f"{type(error).__name__}: {error}. This is a bug in {program}: please report it; {where}"
        )


def _limited(program: str, options: Any, stages: Sequence[Stage]) -> int:
    """Run with as much memory, time and threads as the command may take."""
    with threads(options.threads), limited(options.max_memory, options.max_time):
        return _run(program, options, stages)


def _run(program: str, options: Any, stages: Sequence[Stage]) -> int:
    """Check the case, run what is not up to date, print the summary."""
    if options.new:
        if {name for name, value in vars(options).items() if value} - {"new", "quiet", "verbose"}:
            raise CaseError("--new DIR writes a case and runs nothing: it goes with -q and -v alone")
        write_starter(options.new, schema([stage.tables for stage in stages], program))
        return 0
    if options.case is None:
        raise CaseError(f"no case file given; for example: {program} case.toml, or {program} --new folder")
    case = read_case(options.case)
    folder = options.output or case.folder / f"{Path(case.name).stem}.out"
    for stage in stages:
        checked(case, stage.tables)
    if options.dry_run:
        return _print_plans(options, stages, case)
    try:
        stages[0].stamp(case, folder)  # raises where an earlier stage has not been run, before anything is written
        check_ours(folder / SUMMARY)
        log_file = log_to(folder, f"geom2iga {program_version()}")
        for stage in stages:
            _run_stage(stage, case, folder, options)
            log_file.check_there()
    except VerificationError:
        _print_summary(options, stages, folder)
        raise
    except NotConvergedError:
        if options.json:
            with suppress(CaseError):
                print_json(read_sealed(folder / SUMMARY))
        raise
    return _print_summary(options, stages, folder)


def _print_plans(options: Any, stages: Sequence[Stage], case: Case) -> int:
    """Say what would be done."""
    plans = {}
    for stage in stages:
        plans[stage.name] = stage.plan(case)
        log.info("%s: %s", stage.name, plans[stage.name])
    if options.json:
        print_json(plans)
    return 0


def _run_stage(stage: Stage, case: Case, folder: Path, options: Any) -> None:
    stamp = stage.stamp(case, folder)
    written = stage.written(folder)  # raises where something that is not ours would be overwritten
    if written == stamp and not options.force:
        log.info("%s: up to date", stage.name)
    else:
        stage.run(case, folder, stamp)
    stage.extra(case, folder, options)


def discard(folder: Path) -> None:
    """Remove summary.json and all that it lists, because they no longer show what lies beside them."""
    check_ours(folder / SUMMARY)
    for name in (*listed(folder / SUMMARY), SUMMARY):
        (folder / name).unlink(missing_ok=True)


def _failed(code: int, text: str) -> int:
    log.error("%s", text)
    return code


def _print_summary(options: Any, stages: Sequence[Stage], folder: Path) -> int:
    if options.json:
        print_json(stages[-1].summary(folder))
    return 0
