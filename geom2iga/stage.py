"""What the commands share: flags, exit codes, log, stamps, resume."""

import argparse
import hashlib
import json
import logging
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from pydantic import create_model
from rich.console import Console

from geom2iga.errors import CaseError, UserError, VerificationError
from geom2iga.tables import Case, Table, checked, read_case

log = logging.getLogger("geom2iga")

OUR_BUG, INTERRUPTED = 1, 130


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
    130 interrupted.
    """
    program = stages[0].name if len(stages) == 1 else "iga-run"
    parser = _parser(program, description)
    for stage in stages:
        stage.flags(parser)
    options = parser.parse_args(arguments)
    if options.schema:
        return _print_json(_schema(stages))
    _talk(options)
    try:
        return _run(program, options, stages)
    except UserError as error:
        return _failed(error.exit_code, str(error))
    except KeyboardInterrupt:
        return _failed(INTERRUPTED, "interrupted; stages that had ended are kept")
    except MemoryError:
        return _failed(CaseError.exit_code, "there is not enough memory for this case: take fewer spans or samples")
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _failed(
            CaseError.exit_code, f"{where}{(error.strerror or str(error)).lower()}; nothing was half written"
        )
    except Exception as error:
        log.debug("%s", traceback.format_exc())
        files = [handler.baseFilename for handler in log.handlers if isinstance(handler, logging.FileHandler)]
        where = f"the traceback is in {files[0]}" if files else "run it again with -v for the traceback"
        return _failed(
            OUR_BUG, f"{type(error).__name__}: {error}. This is a bug in {program}: please report it; {where}"
        )


def _run(program: str, options: Any, stages: Sequence[Stage]) -> int:
    """Check the case, run what is not up to date, print the summary."""
    if options.case is None:
        raise CaseError(f"no case file given; for example: {program} case.toml")
    case = read_case(options.case)
    folder = options.output or case.folder / f"{Path(case.name).stem}.out"
    for stage in stages:
        checked(case, stage.tables)
    if options.dry_run:
        for stage in stages:
            log.info("%s: %s", stage.name, stage.plan(case))
        return 0
    stages[0].stamp(case, folder)  # raises where an earlier stage has not been run, before anything is written
    _log_to(folder)
    try:
        for stage in stages:
            _run_stage(stage, case, folder, options)
    except VerificationError:
        _print_summary(options, stages, folder)
        raise
    return _print_summary(options, stages, folder)


def _run_stage(stage: Stage, case: Case, folder: Path, options: Any) -> None:
    stamp = stage.stamp(case, folder)
    if not options.force and stage.written(folder) == stamp:
        log.info("%s: up to date", stage.name)
    else:
        stage.run(case, folder, stamp)
    stage.extra(case, folder, options)


def listed(folder: Path) -> set[str]:
    """Return the names of the files that summary.json lists, none where there is no such list."""
    try:
        names = json.loads((folder / "summary.json").read_text(encoding="utf-8"))["files"]
        return {name for name in names if Path(name).name == name}
    except (OSError, ValueError, KeyError, TypeError):
        return set()


def discard(folder: Path) -> None:
    """Remove summary.json and all that it lists, because they no longer show what lies beside them."""
    for name in (*listed(folder), "summary.json"):
        (folder / name).unlink(missing_ok=True)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold an interruption (Ctrl-C) back until the end: VTK dies of one in the middle of its work."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: received.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if received:
        raise KeyboardInterrupt


def _failed(code: int, text: str) -> int:
    log.error("%s", text)
    return code


def _print_summary(options: Any, stages: Sequence[Stage], folder: Path) -> int:
    return _print_json(stages[-1].summary(folder)) if options.json else 0


def _print_json(data: Mapping[str, Any]) -> int:
    """Print on standard output; whoever reads it may stop early."""
    try:
        print(json.dumps(data, indent=2), flush=True)
    except BrokenPipeError:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - so that the interpreter's own flush at exit is quiet
    return 0


def _parser(program: str, description: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=program, description=description, epilog=f"example: {program} examples/contact_patch_test/case.toml"
    )
    parser.add_argument("case", nargs="?", type=Path, help="case file (TOML)")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="output folder, <case>.out beside the case")
    parser.add_argument("-n", "--dry-run", action="store_true", help="check the case, say what would be done, stop")
    parser.add_argument("-f", "--force", action="store_true", help="run even what is up to date")
    parser.add_argument("-q", "--quiet", action="store_true", help="print errors only")
    parser.add_argument("-v", "--verbose", action="store_true", help="print details")
    parser.add_argument("--json", action="store_true", help="print the summary on standard output")
    parser.add_argument("--schema", action="store_true", help="print the JSON schema of the case file")
    parser.add_argument("--version", action="version", version=f"{program} {program_version()}")
    return parser


def _schema(stages: Sequence[Stage]) -> dict[str, Any]:
    """JSON schema of all that the stages read of a case."""
    fields = {name: (f.annotation, f) for stage in stages for name, f in stage.tables.model_fields.items()}
    return create_model("Case", __base__=Table, **fields).model_json_schema()  # type: ignore[call-overload]


class Terminal(logging.Handler):
    """Prints messages on standard error, errors in red, without breaking lines."""

    def __init__(self) -> None:
        super().__init__()
        self.console = Console(stderr=True, soft_wrap=True, markup=False, highlight=False)

    def emit(self, record: logging.LogRecord) -> None:
        """Print one message."""
        self.console.print(self.format(record), style="red" if record.levelno >= logging.ERROR else None)


def _talk(options: Any) -> None:
    """Send messages to standard error, as loud as asked for."""
    for handler in list(log.handlers):
        log.removeHandler(handler)
        handler.close()
    handler = Terminal()
    handler.setLevel(logging.ERROR if options.quiet else logging.DEBUG if options.verbose else logging.INFO)
    log.addHandler(handler)
    log.setLevel(logging.DEBUG)
    log.propagate = False


def _log_to(folder: Path) -> None:
    """Send all messages to log.txt too, after those of earlier runs."""
    path = folder / "log.txt"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handler = logging.FileHandler(path, encoding="utf-8")
    except OSError as error:
        raise CaseError(f"{folder}: cannot write there ({error.strerror}); name another folder with -o") from None
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(message)s"))
    log.addHandler(handler)
    log.debug("%s %s, process %d", " ".join(sys.argv), program_version(), os.getpid())
