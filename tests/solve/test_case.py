"""Every wrong input is one CaseError that names the key."""

import copy

import numpy as np
import pytest

import geom2iga
import solve
from geom2iga.errors import CaseError
from tests.cases import patch_test_case

MODEL = geom2iga.build(patch_test_case(lower_spans=(2, 2, 1), upper_spans=(2, 2, 1)))
NAN, INFINITY = float("nan"), float("inf")


def changed(**tables):
    """The [solve] table of the patch test with some tables replaced."""
    case = copy.deepcopy(patch_test_case())
    case["solve"].update(tables)
    return case


def complaint(case):
    with pytest.raises(CaseError) as error:
        solve.solve(MODEL, case)
    message = str(error.value)
    assert "\n" not in message
    return message


def material(**values):
    return changed(material=[{"young": 1000.0, "poisson": 0.3, **values}])


def contact(**values):
    return changed(contact=[{"secondary": "upper/bottom", "primary": "lower/top", **values}])


def support(**values):
    return changed(support=[{"on": "lower/bottom", "uz": 0.0}, values])


def load(**values):
    return changed(load=[{"on": "upper/top", "pressure": 1.0}, values])


def assert_names(message, *parts):
    missing = [part for part in parts if part not in message]
    assert not missing, f"{missing} not in: {message}"


@pytest.mark.parametrize("young", [0.0, -1.0, NAN, INFINITY, "steel", True, [1.0]])
def test_a_modulus_that_is_no_positive_number(young):
    assert_names(complaint(material(young=young)), "solve.material[0].young")


@pytest.mark.parametrize("poisson", [0.5, -1.0, 0.7, NAN, "0.3", None])
def test_a_poisson_ratio_out_of_range(poisson):
    assert_names(complaint(material(poisson=poisson)), "solve.material[0].poisson")


@pytest.mark.parametrize("penalty", [0, -1e5, NAN, INFINITY, "x", "1e5", True, None])
def test_a_penalty_that_is_neither_a_positive_number_nor_auto(penalty):
    assert_names(complaint(contact(penalty=penalty)), "solve.contact[0].penalty", '"auto"', str(penalty))


@pytest.mark.parametrize(
    ("key", "value", "allowed"),
    [
        ("method", "nitsche", "mortar"),
        ("enforcement", "glue", "penalty"),
        ("integration", "exact", "segment"),
        ("points", 0, "1"),
        ("points", 2.5, "integer"),
    ],
)
def test_a_contact_option_that_does_not_exist(key, value, allowed):
    assert_names(complaint(contact(**{key: value})), f"solve.contact[0].{key}", str(value), allowed)


@pytest.mark.parametrize("value", [NAN, INFINITY, "0", True])
@pytest.mark.parametrize("key", ["ux", "uy", "uz", "normal"])
def test_a_prescribed_displacement_that_is_no_number(key, value):
    assert_names(complaint(support(on="lower/left", **{key: value})), f"solve.support[1].{key}")


def test_a_support_that_prescribes_nothing():
    assert_names(complaint(support(on="lower/left")), "solve.support[1]", "prescribes nothing")


@pytest.mark.parametrize("values", [{}, {"pressure": 1.0, "traction": [0.0, 0, 1]}])
def test_a_load_with_no_or_both_of_pressure_and_traction(values):
    assert_names(complaint(load(on="upper/top", **values)), "solve.load[1]", "either pressure or traction")


@pytest.mark.parametrize(
    ("values", "key"),
    [
        ({"pressure": NAN}, "pressure"),
        ({"traction": [0.0, 0.0]}, "traction"),
        ({"traction": [0.0, 0.0, INFINITY]}, "traction[2]"),
        ({"pressure": 1.0, "exposed": "yes"}, "exposed"),
    ],
)
def test_a_load_that_is_no_number(values, key):
    assert_names(complaint(load(on="upper/top", **values)), f"solve.load[1].{key}")


@pytest.mark.parametrize(
    ("case", "table", "key", "guess"),
    [
        (material(yuong=1.0), "solve.material[0]", "yuong", "young"),
        (support(on="lower/left", norml=0.0), "solve.support[1]", "norml", "normal"),
        (load(on="upper/top", presure=1.0), "solve.load[1]", "presure", "pressure"),
        (contact(penaltee=1.0), "solve.contact[0]", "penaltee", "penalty"),
        (changed(newton={"max_step": 3}), "solve.newton", "max_step", "max_steps"),
        (changed(contacts=[]), "solve", "contacts", "contact"),
    ],
)
def test_an_unknown_key_with_a_guess_at_what_was_meant(case, table, key, guess):
    assert_names(complaint(case), f'"{key}"', f"[{table}]", f'did you mean "{guess}"')


@pytest.mark.parametrize(
    ("case", "key"),
    [
        (support(on="lower/botom", uz=0.0), "solve.support[1]"),
        (load(on="lower/botom", pressure=1.0), "solve.load[1]"),
        (contact(primary="lower/botom"), "solve.contact[0]"),
        (contact(secondary="lower/botom"), "solve.contact[0]"),
    ],
)
def test_an_unknown_face_with_a_guess_at_what_was_meant(case, key):
    assert_names(complaint(case), key, '"lower/botom"', 'did you mean "lower/bottom"')


@pytest.mark.parametrize(
    ("sides", "names"),
    [
        (("lower/top", "lower/top"), ['"lower"', "two bodies"]),
        (("lower/left", "lower/right"), ['"lower"', "two bodies"]),
        (("upper/top", "lower/top"), ['"upper/top"', '"lower/top"', "look at each other"]),
        (("upper/left", "lower/top"), ["look at each other"]),
    ],
)
def test_faces_that_cannot_touch(sides, names):
    case = contact(secondary=sides[0], primary=sides[1])
    assert_names(complaint(case), "solve.contact[0]", *names)


def test_no_material_at_all():
    assert_names(complaint(changed(material=[])), "solve.material")
    without = patch_test_case()
    del without["solve"]["material"]
    assert_names(complaint(without), "solve.material", "missing")


def test_a_body_with_no_material_with_two_or_of_an_unknown_name():
    steel = {"young": 1.0, "poisson": 0.3}
    assert_names(complaint(changed(material=[{**steel, "bodies": ["upper"]}])), '"lower"', "material")
    assert_names(complaint(changed(material=[steel, {**steel, "bodies": ["upper"]}])), "solve.material[1]", '"upper"')
    assert_names(
        complaint(changed(material=[{**steel, "bodies": ["uper"]}])), "solve.material[0].bodies", '"uper"', '"upper"'
    )


@pytest.mark.parametrize(
    ("entry", "names"),
    [
        ({"force": [0.0, 0.0]}, ["solve.body_force[0].force"]),
        ({"force": [0.0, 0.0, NAN]}, ["solve.body_force[0].force[2]"]),
        ({"force": [0.0, 0.0, 1.0], "bodies": ["uper"]}, ["solve.body_force[0].bodies", '"uper"', '"upper"']),
        ({"bodies": ["upper"]}, ["solve.body_force[0].force", "missing"]),
    ],
)
def test_a_wrong_body_force(entry, names):
    assert_names(complaint(changed(body_force=[entry])), *names)


@pytest.mark.parametrize(("key", "value"), [("max_steps", 0), ("tolerance", 0.0), ("tolerance", -1.0)])
def test_newton_settings_out_of_range(key, value):
    assert_names(complaint(changed(newton={key: value})), f"solve.newton.{key}")


def test_a_missing_solve_table():
    assert_names(complaint({"geometry": {}}), "solve is missing")


@pytest.mark.parametrize("penalty", ["auto", 1, 1e5])
def test_what_is_allowed_is_accepted(penalty):
    case = contact(penalty=penalty, method="mortar", enforcement="penalty", integration="element", points=3)
    assert solve.solve(MODEL, case).status is solve.Status.CONVERGED


@pytest.mark.parametrize(
    ("values", "names"),
    [
        *(
            ({"enforcement": way, **given}, [named, 'use enforcement = "penalty"'])
            for way in ("lagrange", "augmented-lagrange")
            for given, named in (({"method": "kts"}, '"kts"'), ({"two_pass": True}, "two_pass"))
        ),
        ({"enforcement": "lagrange", "penalty": 1e5}, ['"lagrange"', "penalty", "leave it out"]),
        ({"method": "kts", "multiplier": "p-2"}, ['"kts"', "leave multiplier out"]),
        ({"points": 65}, ["points", "64"]),
    ],
)
def test_contact_options_that_exclude_each_other(values, names):
    assert_names(complaint(contact(**values)), "solve.contact[0]", *names)


@pytest.mark.parametrize("enforcement", ["penalty", "augmented-lagrange", "lagrange"])
@pytest.mark.parametrize("multiplier", ["p", "p-2"])
def test_every_enforcement_takes_every_multiplier(enforcement, multiplier):
    values = {"enforcement": enforcement, "multiplier": multiplier}
    checked = solve.SolveCase(solve=contact(**values)["solve"])
    assert checked.solve.contact[0].enforcement == enforcement


@pytest.mark.parametrize("method", ["mortar", "kts"])
@pytest.mark.parametrize("two_pass", [False, True])
def test_penalties_go_with_every_method_and_with_one_or_two_passes(method, two_pass):
    values = {"method": method, "two_pass": two_pass}
    checked = solve.SolveCase(solve=contact(**values)["solve"])
    assert checked.solve.contact[0].two_pass is two_pass


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("reach", value) for value in (0, -1.0, NAN, INFINITY, "far", True)),
        *(("two_pass", value) for value in ("yes", 1, None)),
        *(("multiplier", value) for value in ("p-1", 2, True)),
        *(("points", value) for value in (-1, "3", True)),
    ],
)
def test_a_contact_value_of_the_wrong_kind(key, value):
    assert_names(complaint(contact(**{key: value})), f"solve.contact[0].{key}", str(value))


@pytest.mark.parametrize("steps", [{}, {"count": 2, "factors": [0.5, 1.0]}])
def test_load_steps_with_neither_or_both_of_count_and_factors(steps):
    assert_names(complaint(changed(steps=steps)), "solve.steps", "either count or factors")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("count", value) for value in (0, -1, 10001, 2.0, "2", True)),
        *(("factors", value) for value in ([], [NAN], [INFINITY], ["1"], [True], 1.0)),
    ],
)
def test_load_steps_out_of_range(key, value):
    assert_names(complaint(changed(steps={key: value})), f"solve.steps.{key}")


@pytest.mark.parametrize(
    ("steps", "shares"),
    [({"count": 1}, (1.0,)), ({"count": 4}, (0.25, 0.5, 0.75, 1.0)), ({"factors": [1.0, -0.5, 0]}, (1.0, -0.5, 0.0))],
)
def test_load_steps_are_equal_shares_or_those_that_are_given(steps, shares):
    assert solve.case.Steps(**steps).shares == shares
    assert solve.case.Steps(**steps).several == (len(shares) > 1)


@pytest.mark.parametrize(("key", "value"), [("max_steps", 0), ("tolerance", 0.0), ("tolerance", "small")])
def test_settings_of_the_updates_out_of_range(key, value):
    assert_names(complaint(changed(augmentation={key: value})), f"solve.augmentation.{key}")


def test_the_same_contact_twice():
    same = {"secondary": "upper/bottom", "primary": "lower/top"}
    assert_names(complaint(changed(contact=[same, same])), '"upper/bottom"', '"lower/top"', "stands twice")


def test_the_case_a_result_was_made_from_is_left_as_it_was():
    case = patch_test_case()
    before = copy.deepcopy(case)
    solve.solve(MODEL, case)
    assert case == before


def test_a_checked_case_solves_as_the_dict_it_was_made_of():
    case = patch_test_case()
    results = [solve.solve(MODEL, source) for source in (case, solve.SolveCase(solve=case["solve"]))]
    np.testing.assert_array_equal(*[result.state.displacement for result in results])


def test_a_misspelt_key_is_named_before_the_key_that_is_missing_for_it():
    assert_names(complaint(changed(material=[{"yuong": 1000.0, "poisson": 0.3}])), '"yuong"', 'did you mean "young"')


def test_a_multiplier_cannot_be_asked_for_from_both_sides():
    pair = {"secondary": "upper/bottom", "primary": "lower/top", "enforcement": "lagrange"}
    back = {"secondary": "lower/top", "primary": "upper/bottom"}
    assert_names(complaint(changed(contact=[pair, back])), "the other way round", 'use enforcement = "penalty"')


@pytest.mark.parametrize("table", ["newton", "augmentation"])
def test_a_tolerance_that_accepts_anything_is_refused(table):
    assert_names(complaint(changed(**{table: {"tolerance": 1.0}})), f"{table}.tolerance")
