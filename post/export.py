"""From a Result to everything that people look at."""

import shutil
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from geom2iga.errors import CaseError
from geom2iga.model import Model
from geom2iga.stage import log, uninterrupted
from geom2iga.tables import Source, checked
from geom2iga.threads import one_blas_thread
from post.case import PostCase
from post.fields import BodySamples, Samples
from post.grid import USUAL, choose_samples, count_points
from post.summary import Extremes, extremes_of, summarise, write_history, write_load_steps, write_summary
from post.verify import Check, Worst, check_names, compare, look_at
from post.vtu import body_columns, write_bodies, write_contact
from solve.result import Result


def export(result: Result, source: Source, folder: str | Path, stamp: str = "") -> dict[str, Any]:
    """Write VTU files, pictures, history.csv and summary.json into a folder, which is made if need be.

    Parameters
    ----------
    result : Result
        Converged.
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
        The case is wrong, the result has not converged, or the disk has not the room for all sample points.
    UserError
        Libraries for drawing are missing.
    """
    case = checked(source, PostCase)
    result.check_converged()
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    check_names(result.model, [contact.definition for contact in result.pairs], case.verify)
    samples = Samples(result, _samples(result.model, case, folder))
    with one_blas_thread():
        began = time.perf_counter()
        checks, extremes = _write_bodies(folder / "bodies.vtu", samples, case)
        write_history(folder / "history.csv", result.history)
        files = ["bodies.vtu", "history.csv"]
        if len(result.states) > 1:
            write_load_steps(folder / "load_steps.csv", result)
            files.append("load_steps.csv")
        if result.contacts:
            write_contact(folder / "contact.vtu", samples)
            files.append("contact.vtu")
        summary = summarise(samples, checks, extremes)
        written = time.perf_counter()
        if case.post.pictures:
            files.extend(_draw(samples, case, folder))
        summary["seconds"] |= {"files": written - began, "pictures": time.perf_counter() - written}
    summary |= {"title": case.title, "units": case.units.model_dump(), "files": sorted(files), "stamp": stamp}
    write_summary(folder / "summary.json", summary)
    return summary


def _samples(model: Model, case: PostCase, folder: Path) -> int:
    """Points per span and direction: as the case says, or chosen; raise CaseError where the disk is too small."""
    samples = case.post.samples or choose_samples(model)
    if case.post.samples is None and samples < USUAL:
        points = sum(count_points(patch, USUAL)[0] for patch in model.patches.values())
        log.info(
            "iga-post: %d sample points per span and direction, as %d would make %.2g million; samples in [post] sets "
            "another number",
            *(samples, USUAL, points / 1e6),
        )
    wanted, free = sum(column.size for column in body_columns(model, samples)), shutil.disk_usage(folder).free
    if wanted > free:
        raise CaseError(
            f"post.samples: {samples} points per span and direction make {folder / 'bodies.vtu'} "
            f"{wanted / 1e9:.3g} GB large, {free / 1e9:.3g} GB are free: take fewer, or another folder"
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


def _draw(samples: Samples, case: PostCase, folder: Path) -> Iterator[str]:
    """Draw all pictures and yield their names."""
    result = samples.result
    with uninterrupted():
        from geom2iga.picture import scene  # imports pyvista and matplotlib, which takes a second
        from post import plots

    scene.check_renderer("set pictures = false in [post]")
    length, force, stress = case.units.length, case.units.force, case.units.stress
    drawn = plots.drawn(samples)
    figures = {
        "displacement.png": lambda: plots.draw_displacement(drawn, length, case.post.deformation),
        "stress.png": lambda: plots.draw_stress(drawn, stress, case.post.deformation),
    }
    if result.contacts:
        figures["contact_pressure.png"] = lambda: plots.draw_pressure(drawn, stress)
    if result.contacts and len(result.states) > 1:
        figures["load_steps.png"] = lambda: plots.draw_load_steps(result, force)
    if result.history:
        figures["newton.png"] = lambda: plots.draw_newton(result.history)
    for name, draw in figures.items():
        began = time.perf_counter()
        with uninterrupted():
            scene.save(draw(), folder / name)
        log.debug("iga-post: %s, %.2f s", name, time.perf_counter() - began)
        yield name
