"""Settings of contact problems, changes that leave their answer as it is, and what is seen of the answer."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import geom2iga
from geom2iga.bspline import Array
from geom2iga.glue import find_glued
from geom2iga.model import Face, Model
from geom2iga.patch import Patch
from solve import Result
from solve.result import ContactResult
from tests.cases import converged, displacement_at, stress_at
from tests.verification.glued_bodies import RIGHT_HANDED, glued_model, turned_round, wall

Table = Mapping[str, Any]  # of [solve]
XX = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))  # the sequence of the components of stress


@dataclass(frozen=True, eq=False)
class Setting:
    """A contact problem, and how it came from the one that it is compared with.

    Parameters
    ----------
    turn, shift : (3, 3), (3,)
        x of the original is length · turn x + shift here.
    length, stress : float
        Factors of all lengths and of all stresses.
    frames : patch name, as it was, to (3, 3)
        Signed permutation from its parameters, counted from the middle, to those it has here.
    """

    model: Model
    table: Table
    turn: Array = field(default_factory=lambda: np.eye(3))
    shift: Array = field(default_factory=lambda: np.zeros(3))
    length: float = 1.0
    stress: float = 1.0
    frames: Mapping[str, Array] = field(default_factory=dict)

    def frame(self, patch: str) -> Array:
        """Signed permutation (3, 3) of the parameters of a patch."""
        return self.frames.get(patch, np.eye(3))

    def xi(self, patch: str, centred: Array) -> Array:
        """Parametric points (q, 3) here of a patch, from points of the original in -1 ... 1."""
        ends = np.array([[at[0], at[-1]] for at in self.model.patches[patch].breaks])
        share = (1 + centred @ self.frame(patch).T) / 2
        return ends[:, 0] * (1 - share) + ends[:, 1] * share

    def face(self, face: Face) -> Face:
        """What a face of the original is here."""
        return placed(face, self.frame(face.patch))


Change = Callable[[Setting, np.random.Generator], Setting]


def placed(face: Face, frame: Array) -> Face:
    """A face of a patch whose parameters are permuted."""
    outward = frame @ (np.eye(3)[face.axis] * (2 * face.side - 1))
    axis = int(np.argmax(np.abs(outward)))
    return Face(face.patch, axis, int(outward[axis] > 0))


def with_patches(setting: Setting, change: Callable[[Patch], Patch]) -> Setting:
    """Change every patch, but not which faces are glued."""
    patches = {name: change(patch) for name, patch in setting.model.patches.items()}
    return replace(setting, model=replace(setting.model, patches=patches))


def with_vectors(table: Table, turn: Array, length: float, stress: float) -> Table:
    """Turn and scale all vectors and numbers with units of a [solve] table; supports are along normals or whole."""
    scales = {"young": stress, "pressure": stress, "penalty": stress / length, "reach": length, "normal": length}

    def scaled(entry: Table) -> dict[str, Any]:
        found = dict(entry)
        for key in scales.keys() & {name for name, value in entry.items() if isinstance(value, float)}:
            found[key] = entry[key] * scales[key]
        if "ux" in entry:
            vector = length * turn @ [entry["ux"], entry["uy"], entry["uz"]]
            found |= dict(zip(("ux", "uy", "uz"), vector.tolist(), strict=True))
        if "traction" in entry:
            found["traction"] = (stress * turn @ entry["traction"]).tolist()
        return found

    return {key: list(map(scaled, value)) if isinstance(value, list) else value for key, value in table.items()}


def moved(setting: Setting, random: np.random.Generator) -> Setting:
    """Move all bodies by up to 100 sizes."""
    points = np.concatenate([p.control_points.reshape(-1, 3) for p in setting.model.patches.values()])
    by = random.uniform(-100, 100, 3) * np.ptp(points, axis=0).max()
    found = with_patches(setting, lambda patch: replace(patch, control_points=patch.control_points + by))
    return replace(found, shift=setting.shift + by)


def turned(setting: Setting, random: np.random.Generator) -> Setting:
    """Turn all bodies about any axis by any angle, with all that acts on them."""
    return turned_by(setting, Rotation.random(random_state=random.integers(2**32)).as_matrix())


def turned_squarely(setting: Setting, random: np.random.Generator) -> Setting:
    """Turn all bodies so that axes become axes."""
    axes, reverse = RIGHT_HANDED[random.integers(len(RIGHT_HANDED))]
    return turned_by(setting, _signed(axes, reverse))


def turned_by(setting: Setting, turn: Array) -> Setting:
    """Turn all bodies about the origin, with all that acts on them."""
    found = with_patches(setting, lambda patch: replace(patch, control_points=patch.control_points @ turn.T))
    table = with_vectors(setting.table, turn, 1.0, 1.0)
    return replace(found, table=table, turn=turn @ setting.turn, shift=turn @ setting.shift)


def scaled(setting: Setting, random: np.random.Generator) -> Setting:
    """Scale all lengths and all stresses, by no powers of two."""
    length, stress = 10 ** random.uniform(-6, 6, 2)
    found = with_patches(setting, lambda patch: replace(patch, control_points=length * patch.control_points))
    table = with_vectors(setting.table, np.eye(3), length, stress)
    lengths = {"length": length * setting.length, "shift": length * setting.shift}
    return replace(found, table=table, stress=stress * setting.stress, **lengths)


def renumbered(setting: Setting, random: np.random.Generator) -> Setting:
    """Put patches, bodies, groups, and the entries of the case in another sequence."""
    model = setting.model
    patches, bodies, groups = (_shuffled(part.items(), random) for part in (model.patches, model.bodies, model.groups))
    table = {
        key: _shuffled(value, random) if isinstance(value, list) else value
        for key, value in _shuffled(setting.table.items(), random)
    }
    found = Model(
        dict(patches),
        {name: tuple(_shuffled(own, random)) for name, own in bodies},
        {name: tuple(_shuffled(faces, random)) for name, faces in groups},
    )
    return replace(setting, model=reglued(found), table=table)


def turned_about(setting: Setting, random: np.random.Generator) -> Setting:
    """Swap and reverse the parameter directions of each patch; it stays right-handed."""
    model, frames, patches = setting.model, {}, {}
    for name, patch in model.patches.items():
        axes, reverse = RIGHT_HANDED[random.integers(len(RIGHT_HANDED))]
        frames[name], patches[name] = _signed(axes, reverse), turned_round(patch, axes, reverse)
    groups = {name: tuple(placed(face, frames[face.patch]) for face in faces) for name, faces in model.groups.items()}
    found = reglued(Model(patches, model.bodies, groups))
    return replace(setting, model=found, frames={name: own @ setting.frame(name) for name, own in frames.items()})


def other_knots(setting: Setting, random: np.random.Generator) -> Setting:
    """Let the knots of each direction run over any interval."""

    def stretched(knots: Array) -> Array:
        start, length = random.uniform(-5, 5), 10 ** random.uniform(-2, 2)
        return start + length * knots

    return with_patches(setting, lambda patch: replace(patch, knots=tuple(map(stretched, patch.knots))))


def other_weights(setting: Setting, random: np.random.Generator) -> Setting:
    """Multiply the weights of each patch by a constant."""
    return with_patches(setting, lambda patch: replace(patch, weights=patch.weights * 10 ** random.uniform(-3, 3)))


CHANGES: tuple[Change, ...] = (
    *(moved, turned, turned_squarely, scaled),
    *(renumbered, turned_about, other_knots, other_weights),
)


def reglued(model: Model) -> Model:
    """Find anew which faces of each body are glued."""
    glued = [pair for own in model.bodies.values() for pair in find_glued([model.patches[name] for name in own])]
    return replace(model, glued=tuple(glued))


def _signed(axes: Sequence[int], reverse: Sequence[int]) -> Array:
    """Matrix (3, 3) that takes axes in another sequence, then some of them backwards."""
    signs = np.where(np.isin(np.arange(3), list(reverse)), -1.0, 1.0)
    return np.eye(3)[list(axes)] * signs[:, None]


def _shuffled(items: Any, random: np.random.Generator) -> list[Any]:
    found = list(items)
    return [found[k] for k in random.permutation(len(found))]


def solved(setting: Setting) -> Result:
    """Solve, and insist on equilibrium."""
    return converged(setting.model, {"solve": setting.table})


def observed(result: Result, setting: Setting, original: Setting) -> dict[str, Array]:
    """What is seen of a result, in the frame and units of the original, at its material points."""
    random = np.random.default_rng(0)
    found: dict[str, list[Array]] = {"displacement": [], "stress": []}
    for name in original.model.patches:
        xi = setting.xi(name, random.uniform(-1, 1, (20, 3)))
        found["displacement"].append(displacement_at(result, name, xi) @ setting.turn / setting.length)
        tensor = np.empty((len(xi), 3, 3))
        for (i, j), values in zip(XX, stress_at(result, name, xi).T, strict=True):
            tensor[:, i, j] = tensor[:, j, i] = values / setting.stress
        found["stress"].append(setting.turn.T @ tensor @ setting.turn)
    whole = {name: np.concatenate(parts) for name, parts in found.items()}
    energy = result.statistics["strain_energy"] / setting.stress / setting.length**3
    return whole | {"energy": np.array(energy)} | _contacts(result, setting, original)


def _contacts(result: Result, setting: Setting, original: Setting) -> dict[str, Array]:
    """Force, area, gaps and pressure of each pass of each contact of a result, as the original has them."""
    found: dict[str, Array] = {}
    for contact in result.contacts:
        secondary = contact.definition.secondary
        key = f"{secondary} on {contact.definition.primary}: "
        found[key + "force"] = contact.force @ setting.turn / (setting.stress * setting.length**2)
        found[key + "area"] = np.array(contact.area / setting.length**2)
        if contact.definition.method == "kts":  # its pressures are those of quadrature points, which rounding may place
            continue
        centres = (contact.centres - setting.shift) @ setting.turn / setting.length
        sequence = np.lexsort(np.round(centres / np.ptp(centres, axis=0).max(), 6).T)
        found[key + "centres"] = centres[sequence]
        found[key + "active"] = contact.active[sequence].astype(float)
        found[key + "gaps"] = contact.control_gap[sequence] / setting.length
        faces = original.model.faces(secondary)
        found[key + "pressure"] = np.concatenate([_pressure(result, contact, setting, face) for face in faces])
    return found


def _pressure(result: Result, contact: ContactResult, setting: Setting, face: Face) -> Array:
    """Pressure (q,) at points of a secondary face of the original."""
    centred = np.random.default_rng(1).uniform(-1, 1, (20, 3))
    centred[:, face.axis] = 2 * face.side - 1
    here = setting.face(face)
    return result.pressure_at(contact, here, setting.xi(face.patch, centred)[:, list(here.axes)]) / setting.stress


def largest_difference(found: Mapping[str, Array], expected: Mapping[str, Array]) -> tuple[float, str]:
    """What differs most of all that is seen, over its largest value; gaps over the largest displacement."""
    assert found.keys() == expected.keys()
    size = np.abs(expected["displacement"]).max()
    differences = []
    for key, value in expected.items():
        scale = size if key.endswith("gaps") else np.abs(value).max()
        differences.append((float(np.abs(found[key] - value).max() / scale), key))
    return max(differences)


def still(face: str, by: Sequence[float] = (0.0, 0.0, 0.0)) -> dict[str, Any]:
    """A support that moves a face by a vector."""
    return {"on": face, **dict(zip(("ux", "uy", "uz"), by, strict=True))}


def pressed(supports: Sequence[Table], loads: Sequence[Table], sides: tuple[str, str], **contact: Any) -> Table:
    """The [solve] table of two bodies, the first of them stiffer."""
    bodies = [side.split("/")[0] for side in sides]
    return {
        "material": [
            {"bodies": [bodies[0]], "young": 1500.0, "poisson": 0.2},
            {"bodies": [bodies[1]], "young": 1000.0, "poisson": 0.35},
        ],
        "support": list(supports),
        "load": list(loads),
        "contact": [{"secondary": sides[0], "primary": sides[1], **contact}],
    }


def built(*entries: tuple[str, Table], degree: int = 2) -> Model:
    """Build bodies: the name of a table of [geometry] and an entry of it."""
    geometry: dict[str, Any] = {"degree": degree}
    for shape, entry in entries:
        geometry.setdefault(shape, []).append(dict(entry))
    return geom2iga.build({"geometry": geometry})


def blocks(**contact: Any) -> Setting:
    """A block askew on another, pushed down at its top and pulled aside at a flank: it lifts off at one edge."""
    lower = {"name": "lower", "size": [2, 2, 1], "spans": [3, 4, 2]}
    upper = {"name": "upper", "origin": [0.45, 0.55, 1], "size": [1, 1, 0.8], "spans": [3, 2, 2]}
    model = built(("block", lower), ("block", upper | {"rotate": {"angle": 20}}))
    loads = [{"on": "lower/left", "traction": [1.0, 2.0, -3.0]}]
    held = [still("lower/bottom"), still("upper/top", (0.004, -0.003, -0.02))]
    return Setting(model, pressed(held, loads, ("upper/bottom", "lower/top"), **contact))


def dome(bottom: str, **contact: Any) -> Setting:
    """A block with a round bottom, pushed into a block: part of it touches, and the set of what does is to be found."""
    upper = {"name": "upper", "size": [1, 1, 0.5], "radius": 2.0, "bottom": bottom, "spans": [6, 5, 1]}
    lower = {"name": "lower", "origin": [-0.7, -0.6, -0.6], "size": [1.5, 1.3, 0.6], "spans": [4, 5, 1]}
    model = built(("domed_block", upper), ("block", lower))
    held = [still("lower/bottom"), still("upper/top", (0.003, 0.002, -0.05))]
    return Setting(model, pressed(held, [], ("upper/bottom", "lower/top"), **contact))


def rings(**contact: Any) -> Setting:
    """A quarter of a ring in another, between planes of symmetry, under pressure from inside and a pull."""
    inner = {"name": "inner", "inner": 1.0, "outer": 2.0, "height": 0.5, "angle": 90.0, "spans": [2, 4, 1]}
    outer = {"name": "outer", "inner": 2.0, "outer": 3.0, "height": 0.5, "angle": 90.0, "spans": [2, 3, 1]}
    model = built(("pipe", inner), ("pipe", outer))
    held = [{"on": f"{body}/{side}", "normal": 0.0} for body in ("inner", "outer") for side in ("start", "end")]
    held += [{"on": f"{body}/bottom", "normal": 0.0} for body in ("inner", "outer")]
    loads = [{"on": "inner/inner", "pressure": 10.0}, {"on": "outer/top", "traction": [0.5, 0.25, 1.0]}]
    return Setting(model, pressed(held, loads, ("inner/outer", "outer/inner"), **contact))


def glued(**contact: Any) -> Setting:
    """Half a cylinder of several patches on a block of four: knot lines, seams and edges cross everywhere."""
    upper = {"name": "upper", "origin": [0.1, -0.05, 0.5], "radius": 0.6, "height": 0.6, "angle": 180, "spans": 1}
    cylinder = built(("cylinder", upper))
    lower = wall("lower", (-0.8, -0.8, 0), (1.6, 1.6, 0.5), 2, ((2, 1), (1, 2), (1,)), (0.1, -0.05))
    block = glued_model({"lower": lower})
    model = Model(
        {**cylinder.patches, **block.patches},
        {**cylinder.bodies, **block.bodies},
        {**cylinder.groups, **block.groups},
        cylinder.glued + block.glued,
    )
    held = [still("lower/bottom"), still("upper/top", (0.004, 0.002, -0.015))]
    loads = [{"on": "lower/left", "traction": [1.0, 0.5, -2.0]}]
    return Setting(model, pressed(held, loads, ("upper/bottom", "lower/top"), **contact))


def three_steps(setting: Setting) -> Setting:
    """Apply the loads in three shares, the second larger than the last."""
    return replace(setting, table={**setting.table, "steps": {"factors": [0.4, 1.2, 1.0]}})


def iteratively(setting: Setting) -> Setting:
    """Solve by conjugate gradients."""
    return replace(setting, table={**setting.table, "linear": {"method": "iterative"}})
