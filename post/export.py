"""From a Result to everything that people look at."""

import shutil
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from geom2iga.errors import CaseError
from geom2iga.progress import progress, tracked
from geom2iga.seal import check_ours, made_folder
from geom2iga.signals import uninterrupted
from geom2iga.stage import log
from geom2iga.tables import Source, checked
from geom2iga.threads import one_blas_thread
from post.case import Post, PostCase
from post.data import size_of_data, write_data
from post.fields import BodySamples, Samples
from post.grid import USUAL, choose_samples, count_points
from post.memory import check_post
from post.probes import Probes, sample_probes
from post.summary import Extremes, extremes_of, summarise
from post.verify import Check, Worst, compare, look_at
from post.vtu import write_bodies
from post.wanted import check_wanted
from solve.analysis import Clock
from solve.output import write_summary
from solve.result import Result


def export(result: Result, source: Source, folder: str | Path, stamp: str = "") -> dict[str, Any]:
    """Write VTU files, tables, pictures, report.html and summary.json into a folder, which is made if need be.

    Parameters
    ----------
    result : Result
        Of whose load steps at least one has converged; where the last one has not, nothing is verified.
    source : path, dict, Case or PostCase
    stamp : str
        Put into the summary, to tell later whether it is up to date.

    Returns
    -------
    dict
        What summary.json holds.

    Raises
    ------
    CaseError
        The case is wrong, no load step has converged, the disk has not the room for all files, or what is not ours
        has the name of the folder or of summary.json in it.
    UserError
        Libraries for drawing are missing.
    """
    case = checked(source, PostCase)
    result.check_converged()
    if result.diagnosis:
        log.warning("iga-post: %s", result.diagnosis.shown)
        case = case.model_copy(update={"verify": ()})
    folder = Path(folder)
    made_folder(folder)
    check_ours(folder / "summary.json")
    contacts = [contact.definition for contact in result.pairs]
    check_wanted(result.model, contacts, case)
    check_post(result.model, contacts, case.post)
    samples = Samples(result, _samples(result, case.post, folder))
    probes = sample_probes(result, case.post)
    clock = Clock()
    with one_blas_thread():
        with clock.phase("files"):
            checks, extremes = _write_bodies(folder / "bodies.vtu", samples, case)
            files = ["bodies.vtu", *write_data(samples, case.post, probes, folder)]
        summary = summarise(samples, checks, extremes)
        pictures: list[str] = []
        if case.post.pictures:
            with clock.phase("pictures"):
                pictures.extend(_draw(samples, case, probes, folder))
        if case.post.report:
            files.append("report.html")
        summary["seconds"] |= clock.seconds
        summary |= {"title": case.title, "units": case.units.model_dump(), "files": sorted([*files, *pictures])}
        if case.post.report:
            _report(samples, summary, source, [folder / name for name in pictures], folder)
    summary["stamp"] = stamp
    write_summary(folder / "summary.json", summary)
    return summary


def _samples(result: Result, post: Post, folder: Path) -> int:
    """Points per span and direction: as the case says, or chosen; raise CaseError where the disk is too small."""
    model = result.model
    samples = post.samples or choose_samples(model)
    if post.samples is None and samples < USUAL:
        points = sum(count_points(patch, USUAL)[0] for patch in model.patches.values())
        log.info(
            "iga-post: %d sample points per span and direction, as %d would make %.2g million; samples in [post] sets "
            "another number",
            *(samples, USUAL, points / 1e6),
        )
    wanted, free = size_of_data(result, post, samples), shutil.disk_usage(folder).free
    if wanted > free:
        raise CaseError(
            f"post.samples: {samples} points per span and direction make files of {wanted / 1e9:.3g} GB in {folder}, "
            f"{free / 1e9:.3g} GB are free: take fewer, set bezier or load_steps in [post] to false, or take another "
            "folder"
        )
    return samples


def _write_bodies(path: Path, samples: Samples, case: PostCase) -> tuple[tuple[Check, ...], dict[str, list[Extremes]]]:
    """Write bodies.vtu, and look at all sample points as they pass: checks, and the extremes of the parts of bodies."""
    model, entries = samples.result.model, case.verify

    def look(name: str, part: BodySamples) -> tuple[str, Extremes, Mapping[int, Worst]]:
        return model.body_of(name), extremes_of(part), look_at(model, entries, name, part)

    looks = write_bodies(path, samples, look)
    extremes = {body: [found for owner, found, _ in looks if owner == body] for body in model.bodies}
    return compare(samples, entries, [worst for _, _, worst in looks]), extremes


def _draw(samples: Samples, case: PostCase, probes: Probes, folder: Path) -> Iterator[str]:
    """Draw all pictures in all formats and yield the names of the files."""
    with uninterrupted():
        from geom2iga.picture import scene  # imports pyvista and matplotlib, which takes a second
        from post import plots

    scene.check_renderer("set pictures = false in [post]")
    for name, draw in tracked(plots.pictures_of(samples, case, probes).items(), "pictures"):
        began = time.perf_counter()
        with uninterrupted():
            figure = draw()
            for ending in case.post.formats:
                scene.save(figure, folder / f"{name}.{ending}")
        log.debug("iga-post: %s, %.2f s", name, time.perf_counter() - began)
        yield from (f"{name}.{ending}" for ending in case.post.formats)


def _report(samples: Samples, summary: Mapping[str, Any], source: Source, pictures: list[Path], folder: Path) -> None:
    """Write report.html."""
    with uninterrupted():
        from post.report.page import write_report  # imports pyvista and trame

    with progress("report"), uninterrupted():
        write_report(folder / "report.html", samples, summary, source, pictures)
