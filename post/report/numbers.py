"""Numbers as people read them, with the exact value behind."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from geom2iga.tables import Units

DIGITS = 6  # significant
THIN = "\u202f"  # space between thousands
NONE = "–"


def readable(value: float, digits: int = DIGITS) -> Markup:
    """Write a number as text or HTML.

    >>> print(readable(-0.25), readable(-2.5e-13), readable(1e6))
    −0.25 −2.5 · 10<sup>−13</sup> 1 · 10<sup>6</sup>
    """
    if isinstance(value, int):
        return Markup(f"{value:,}".replace(",", THIN).replace("-", "−"))
    if not math.isfinite(value):
        return Markup("not a number" if math.isnan(value) else f"{value}".replace("-", "−").replace("inf", "∞"))
    mantissa, _, exponent = f"{value:.{digits}g}".replace("-", "−").partition("e")
    if not exponent:
        return Markup(mantissa)
    sign = "−" if exponent.startswith("−") else ""
    return Markup(f"{mantissa} · 10<sup>{sign}{exponent.lstrip('−+0')}</sup>")


def shown(value: float | None, unit: str = "", digits: int = DIGITS, key: str = "") -> Markup:
    """Make the element of a number: readable, its exact value in attributes, and where in summary.json it stands."""
    if value is None:
        return Markup(NONE)
    exact = f"{value!r}"
    where = Markup(' data-key="{}"').format(key) if key else Markup("")
    text = readable(value, digits)
    after = Markup(" <abbr>{}</abbr>").format(unit) if unit else ""
    return Markup('<data value="{}" title="{}"{}>{}</data>{}').format(exact, exact, where, text, after)


def look_up(summary: Mapping[str, Any], keys: Sequence[str | int]) -> Any:
    """Find what stands in the summary where a path of keys and list numbers leads."""
    found: Any = summary
    for key in keys:
        found = found[key]
    return found


def unit_names(labels: Mapping[str, str]) -> dict[str, str]:
    """Name the units of all quantities, by dimension; empty where a label that they are made of is missing."""
    units = Units(**labels)
    length, force = units.length, units.force
    both = {
        "stress": units.stress,
        "moment": f"{force}·{length}",
        "energy": f"{force}·{length}",
        "penalty": f"{force}/{length}³",
    }
    powers = {"area": f"{length}²", "volume": f"{length}³"}
    return {
        "length": length,
        "force": force,
        **{name: unit if length else "" for name, unit in powers.items()},
        **{name: unit if length and force else "" for name, unit in both.items()},
        "none": "",
    }
