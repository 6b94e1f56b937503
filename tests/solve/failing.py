"""Cases that do not converge, one for each way in which that happens."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from geom2iga.tables import Case
from solve import Status

FIXED = {"ux": 0.0, "uy": 0.0, "uz": 0.0}
CONTACT = {"secondary": "upper/bottom", "primary": "lower/top"}
NAMED = 'in the contact of "upper/bottom" with "lower/top"'


def two_blocks(gap: float = 0.0, turn: float = 0.0, spans: tuple[int, int] = (3, 3), **tables: Any) -> dict[str, Any]:
    """A block pressed onto another, free to move along z, perhaps tilted; tables of [solve] may be put in its place."""
    solve = {
        "material": [{"young": 1000.0, "poisson": 0.3}],
        "support": [
            {"on": "lower/bottom", **FIXED},
            {"on": "upper/left", "normal": 0.0},
            {"on": "upper/front", "normal": 0.0},
        ],
        "load": [{"on": "upper/top", "pressure": 1.0}],
        "contact": [CONTACT],
    }
    lower = {"name": "lower", "size": [2.0, 2.0, 1.0], "spans": [2, 2, 1]}
    upper = {"name": "upper", "origin": [0.5, 0.5, 1.0 + gap], "size": [1.0, 1.0, 1.0], "spans": [*spans, 1]}
    if turn:
        upper["rotate"] = {"axis": [0, 1, 0], "angle": turn}
    return {"geometry": {"degree": 1, "block": [lower, upper]}, "solve": {**solve, **tables}}


def pushed_down(by: float = 0.05, **contact: Any) -> dict[str, Any]:
    """Tables of a tilted block that is pushed onto the other by its top."""
    down = [{"on": "lower/bottom", **FIXED}, {"on": "upper/top", "ux": 0.0, "uy": 0.0, "uz": -by}]
    return {"turn": 3.0, "support": down, "load": [], "contact": [{**CONTACT, **contact}]}


class Failing(NamedTuple):
    """A case that ends with a status, what is to be tried first, and that as a change of the case."""

    tables: Mapping[str, Any]
    advice: str
    change: Mapping[str, Any]

    @property
    def case(self) -> Case:
        """The case, without a file."""
        return Case(dict(self.tables))


WAYS = {
    Status.MAX_STEPS: Failing(
        two_blocks(**pushed_down(), newton={"max_steps": 1}),
        "solve.newton.max_steps above 1",
        {"solve.newton.max_steps": 20},
    ),
    Status.PENETRATION: Failing(
        two_blocks(**pushed_down(enforcement="augmented-lagrange", penalty=10.0), augmentation={"max_steps": 3}),
        f'enforcement = "lagrange", without a penalty, {NAMED}',
        {"solve.contact.0": {**CONTACT, "enforcement": "lagrange"}},
    ),
    Status.UNSETTLED: Failing(
        two_blocks(**pushed_down(method="kts", penalty=1e12), newton={"max_steps": 20}),
        f'a lower penalty {NAMED}, such as "auto"',
        {"solve.contact.0.penalty": "auto"},
    ),
    Status.UNBOUNDED: Failing(
        two_blocks(steps={"factors": [-1.0]}),
        "loads of the other sign",
        {"solve.steps.factors": [1.0]},
    ),
    Status.SINGULAR: Failing(
        two_blocks(material=[{"young": 1000.0, "poisson": 0.49999999999999994}]),
        'a lower Poisson\'s ratio of body "lower"',
        {"solve.material.0.poisson": 0.4999},
    ),
    Status.SLOW: Failing(
        two_blocks(material=[{"young": 1000.0, "poisson": 0.4999999999999}], linear={"method": "iterative"}),
        'a lower Poisson\'s ratio of body "lower"',
        {"solve.material.0.poisson": 0.4999},
    ),
    Status.INACCURATE: Failing(
        two_blocks(contact=[{**CONTACT, "penalty": 1e-10}]),
        f'another penalty {NAMED}, such as "auto"',
        {"solve.contact.0.penalty": "auto"},
    ),
}

# The third of four load steps takes 7 Newton steps, those before it 4.
STOPPED = two_blocks(
    **pushed_down(method="kts", penalty=1e6),
    newton={"max_steps": 5},
    steps={"factors": [0.25, 0.5, 0.75, 1.0]},
)
