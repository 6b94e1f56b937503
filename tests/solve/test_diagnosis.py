import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import geom2iga
import solve
from solve import Status
from solve.analysis import _assemble
from solve.case import SolveCase
from solve.diagnosis import Diagnosis, _heading, _motions, diagnose
from solve.linear import SuperLU
from solve.newton import Solution
from solve.problem import prepare
from solve.rigid import find_pieces, rigid_modes
from tests.solve.failing import STOPPED, two_blocks
from tests.strategies import SEEDS


@pytest.fixture(scope="module")
def problem():
    tables = two_blocks()
    return prepare(geom2iga.build(tables), SolveCase.model_validate({"solve": tables["solve"]}).solve)


@pytest.fixture(scope="module")
def system(problem):
    return _assemble(problem, SuperLU()).loaded


def stopped(system, status, **known):
    """An iteration that ended undeformed, in balance but for what is said."""
    values = {"free": np.zeros(len(system.load)), "inner": system.load, "pressure": np.zeros(len(system.area))}
    rest = {"history": (), "scale": 1.0, "recent": (), "drift": None}
    return Solution(status, **{**values, **rest, **known})


def test_the_gaps_that_change_most_often_are_counted_and_placed(problem, system):
    recent = np.zeros((6, len(system.area)), dtype=bool)
    recent[::2, 5] = True  # five changes
    recent[3:, 2] = True  # one
    found = diagnose(problem, system, stopped(system, Status.UNSETTLED, recent=tuple(recent)), 1)
    often, seldom = (", ".join(f"{x:.4g}" for x in problem.mortar.centres[gap]) for gap in (5, 2))
    line = found.seen[0]
    assert line.startswith(f'contact of "upper/bottom" with "lower/top": 2 of {len(system.area)} gaps')
    assert line.endswith(f"in the last 5 steps, most often near ({often}) and ({seldom})")


def test_gaps_that_stay_are_not_spoken_of(problem, system):
    recent = (np.ones(len(system.area), dtype=bool),) * 4
    seen = diagnose(problem, system, stopped(system, Status.UNSETTLED, recent=recent), 1).seen
    assert not [line for line in seen if "opened or closed" in line]


@given(SEEDS)
def test_the_largest_force_out_of_balance_is_found_where_it_acts(problem, system, seed):
    space, allowed = problem.space, problem.allowed.matrix
    unknown = int(np.random.default_rng(seed).integers(len(system.load)))
    point, axis = divmod(int(np.argmax(np.abs(allowed[:, [unknown]].toarray()))), 3)
    off = np.zeros(len(system.load))
    off[unknown] = 0.25
    found = diagnose(problem, system, stopped(system, Status.INACCURATE, inner=system.load - off), 1)
    (line,) = (line for line in found.seen if "out of balance" in line)
    place = ", ".join(f"{x:.4g}" for x in space.control_points[point])
    body = "upper" if point in space.body_numbers("upper") else "lower"
    assert f'0.25 along {"xyz"[axis]} in body "{body}" near ({place})' in line
    for group in ("upper/bottom", "lower/top", "upper/top"):
        assert (f'"{group}"' in line) == (point in space.group_numbers(group))


@given(SEEDS)
def test_slides_and_turns_of_rigid_motions_are_found_again(problem, seed):
    pieces = find_pieces(problem.space)
    parts = np.random.default_rng(seed).normal(size=(6 * len(pieces.names), 2))
    modes = rigid_modes(pieces, np.arange(problem.space.size)).reshape(problem.space.dofs, -1)
    found = _motions(pieces, modes @ parts)
    np.testing.assert_allclose(found.reshape(parts.shape), parts, rtol=0, atol=1e-12 * np.abs(parts).max())


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        ([0, 0, 1, 0, 0, 0], "it moves along +z"),
        ([-2, 0, 0, 0, 0, 0], "it moves along -x"),
        ([0, 0, 0, 0, -1, 0], "it turns about -y"),
        ([0, 3, 4, 0, 0, 1], "it moves along (0, 0.6, 0.8) and turns about +z"),
    ],
)
def test_the_body_that_is_pulled_off_and_its_motion_are_named(problem, system, motion, words):
    pieces = find_pieces(problem.space)
    shares = np.zeros(12)
    shares[6 * pieces.names.index('body "upper"') :][:6] = motion
    drift = rigid_modes(pieces, np.arange(problem.space.size)).reshape(problem.space.dofs, -1) @ shares
    free = problem._replace(allowed=problem.allowed.__class__(np.eye(len(drift)), np.zeros(len(drift))))
    found = diagnose(free, system, stopped(system, Status.UNBOUNDED, drift=drift), 1)
    assert [line.partition(", and")[0] for line in found.seen] == [f'body "upper" is pulled off: {words}']


@given(st.integers(0, 2), st.sampled_from([-1, 1]), st.floats(1e-12, 1e12))
def test_a_direction_along_an_axis_is_named_with_its_sign(axis, sign, length):
    vector = np.zeros(3)
    vector[axis] = sign * length
    assert _heading(vector) == f"{'-' if sign < 0 else '+'}{'xyz'[axis]}"


def test_the_contact_that_fails_is_told_from_one_that_holds():
    tables = two_blocks()
    third = {"name": "third", "origin": [3.0, 0.0, 1.0], "size": [1.0, 1.0, 1.0]}
    ground = {"name": "ground", "origin": [3.0, 0.0, 0.0], "size": [1.0, 1.0, 1.0]}
    tables["geometry"]["block"] += [third, ground]
    held = [{"on": name, "ux": 0.0, "uy": 0.0, "uz": 0.0} for name in ("third/top", "ground/bottom")]
    tables["solve"]["support"] += held
    low = {"enforcement": "augmented-lagrange", "penalty": 1.0}
    easy = {"secondary": "third/bottom", "primary": "ground/top", **low}
    hard = {"secondary": "upper/bottom", "primary": "lower/top", **low}
    tables["solve"] |= {"contact": [easy, hard], "augmentation": {"max_steps": 1}}
    result = solve.solve(geom2iga.build(tables), tables)
    assert result.status is Status.PENETRATION
    lines = (*result.diagnosis.seen, *result.diagnosis.advice[:2])
    assert all('"upper/bottom" with "lower/top"' in line for line in lines)


def test_a_diagnosis_reads_as_lines():
    found = Diagnosis(2, 3, ("it is so",), ("this", "that"))
    assert str(found).splitlines() == ["load step 2 of 3 did not converge", "it is so", "try 1: this", "try 2: that"]
    assert found.shown == "NOT CONVERGED: shows load step 1 of 3"


def test_a_failure_comes_back_from_its_file_exactly(tmp_path):
    result = solve.solve(geom2iga.build(STOPPED), STOPPED)
    solve.write_result(tmp_path / "steps.h5", result)
    again = solve.read_result(tmp_path / "steps.h5")
    assert again.diagnosis == result.diagnosis
    assert again.diagnosis.seen
    assert again.history == result.history
    assert len(again.states) == 2
