"""What mkdocs does beside its own work: formulas to MathML, the examples as pages."""

import html
import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

EXAMPLES = Path(__file__).parents[1]
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Take in the examples that lie beside the guide: their README.md as pages, and their pictures."""
    for readme in sorted(EXAMPLES.glob("*/README.md")):
        for path in (readme, *readme.parent.glob("*.png")):
            name = path.relative_to(EXAMPLES.parent).as_posix()
            files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_content(content: str, **_: Any) -> str:
    """Turn the formulas of a page, marked by arithmatex, into MathML, which browsers show by themselves."""
    return FORMULA.sub(_as_mathml, content)


def _as_mathml(found: re.Match[str]) -> str:
    """Turn one formula into MathML."""
    _, bracket, formula = found.groups()
    return convert(html.unescape(formula).strip(), display="block" if bracket == "[" else "inline")
