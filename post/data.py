"""Data files of a result: VTU and PVD files for ParaView, tables as CSV."""

from collections.abc import Callable, Iterator
from pathlib import Path

from geom2iga.progress import tracked
from geom2iga.signals import uninterrupted
from post.bezier_size import size_of_bezier
from post.case import Post
from post.collection import results_of_steps, write_collection
from post.fields import Samples
from post.gauss import gauss_columns, write_gauss
from post.probes import Probes, write_line, write_point
from post.summary import write_load_steps, write_reactions
from post.vtu import body_columns, write_contact
from solve.output import write_history
from solve.result import Result
from solve.rules import full_rules

Write = Callable[[Path, Samples], None]


def write_data(samples: Samples, post: Post, probes: Probes, folder: Path) -> Iterator[str]:
    """Write all but bodies.vtu, which checks and extremes come from, and yield the name of each file."""
    result = samples.result
    write_history(folder / "history.csv", result.history)
    yield "history.csv"
    if len(result.states) > 1:
        write_load_steps(folder / "load_steps.csv", result)
        yield "load_steps.csv"
    if result.state.reactions:
        write_reactions(folder / "reactions.csv", result)
        yield "reactions.csv"
    if result.contacts:
        yield from _write_steps("contact", write_contact, samples, post, folder)
    if post.bezier:
        yield from _write_steps("bezier", _write_bezier, samples, post, folder)
    if post.gauss_points:
        write_gauss(folder / "gauss.vtu", result)
        yield "gauss.vtu"
    for name, point in probes.points.items():
        write_point(folder / f"point_{name}.csv", point)
        yield f"point_{name}.csv"
    for name, line in probes.lines.items():
        write_line(folder / f"line_{name}.csv", line)
        yield f"line_{name}.csv"


def size_of_data(result: Result, post: Post, samples: int) -> int:
    """Tell how large the large files are, but for their headers [bytes]."""
    columns = list(body_columns(result.model, samples))
    if post.gauss_points:
        columns.extend(gauss_columns(full_rules(result.space)))
    return sum(column.size for column in columns) + (_size_of_bezier(result, post) if post.bezier else 0)


def _size_of_bezier(result: Result, post: Post) -> int:
    return size_of_bezier(result.model) * (len(result.states) if post.load_steps else 1)


def _write_bezier(path: Path, samples: Samples) -> None:
    with uninterrupted():
        from post.bezier import write_bezier  # imports VTK, which dies of an interruption

    write_bezier(path, samples.result)


def _write_steps(kind: str, write: Write, samples: Samples, post: Post, folder: Path) -> Iterator[str]:
    """Write the last load step and, where asked for, those before it and a .pvd file that names them all."""
    write(folder / f"{kind}.vtu", samples)
    yield f"{kind}.vtu"
    if not post.load_steps or len(samples.result.states) < 2:
        return
    earlier = list(results_of_steps(samples.result))[:-1]
    for number, result in enumerate(tracked(earlier, f"{kind} files of load steps"), start=1):
        write(folder / f"{kind}_{number}.vtu", Samples(result, samples.count))
        yield f"{kind}_{number}.vtu"
    names = [*(f"{kind}_{number}.vtu" for number in range(1, len(earlier) + 1)), f"{kind}.vtu"]
    write_collection(folder / f"{kind}.pvd", enumerate(names, start=1))
    yield f"{kind}.pvd"
