"""From a Result to everything that people look at."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from geom2iga.stage import log, uninterrupted
from geom2iga.tables import Source, checked
from geom2iga.threads import one_blas_thread
from post.case import PostCase
from post.summary import summarise, write_history, write_load_steps, write_summary
from post.verify import verify
from post.vtu import write_bodies, write_contact
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
        The case is wrong, or the result has not converged.
    UserError
        Libraries for drawing are missing.
    """
    case = checked(source, PostCase)
    result.check_converged()
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    samples = case.post.samples
    with one_blas_thread():
        began = time.perf_counter()
        checks = verify(result, case)
        write_bodies(folder / "bodies.vtu", result, samples)
        write_history(folder / "history.csv", result.history)
        files = ["bodies.vtu", "history.csv"]
        if len(result.states) > 1:
            write_load_steps(folder / "load_steps.csv", result)
            files.append("load_steps.csv")
        if result.contacts:
            write_contact(folder / "contact.vtu", result, samples)
            files.append("contact.vtu")
        summary = summarise(result, checks, samples)
        written = time.perf_counter()
        if case.post.pictures:
            files.extend(_draw(result, case, folder))
        summary["seconds"] |= {"files": written - began, "pictures": time.perf_counter() - written}
    summary |= {"title": case.title, "units": case.units.model_dump(), "files": sorted(files), "stamp": stamp}
    write_summary(folder / "summary.json", summary)
    return summary


def _draw(result: Result, case: PostCase, folder: Path) -> Iterator[str]:
    """Draw all pictures and yield their names."""
    with uninterrupted():
        from geom2iga.picture import scene  # imports pyvista and matplotlib, which takes a second
        from post import plots

    scene.check_renderer("set pictures = false in [post]")
    length, force = case.units.length, case.units.force
    stress = f"{force}/{length}²" if length and force else ""
    figures = {
        "displacement.png": lambda: plots.draw_displacement(result, length, case.post.deformation),
        "stress.png": lambda: plots.draw_stress(result, stress, case.post.deformation),
    }
    if result.contacts:
        figures["contact_pressure.png"] = lambda: plots.draw_pressure(result, stress)
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
