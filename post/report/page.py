"""The page itself."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from geom2iga.files import replacing
from geom2iga.stage import program_version
from geom2iga.tables import Source, checked
from post.case import PostCase
from post.fields import Samples
from post.plots.deformation import deformation_scale
from post.report import tables
from post.report.numbers import DIGITS, look_up, readable, shown, unit_names
from post.report.pictures import embedded
from post.report.scene import draw_scene
from post.source import case_text

TEMPLATE = "report.html.j2"


def write_report(
    path: str | Path, samples: Samples, summary: Mapping[str, Any], source: Source, pictures: Sequence[str | Path]
) -> None:
    """Write a page of HTML that holds all of a run: numbers, case, pictures and a scene to turn.

    It needs no other file and no network. A number of the summary stands in an element whose data-key says where in
    summary.json it comes from, and whose value is exact.

    Parameters
    ----------
    samples : Samples
        Of a result that has converged.
    summary : mapping
        What summary.json holds, with title and units.
    source : path, dict, Case or PostCase
        The case; its text is shown, but of a PostCase.
    pictures : sequence of path
        Those that have been drawn, PNG or SVG; others are left out.

    Raises
    ------
    UserError
        trame-vtk, or a library that VTK needs, is missing.
    """
    case = checked(source, PostCase)
    scale = case.post.deformation or deformation_scale(samples.result)
    page = (
        _environment(summary)
        .get_template(TEMPLATE)
        .render(
            summary=summary,
            result=samples.result,
            case=case_text(source),
            scene=draw_scene(samples, scale),
            scale=scale,
            pictures=list(embedded([Path(each) for each in pictures], case.post)),
            version=program_version(),
        )
    )
    with replacing(Path(path)) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _environment(summary: Mapping[str, Any]) -> Environment:
    """The language of the template: what is put in is escaped, and what is missing is an error."""
    environment = Environment(
        loader=PackageLoader("post.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    unit = unit_names(summary["units"])

    def value(*path: Any, dimension: str = "none", digits: int = DIGITS) -> Markup:
        """The number at a place of the summary, which keys and lists of keys lead to, with its unit."""
        keys = [key for part in path for key in (part if isinstance(part, list) else [part])]
        return shown(look_up(summary, keys), unit[dimension], digits, ".".join(map(str, keys)))

    environment.filters.update(number=shown, readable=readable)
    environment.globals.update(value=value, unit=unit, tables=tables, enumerated=enumerate)
    return environment
