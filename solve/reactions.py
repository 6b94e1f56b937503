"""Reactions: what each support exerts on its bodies."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geom2iga.bspline import Array, Indices, Mask
from solve.case import Support
from solve.constraints import PARALLEL, Conditions
from solve.space import Space


@dataclass(frozen=True, eq=False)
class Reaction:
    """What a support exerts on the bodies that it holds, in one state.

    Parameters
    ----------
    number : int
        Of the support in the case.
    on : str
        Its face.
    force : (3,)
    moment : (3,)
        Of these forces about the origin [force length].
    """

    number: int
    on: str
    force: Array
    moment: Array


def find_reactions(
    space: Space, supports: Sequence[Support], conditions: Conditions, carried: Array
) -> tuple[Reaction, ...]:
    """Tell what each support exerts.

    A support pushes and pulls along the directions that it prescribes and no others. Where two of them ask for the
    same at a control point, the first one carries it.

    Parameters
    ----------
    conditions : Conditions
        Of all supports.
    carried : (dofs,)
        Inner forces less loads and contact forces, K u - f - Gᵀ p: on control points that nothing holds, rounding.

    Returns
    -------
    tuple of Reaction
        One per support; together they balance loads and contact forces, as far as these are in equilibrium.
    """
    forces = conditions.directions * _multipliers(conditions, carried.reshape(-1, 3))[:, None]
    moments = np.cross(space.control_points[conditions.control_points], forces)
    totals = np.zeros((2, len(supports), 3))
    np.add.at(totals[0], conditions.sources, forces)
    np.add.at(totals[1], conditions.sources, moments)
    return tuple(
        Reaction(number, support.on, force, moment)
        for number, (support, force, moment) in enumerate(zip(supports, *totals, strict=True))
    )


def _multipliers(conditions: Conditions, forces: Array) -> Array:
    """Forces (c,) along each prescribed direction d_c whose sum at each control point is what it carries, of (n, 3).

    Gram & Schmidt leave out the directions that depend on earlier ones and make e_c of the others, at right angles to
    d_1 ... d_(c-1). So from the last on, each multiplier is e_c·r / e_c·d_c of the rest r that the later ones leave.
    """
    points, places = np.unique(conditions.control_points, return_inverse=True)
    rest, upright = forces[points], np.zeros((len(conditions.values), 3))
    basis, counts = np.zeros((len(points), 3, 3)), np.zeros(len(points), dtype=np.int64)
    multipliers = np.zeros(len(conditions.values))
    turns = list(_turns(places))
    for turn in turns:
        at, direction = places[turn], conditions.directions[turn]
        found = direction - np.einsum("nak,naj,nj->nk", basis[at], basis[at], direction)
        length = np.linalg.norm(found, axis=1)
        new: Mask = length**2 > PARALLEL
        upright[turn[new]] = basis[at[new], counts[at[new]]] = found[new] / length[new, None]
        counts[at[new]] += 1
    for turn in reversed(turns):
        at, direction = places[turn], conditions.directions[turn]
        along = np.einsum("nk,nk->n", upright[turn], direction)
        shares = np.einsum("nk,nk->n", upright[turn], rest[at]) / np.where(along > 0, along, 1.0)
        multipliers[turn] = shares
        rest[at] -= shares[:, None] * direction
    return multipliers


def _turns(places: Indices) -> Iterator[Indices]:
    """Yield the conditions (c,) in turns: the first of every control point, then the second, and so on."""
    order = np.argsort(places, kind="stable")
    first = np.searchsorted(places[order], places[order])
    rank = np.arange(len(order)) - first
    yield from (order[rank == turn] for turn in range(int(rank.max(initial=-1)) + 1))


class Forces(NamedTuple):
    """Forces (dofs,) of a state on all control points."""

    inner: Array  # of the stresses, K u
    load: Array
    contact: Array

    @property
    def carried(self) -> Array:
        """What supports must exert (dofs,), and on free control points what is out of balance."""
        return self.inner - self.load - self.contact
