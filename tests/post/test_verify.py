from dataclasses import replace

import numpy as np
import pytest

import geom2iga
import solve
from geom2iga import CaseError
from post import export, fields, verify
from post.exact import StackedBlocks
from post.fields import sample_contact


def entry(**values):
    return {"verify": [{"tolerance": 1e-10, **values}]}


@pytest.mark.parametrize(
    ("quantity", "on", "value"),
    [
        ("stress", None, [0.0, 0.0, -1.0, 0.0, 0.0, 0.0]),
        ("stress_zz", "lower", -1.0),
        ("stress_xy", "upper/top", 0.0),
        ("von_mises", "upper", 1.0),
        ("pressure", None, 1.0),
        ("pressure_max", None, 1.0),
        ("gap", None, -1e-5),
        ("penetration", None, 1e-5),
        ("contact_area", None, 1.0),
        ("contact_force", "upper/bottom", [0.0, 0.0, 1.0]),
        ("contact_moment", None, [1.0, -1.0, 0.0]),  # the force acts at (1, 1)
    ],
)
def test_the_patch_test_shows_every_quantity_of_the_exact_solution(patch_test, quantity, on, value):
    given = {"quantity": quantity, "value": value} | ({} if on is None else {"on": on})
    (check,) = verify(patch_test, entry(**given))
    assert check.passed
    assert check.difference <= 1e-10


@pytest.mark.parametrize("height", [0, 1, 2])
def test_the_blocks_settle_by_hooke_and_by_the_overlap(patch_test, height):
    exact = StackedBlocks(1.0, 1000.0, (1.0, 1.0), 1e5).settlement[height]
    on = ("lower/top", "upper/bottom", "upper/top")[height]
    (check,) = verify(patch_test, entry(quantity="uz", on=on, value=exact, tolerance=1e-12))
    assert check.passed


def test_of_two_passes_the_first_has_the_whole_force_and_pressure(case, tmp_path):
    twice = case.changed({"solve.contact.0.two_pass": True})
    result = solve.solve(geom2iga.build(twice), twice)
    for quantity, value in (("contact_force", [0.0, 0.0, 1.0]), ("pressure", 1.0), ("pressure_max", 1.0)):
        (check,) = verify(result, entry(quantity=quantity, value=value))
        assert check.passed
    assert len(export(result, {"post": {"pictures": False}}, tmp_path)["contact"]) == 1


def test_a_result_that_has_not_converged_has_nothing_to_verify(bent_case):
    soft = {"solve.contact.0.penalty": 1.0, "solve.contact.0.enforcement": "augmented-lagrange"}
    stopped = bent_case.changed({**soft, "solve.augmentation": {"max_steps": 1}})
    result = solve.solve(geom2iga.build(stopped), stopped)
    assert result.status is solve.Status.PENETRATION
    with pytest.raises(CaseError, match="raise the penalty"):
        verify(result, stopped)


def test_pressure_without_a_contact_is_named(patch_test):
    bare = replace(patch_test.state, contacts=())
    with pytest.raises(CaseError, match="needs a contact"):
        verify(replace(patch_test, states=(bare,)), entry(quantity="pressure", value=1.0))


@pytest.mark.parametrize("samples", [1, 0, -4, 65, 2.5, True])
def test_samples_that_give_no_cells_are_refused(patch_test, samples):
    with pytest.raises(CaseError, match=r"post\.samples"):
        verify(patch_test, {"post": {"samples": samples}})


def test_a_wrong_answer_is_missed_and_the_worst_value_shown(patch_test):
    (check,) = verify(patch_test, entry(quantity="stress_zz", value=-1.1))
    assert not check.passed
    assert check.found == pytest.approx(-1.0)
    assert check.difference == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"quantity": "stress_zz", "value": -1.0, "on": "uper"}, 'did you mean "upper"'),
        ({"quantity": "pressure", "value": 1.0, "on": "lower/top"}, "upper/bottom"),
        ({"quantity": "stress", "value": -1.0}, "6 components"),
        ({"quantity": "stres", "value": -1.0}, r"verify\[0\].quantity"),
        ({"quantity": "uz", "value": float("nan")}, r"verify\[0\].value"),
        ({"quantity": "uz", "value": 0.0, "tolerance": -1.0}, r"verify\[0\].tolerance"),
    ],
)
def test_a_wrong_entry_is_named(patch_test, given, named):
    with pytest.raises(CaseError, match=named):
        verify(patch_test, entry(**given))


def test_a_gap_without_opposite_sides_is_named(patch_test, monkeypatch):
    def nowhere(*arguments):
        return tuple(replace(part, gap=np.full(len(part.gap), np.nan)) for part in sample_contact(*arguments))

    monkeypatch.setattr(fields, "sample_contact", nowhere)
    with pytest.raises(CaseError, match=r"verify\[0\].* opposite at no sample point"):
        verify(patch_test, entry(quantity="gap", value=0.0))
