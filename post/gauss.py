"""Stress at Gauss points: what the analysis itself evaluates, neither continued to knots nor smoothed."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from math import prod
from pathlib import Path

import numpy as np

from geom2iga.bspline import Array
from geom2iga.patch import Patch
from post.fields import BodySamples
from post.vtu import BODY_FIELDS, Column, fill, lay_out, opened
from solve.bricks import Brick, find_bricks
from solve.material import Material
from solve.metric import map_of, scaling
from solve.result import Result
from solve.rules import Rules, full_rules

FIELDS = BODY_FIELDS | {"weight": 1}


@dataclass(frozen=True, eq=False)
class GaussSamples(BodySamples):
    """Fields of a patch, or a part of one, at Gauss points; each is a cell of its own, (q, 1).

    Parameters
    ----------
    weight : (q,)
        Volume that a point stands for [length³]: quadrature weight times det J.
    """

    weight: Array


def gauss_samples(result: Result, name: str) -> GaussSamples:
    """Evaluate a patch at its Gauss points, as many per span as assembly takes.

    The points of a run of neighbouring spans stand together; see `solve.bricks`.
    """
    parts = [part for _, part in gauss_bricks(result, name, full_rules(result.space)[name])]
    names = [field.name for field in fields(GaussSamples) if field.name != "cells"]
    merged = {field: np.concatenate([getattr(part, field) for part in parts]) for field in names}
    return GaussSamples(**merged, cells=np.arange(len(merged["weight"]))[:, None])


def gauss_bricks(result: Result, name: str, rules: Rules) -> Iterator[tuple[Brick, GaussSamples]]:
    """Yield the bricks of a patch and what is at their points; cells are numbered on from one to the next.

    Raises
    ------
    GeometryError
        The Jacobian is not positive at a point.
    """
    patch, material = result.model.patches[name], result.materials[result.model.body_of(name)]
    displacement = result.displacement_of(name).reshape(patch.control_points.shape)
    both = np.moveaxis(np.concatenate([patch.control_points, displacement], axis=-1), -1, 0) * scaling(patch)
    first = 0
    for brick in find_bricks(patch, rules):
        part = _evaluated(brick, patch, both[:, *brick.functions], material, first)
        first += len(part.weight)
        yield brick, part


def _evaluated(brick: Brick, patch: Patch, coefficients: Array, material: Material, first: int) -> GaussSamples:
    """Evaluate a brick from weighted control points and displacements (6, n_1, n_2, n_3)."""
    cofactors, determinant, weight, slopes = map_of(brick, patch)
    sampled = brick.gradients(coefficients, values=True) / weight
    gradient = sampled[3:, :3]
    if slopes is not None:
        gradient -= sampled[3:, 3:] * slopes
    gradient = np.einsum("iaq,ajq->ijq", gradient, cofactors / determinant)
    stress = material.stress(gradient.transpose(2, 0, 1))
    cells = np.arange(first, first + len(determinant))[:, None]
    return GaussSamples(sampled[:3, 3].T, sampled[3:, 3].T, stress, cells, determinant * brick.weights)


def write_gauss(path: Path, result: Result) -> None:
    """Write the Gauss points of the undeformed bodies as vertices.

    Point data are those of bodies.vtu and weight, the volume that a point stands for; cell data body.
    """
    rules, numbers = full_rules(result.space), result.model.body_numbers
    parts = ((n, number, part) for n, number in numbers.items() for _, part in gauss_bricks(result, n, rules[n]))
    with opened(path, gauss_columns(rules)) as put:
        put("samples", 0, np.array([max(along.counts.max() for each in rules.values() for along in each)]))
        fill(put, FIELDS, parts, "body")


def gauss_columns(rules: Mapping[str, Rules]) -> tuple[Column, ...]:
    """Lay out the file, for the rules of all patches."""
    count = sum(prod(len(along.points) for along in each) for each in rules.values())
    return lay_out(count, count, 1, FIELDS, "body")
