import dataclasses
import shutil
from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import geom2iga
import solve
from geom2iga.errors import CaseError
from solve.files import FORMAT, read_result, write_result
from tests.cases import patch_test_case
from tests.sealed import altered, reseal


@pytest.fixture(scope="module")
def result():
    case = patch_test_case(degree=2, lower_spans=(2, 2, 1), upper_spans=(3, 2, 1), angle=20.0)
    return solve.solve(geom2iga.build(case), case)


@pytest.fixture(scope="module")
def written(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("written") / "solution.h5"
    write_result(path, result, "stamp")
    return path


def assert_same(one, other):
    """Two records agree to the last bit, through all that they hold."""
    assert type(one) is type(other)
    if dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            assert_same(getattr(one, field.name), getattr(other, field.name))
    elif isinstance(one, Mapping):
        assert list(one) == list(other)
        for key in one:
            assert_same(one[key], other[key])
    elif isinstance(one, tuple | list):
        assert len(one) == len(other)
        for part, twin in zip(one, other, strict=True):
            assert_same(part, twin)
    elif isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    else:
        assert one == other


def test_a_result_comes_back_exactly(result, written):
    assert_same(read_result(written), result)


def test_what_is_derived_from_a_result_survives_too(result, written):
    again = read_result(written)
    for name in result.model.patches:
        np.testing.assert_array_equal(again.displacement_of(name), result.displacement_of(name))
    for one, other in zip(again.contacts, result.contacts, strict=True):
        (face,) = result.model.faces("upper/bottom")
        xi = np.random.default_rng(0).random((20, 2))
        np.testing.assert_array_equal(again.pressure_at(one, face, xi), result.pressure_at(other, face, xi))
        assert one.area == other.area
    assert repr(again) == repr(result)


def test_a_result_without_a_state_comes_back_too(result, tmp_path):
    failed = dataclasses.replace(result, status=solve.Status.MAX_STEPS, states=(), history=())
    write_result(tmp_path / "solution.h5", failed)
    assert_same(read_result(tmp_path / "solution.h5"), failed)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(CaseError, match=r"nowhere\.h5"):
        read_result(tmp_path / "nowhere.h5")


@given(share=st.floats(0, 0.99))
def test_a_file_that_was_cut_off_is_refused(written, tmp_path_factory, share):
    path = tmp_path_factory.mktemp("cut") / "solution.h5"
    whole = written.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(CaseError, match=r"solution\.h5"):
        read_result(path)


@pytest.mark.parametrize("content", [b"", b"not HDF5", b"\x89HDF\r\n\x1a\n" + bytes(200)])
def test_a_file_of_another_kind_is_refused(tmp_path, content):
    path = tmp_path / "solution.h5"
    path.write_bytes(content)
    with pytest.raises(CaseError, match=r"solution\.h5: .*; make it anew"):
        read_result(path)


@pytest.mark.parametrize("change", [{"form": "geom2iga geometry"}, {"later": 1}, {"later": -1}])
def test_a_file_of_another_format_or_version_is_refused(written, tmp_path, change):
    path = Path(shutil.copy(written, tmp_path))
    reseal(path, **change)
    with pytest.raises(CaseError, match=f'expected "{FORMAT}"'):
        read_result(path)


def test_a_geometry_is_no_solution(result, tmp_path):
    geom2iga.write_model(tmp_path / "solution.h5", result.model)
    with pytest.raises(CaseError, match='expected "geom2iga solution", found "geom2iga geometry"'):
        read_result(tmp_path / "solution.h5")


def test_a_solution_of_another_case_is_told_by_its_stamp(result, written):
    assert_same(read_result(written, "stamp"), result)
    with pytest.raises(CaseError, match="made from another case"):
        read_result(written, "other")


NUMBERS = ("displacement", "load_factor", "contacts/0/control_gap", "contacts/0/pressure", "contacts/0/penalty")


@pytest.mark.parametrize("name", [*NUMBERS, "contacts/0/centres", "contacts/0/force", "reactions/moment"])
def test_a_state_that_is_no_number_is_refused(written, tmp_path, name):
    path = Path(shutil.copy(written, tmp_path))
    with altered(path) as file:
        values = np.array(file[f"states/0/{name}"])
        values.flat[-1] = np.nan
        file[f"states/0/{name}"][...] = values
    with pytest.raises(CaseError, match=f"damaged .*{name.split('/')[-1]} has entries that are no finite numbers"):
        read_result(path)


@pytest.mark.parametrize("name", ["displacement", "contacts/0/pressure", "contacts/0/active", "contacts/0/centres"])
def test_a_state_of_another_model_is_refused(written, tmp_path, name):
    path = Path(shutil.copy(written, tmp_path))
    with altered(path) as file:
        values = np.array(file[f"states/0/{name}"])
        del file[f"states/0/{name}"]
        file[f"states/0/{name}"] = values[:-1]
    with pytest.raises(CaseError, match="has the shape"):
        read_result(path)


def contents(path):
    """Names of everything in a file but the model: objects, and attributes as object@attribute."""
    with h5py.File(path) as file:
        names = [f"@{attribute}" for attribute in file.attrs]
        file.visititems(lambda name, entry: names.extend([name, *(f"{name}@{key}" for key in entry.attrs)]))
    return [name for name in names if not name.startswith("model/")]


def test_whatever_is_missing_inside_is_a_damage_and_no_crash(written, tmp_path):
    optional = {"@format", "@version", "states", "states/0", "states/0/contacts", "states/0/contacts/0"}
    for name in contents(written):
        path = Path(shutil.copy(written, tmp_path))
        with altered(path) as file:
            entry, _, attribute = name.partition("@")
            if attribute:
                del file[entry or "/"].attrs[attribute]
            else:
                del file[entry]
        if name not in optional:
            with pytest.raises(CaseError, match=r"solution\.h5"):
                read_result(path)


@pytest.mark.parametrize(
    ("attribute", "value"),
    [("status", "SPLENDID"), ("statistics", "{"), ("materials", "[1]"), ("history", '[{"number": 1}]')],
)
def test_an_attribute_that_makes_no_sense_is_a_damage_and_no_crash(written, tmp_path, attribute, value):
    path = Path(shutil.copy(written, tmp_path))
    with altered(path) as file:
        file.attrs[attribute] = value
    with pytest.raises(CaseError, match=r"solution\.h5: damaged \("):
        read_result(path)


def test_a_write_that_fails_leaves_the_old_file_and_no_other(result, written, tmp_path):
    path = shutil.copy(written, tmp_path)
    broken = dataclasses.replace(result, statistics={"what": object()})
    with pytest.raises(TypeError):
        write_result(path, broken)
    assert [entry.name for entry in tmp_path.iterdir()] == ["solution.h5"]
    assert_same(read_result(path), result)
