"""Problems with known answers at any scale: their size, moduli, place, weights, shape and overlap are free."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

import solve
from geom2iga.bspline import Array
from geom2iga.model import Model
from geom2iga.patch import Patch, elevated, evaluate, refined
from post.exact import Shell
from solve import Result
from tests.cases import block_patch, hollow_cylinder, model_of, moved, stress_at

EPSILON = float(np.finfo(float).eps)
LOST = {"ratio": 50.0, "aspect": 50.0, "poisson": 500.0, "weights": 2e4}  # see Scale.tolerance
STRAIN = 1e-3  # of all problems: loads are so much of the softer modulus
AUTOMATIC = 10.0  # penalty in units of E/h
TUBES = 6  # degree of the tubes

Corner = tuple[float, float, float]


@dataclass(frozen=True)
class Scale:
    """What is extreme about a problem.

    Parameters
    ----------
    length, stress : float
        Size of the bodies and modulus of the first one.
    ratio : float
        Modulus of the second body over that of the first.
    poisson : float
    far : float
        How far from the origin the bodies lie, in sizes.
    stretch : (3,)
        Of the bodies along x, y and z, and so of their spans.
    weights : float
        Factor of all weights of the second body.
    uneven : float
        Largest over smallest weight within the second body.
    gap : float
        Between the bodies before any load, in sizes; negative where they overlap.
    """

    length: float = 1.0
    stress: float = 1.0
    ratio: float = 1.0
    poisson: float = 0.3
    far: float = 0.0
    stretch: Corner = (1.0, 1.0, 1.0)
    weights: float = 1.0
    uneven: float = 1.0
    gap: float = 0.0

    @property
    def softer(self) -> float:
        """The smaller modulus [stress]."""
        return self.stress * min(1.0, self.ratio)

    @property
    def load(self) -> float:
        """Pressure that bodies are loaded with [stress]."""
        return STRAIN * self.softer

    @property
    def aspect(self) -> float:
        """Longest over shortest side of a span."""
        return max(self.stretch) / min(self.stretch)

    def tolerance(self, strain: float = STRAIN, spans: int = 3) -> float:
        """Relative error of stresses that rounding alone may make.

        Places are rounded to eps x distance, so gaps are known to eps x (1 + far) sizes; the strain asks for overlaps
        of (1 / AUTOMATIC spans) of itself: their ratio is the error of pressures. Displacements are rounded to eps of
        themselves: a rigid motion that closes a gap takes digits of strains. The matrix of two stiffnesses, of slender
        spans, of Lamé's constants or of uneven weights loses digits by their ratio: LOST, in eps, is no theory but the
        most that was seen with uniform stress, 13 times the ratio of moduli, 8.4 times the square of the aspect, 130
        times 1 / (1 - 2 ν) and 8,000 times the ratio of weights, with room for other processors. Not counted there is
        what was said to be lost: to conjugate gradients at ν = 0.4999, to quadrature with uneven weights.
        """
        place = (1 + self.far + abs(self.gap)) * AUTOMATIC * spans / strain
        ratios = {
            "ratio": max(self.ratio, 1 / self.ratio),
            "aspect": self.aspect**2,
            "poisson": 1 / (1 - 2 * self.poisson),
            "weights": self.uneven - 1,
        }
        return EPSILON * (place + sum(LOST[name] * ratio for name, ratio in ratios.items()))


class Problem(NamedTuple):
    """A model, a case, and the stress that it must show."""

    model: Model
    case: Mapping[str, Any]
    stress: Array  # (6,) uniform, or (q, 6) at the points of `stresses` [stress]


def placed(patch: Patch, scale: Scale) -> Patch:
    """Stretch, enlarge and move a patch."""
    away = scale.far * np.array([1.0, -0.7, 0.4])
    return replace(patch, control_points=(patch.control_points * scale.stretch + away) * scale.length)


def weighted(patch: Patch, scale: Scale) -> Patch:
    """Multiply all weights, and let them fall along the first direction; the patch changes its map, not its place."""
    fall = scale.uneven ** -np.linspace(0, 1, patch.shape[0])[:, None, None]
    return replace(patch, weights=scale.weights * fall * patch.weights)


def _materials(scale: Scale, names: tuple[str, str] = ("lower", "upper")) -> list[dict[str, Any]]:
    """One material per body."""
    youngs = (scale.stress, scale.stress * scale.ratio)
    return [{"bodies": [n], "young": young, "poisson": scale.poisson} for n, young in zip(names, youngs, strict=True)]


def pressed_blocks(scale: Scale, linear: str = "direct", matching: bool = False, **contact: Any) -> Problem:
    """The contact patch test: a block on a wider one, pressed by its top and by what it leaves bare."""
    spans = ((4, 4, 2), (2, 2, 2)) if matching else ((3, 3, 2), (2, 2, 2))
    lower = block_patch("lower", size=(2, 2, 1), degree=2, spans=spans[0])
    upper = block_patch("upper", (0.5, 0.5, 1), degree=2, spans=spans[1])
    upper = moved(weighted(upper, scale), (0, 0, scale.gap))
    held = ("lower/bottom", "lower/left", "lower/front", "upper/left", "upper/front")
    bare = {"pressure": scale.load, "exposed": True}
    case = {
        "material": _materials(scale),
        "support": [{"on": face, "normal": 0.0} for face in held],
        "load": [{"on": "upper/top", "pressure": scale.load}, {"on": "lower/top", **bare}],
        "contact": [{"secondary": "upper/bottom", "primary": "lower/top", **contact}],
        "linear": {"method": linear},
    }
    stress = np.array([0, 0, -scale.load, 0, 0, 0])
    return Problem(model_of(placed(lower, scale), placed(upper, scale)), {"solve": case}, stress)


def squeezed_blocks(
    scale: Scale, overlap: float, linear: str = "direct", matching: bool = False, **contact: Any
) -> Problem:
    """Two equal blocks between fixed plates, too high for their room by an overlap, in sizes.

    By statics p = d / (H/E_1 + H/E_2 + 1/eps), where eps = 10 E/h is the automatic penalty, h the root of the area of a
    span of the upper side; a multiplier leaves no overlap, 1/eps = 0.
    """
    spans = ((3, 3, 2), (3, 3, 2)) if matching else ((3, 3, 2), (2, 2, 2))
    lower = block_patch("lower", degree=2, spans=spans[0])
    upper = block_patch("upper", (0, 0, 1 - overlap), degree=2, spans=spans[1])
    held = ("lower/bottom", "lower/left", "lower/front", "upper/top", "upper/left", "upper/front")
    case: dict[str, Any] = {
        "material": _materials(scale),
        "support": [{"on": face, "normal": 0.0} for face in held],
        "contact": [{"secondary": "upper/bottom", "primary": "lower/top", **contact}],
        "linear": {"method": linear},
    }
    lower, upper = placed(lower, scale), placed(weighted(upper, scale), scale)
    closed = lower.control_points[..., 2].max() - upper.control_points[..., 2].min()  # what rounding leaves of it
    span = (scale.stretch[0] * scale.stretch[1]) ** 0.5 * scale.length / spans[1][0]
    soft = 0.0
    if _gives_way(contact):
        soft = span / (AUTOMATIC * scale.softer)
        if scale.uneven > 1:  # spans differ, and the automatic penalty goes by the smallest
            case["contact"][0]["penalty"] = 1 / soft
    height = scale.stretch[2] * scale.length
    pressure = closed / (height / scale.stress + height / (scale.stress * scale.ratio) + soft)
    return Problem(model_of(lower, upper), {"solve": case}, np.array([0, 0, -pressure, 0, 0, 0]))


def bar(scale: Scale, linear: str = "direct") -> Problem:
    """A bar in tension."""
    patch = placed(weighted(block_patch("bar", size=(3, 1, 1), degree=2, spans=(3, 2, 2)), scale), scale)
    case = {
        "material": [{"young": scale.stress, "poisson": scale.poisson}],
        "support": [{"on": f"bar/{side}", "normal": 0.0} for side in ("left", "front", "bottom")],
        "load": [{"on": "bar/right", "traction": [scale.load, 0.0, 0.0]}],
        "linear": {"method": linear},
    }
    return Problem(model_of(patch), {"solve": case}, np.array([scale.load, 0, 0, 0, 0, 0]))


def tubes(scale: Scale, linear: str = "direct", matching: bool = False, **contact: Any) -> Problem:
    """A quarter of a tube in a tube under pressure inside, in plane strain; there may be a gap or overlap between."""
    radii = {"inner": (1.0, 2.0), "outer": (2.0 + scale.gap, 3.0)}
    own = {"penalty": AUTOMATIC * scale.softer / scale.length} if _gives_way(contact) else {}
    patches = []
    for (name, between), count in zip(radii.items(), (3, 3) if matching else (3, 2), strict=True):
        patch = elevated(hollow_cylinder(*between, 1.0, name), (TUBES, TUBES, 1))
        cuts = np.arange(1, count) / count
        patches.append(refined(patch, knots=(cuts, cuts, [])))
    sides = ("front", "back", "bottom", "top")
    case = {
        "material": _materials(scale, ("inner", "outer")),
        "support": [{"on": f"{name}/{side}", "normal": 0.0} for name in radii for side in sides],
        "load": [{"on": "inner/left", "pressure": scale.load}],
        "contact": [{"secondary": "inner/right", "primary": "outer/left", **own, **contact}],
        "linear": {"method": linear},
    }
    inner, outer = patches
    outer = replace(outer, weights=scale.weights * outer.weights)
    exact = [_stress_of(*each, scale.poisson) for each in zip(lame(scale, **own), patches, strict=True)]
    return Problem(model_of(placed(inner, scale), placed(outer, scale)), {"solve": case}, np.concatenate(exact))


def _gives_way(contact: Mapping[str, Any]) -> bool:
    """Whether pressures come from overlaps."""
    return contact.get("enforcement", "penalty") == "penalty"


def lame(scale: Scale, penalty: float = np.inf) -> tuple[Shell, Shell]:
    """Find the tubes' closed form at size 1: the pressure on either side of the interface follows from the gap.

    What the inner tube presses with over its radius r, the outer one bears over its own, r + gap, with q r/(r + gap);
    u_outer - u_inner = -gap - q/ε is linear in q. `post.exact.NestedShells` is the same without a gap.
    """
    gap, radius = scale.gap, 2.0

    def under(pressure: float) -> tuple[Shell, Shell]:
        inner = Shell(1.0, radius, scale.stress, scale.poisson, scale.load, pressure, 2)
        borne = pressure * radius / (radius + gap)
        return inner, Shell(radius + gap, 3.0, scale.stress * scale.ratio, scale.poisson, borne, 0.0, 2)

    def apart(pressure: float) -> float:
        inner, outer = under(pressure)
        open_by = outer.displacement(radius + gap) - inner.displacement(radius)
        return float(gap + open_by + pressure / (penalty * scale.length))

    free, pressed = apart(0.0), apart(scale.load)
    return under(scale.load * max(0.0, free / (free - pressed)))


def _stress_of(tube: Shell, patch: Patch, poisson: float) -> Array:
    """Stress (q, 6) of a tube in plane strain at the points of `stresses`."""
    x, y, _ = evaluate(patch, _points(), 0)[0].T
    radius = np.hypot(x, y)
    radial, hoop = tube.radial_stress(radius), tube.hoop_stress(radius)
    c, s = x / radius, y / radius
    along, none = poisson * (radial + hoop), np.zeros_like(x)
    xx, yy, xy = radial * c**2 + hoop * s**2, radial * s**2 + hoop * c**2, (radial - hoop) * c * s
    return np.stack([xx, yy, along, xy, none, none], axis=1)


def _points(count: int = 100) -> Array:
    """Random parametric points (q, 3)."""
    return np.random.default_rng(0).random((count, 3))


def stresses(result: Result) -> Array:
    """Stresses (q, 6) at the same random points of every patch."""
    return np.concatenate([stress_at(result, name, _points()) for name in result.model.patches])


def stress_error(problem: Problem) -> tuple[float, Result]:
    """Solve; the largest error of any stress, in units of the patch's largest; infinite without equilibrium."""
    result = solve.solve(problem.model, problem.case)
    if result.status is not solve.Status.CONVERGED:
        return np.inf, result
    found = stresses(result)
    expected = np.broadcast_to(problem.stress, found.shape)
    each = (len(problem.model.patches), -1)
    off, size = (np.abs(values).reshape(each).max(axis=1) for values in (found - expected, expected))
    return float((off / size).max()), result
