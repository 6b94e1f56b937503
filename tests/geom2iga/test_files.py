import os
import tracemalloc
from dataclasses import replace
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geom2iga import build, files
from geom2iga.errors import CaseError
from geom2iga.files import FORMAT, VERSION, created, put_model, read_model, read_stamp, replacing, write_model
from geom2iga.model import Glued, Model
from geom2iga.patch import Face
from geom2iga.quality.certificate import Certificate
from geom2iga.quality.jacobian import Jacobian
from geom2iga.seal import SIZE
from tests.cases import bent_patch, block_patch, model_of
from tests.oracles import assert_round_trip, assert_same_model
from tests.sealed import altered, reseal
from tests.strategies import patches

MODEL = model_of(block_patch("lower"))

NAMES = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=8) | st.sampled_from(
    ["Stößel", "上部/底", "a", "a/weights", "a/", "/a", ".", "..", "0", "patches", "name"]
)


@st.composite
def models(draw: Any) -> Model:
    """Models whose names, degrees, knots and coordinates are as awkward as may be."""
    names = draw(st.lists(NAMES, unique=True, min_size=1, max_size=3))
    volumes = {name: replace(draw(patches((3,), highest=2)), name=name) for name in names}
    points = draw(st.sampled_from(list(volumes.values()))).control_points.copy()
    points.flat[:5] = [-0.0, 5e-324, 1.7976931348623157e308, 0.1 + 0.2, -1e-300]
    volumes |= {name: replace(v, control_points=points) for name, v in volumes.items() if v.shape == points.shape[:3]}
    bodies = draw(st.lists(NAMES, unique=True, min_size=2, max_size=3))
    holder = [draw(st.sampled_from(bodies)) for _ in names]
    faces = st.builds(Face, st.sampled_from(names), st.integers(0, 2), st.integers(0, 1))
    groups = draw(st.dictionaries(NAMES, st.lists(faces, max_size=3, unique=True).map(tuple), max_size=4))
    return Model(
        volumes,
        {body: tuple(n for n, b in zip(names, holder, strict=True) if b == body) for body in bodies},
        groups,
    )


@st.composite
def certificates(draw: Any) -> Certificate:
    """Certificates of any numbers, some of them unknown."""
    numbers = st.floats(allow_nan=False) | st.sampled_from([-0.0, 5e-324, 0.1 + 0.2])
    places, unknown = st.tuples(numbers, numbers, numbers), st.none() | numbers
    status = draw(st.sampled_from(["proven", "not proven", "folded", "left-handed", "degenerate"]))
    jacobian = Jacobian(status, draw(numbers), draw(places), draw(places), draw(unknown), draw(numbers))
    way = draw(st.sampled_from(["exact", "fitted", "given"]))
    return Certificate(way, draw(unknown), jacobian, draw(numbers), draw(numbers))


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("files") / "geometry.h5"


@pytest.fixture
def whole(tmp_path):
    """A sound file."""
    path = tmp_path / "geometry.h5"
    write_model(path, model_of(block_patch("lower"), bent_patch(1, name="upper")), "stamp")
    return path


@given(models())
def test_a_model_comes_back_from_its_file_bit_for_bit(path, model):
    assert_round_trip(lambda m: write_model(path, m), lambda _: read_model(path), model, assert_same_model)


def test_glued_faces_come_back(path):
    patches = {p.name: p for p in (block_patch("lower"), block_patch("upper", origin=(0, 0, 1)))}
    glued = (Glued(Face("lower", 2, 1), Face("upper", 2, 0), 0),)
    write_model(path, model := Model(patches, {"both": ("lower", "upper")}, {}, glued))
    assert_same_model(read_model(path), model)


@given(models(), st.data())
def test_the_certificates_come_back_bit_for_bit(path, model, data):
    certified = data.draw(st.lists(st.sampled_from(list(model.patches)), unique=True))
    expected = {name: data.draw(certificates()) for name in certified}
    write_model(path, replace(model, certificates=expected))
    found = read_model(path).certificates
    assert set(found) == set(expected)
    for name in certified:
        assert repr(found[name]) == repr(expected[name])  # types, signs of zeros and all digits, too


def test_the_certificates_of_a_model_as_it_is_built_come_back(path):
    pipe = {"name": "pipe", "inner": 1.0, "outer": 2.0, "height": 1.0}
    model = build({"geometry": {"pipe": [pipe], "block": [{"name": "block", "size": [1, 2, 3]}]}})
    write_model(path, model)
    found = read_model(path)
    assert_same_model(found, model)
    assert list(found.certificates) == list(model.patches)
    for name, certificate in model.certificates.items():
        assert found.certificates[name] == certificate
        assert repr(found.certificates[name].data) == repr(certificate.data)


def test_a_model_without_certificates_has_none_when_it_comes_back(path):
    write_model(path, model_of(block_patch()))
    assert dict(read_model(path).certificates) == {}


def test_a_model_of_very_many_names_comes_back(path):
    """A list of more than 4095 names is too long for an attribute of HDF5."""
    model = Model({"block": block_patch()}, {"block": ("block",)}, {f"group {n}": () for n in range(4100)})
    assert_round_trip(lambda m: write_model(path, m), lambda _: read_model(path), model, assert_same_model)


def test_an_empty_model_comes_back(path):
    assert_round_trip(lambda m: write_model(path, m), lambda _: read_model(path), Model({}, {}, {}), assert_same_model)


@given(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0")))
def test_the_stamp_comes_back(path, stamp):
    write_model(path, Model({}, {}, {}), stamp)
    assert read_stamp(path, FORMAT, VERSION) == stamp


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(CaseError, match=r"nowhere\.h5.*no such file"):
        read_model(tmp_path / "nowhere.h5")
    assert read_stamp(tmp_path / "nowhere.h5", FORMAT, VERSION) is None


def refused(path):
    """Insist that a file is refused by name with the advice to make it anew, and that it has no stamp."""
    with pytest.raises(CaseError, match=f"(?s){path.name}.*anew"):
        read_model(path)
    return read_stamp(path, FORMAT, VERSION) is None


def foreign(path):
    """Insist that a file that we never wrote is not made anew in its place either."""
    with pytest.raises(CaseError, match=f"{path.name}.*; make it anew"):
        read_model(path)
    with pytest.raises(CaseError, match=f"{path.name}: not written by this program, .*; move it away"):
        read_stamp(path, FORMAT, VERSION)
    return path.exists()


def test_a_file_cut_off_anywhere_is_refused(whole):
    content = whole.read_bytes()
    for length in [*range(0, len(content), len(content) // 50), len(content) - 1]:
        whole.write_bytes(content[:length])
        assert refused(whole)


@pytest.mark.parametrize("content", [b"hello\n", b"\x89HDF\r\n\x1a\n", bytes(range(256)) * 40])
def test_a_file_of_another_kind_is_refused(tmp_path, content):
    path = tmp_path / "geometry.h5"
    path.write_bytes(content)
    assert foreign(path)


@pytest.mark.parametrize("content", [b"", bytes(10_000)])
def test_a_file_that_holds_nothing_is_refused(tmp_path, content):
    path = tmp_path / "geometry.h5"
    path.write_bytes(content)
    assert refused(path)


def test_a_folder_is_no_file_and_none_can_be_made_in_its_place(tmp_path):
    for use in (read_model, lambda path: read_stamp(path, FORMAT, VERSION), lambda path: write_model(path, MODEL)):
        with pytest.raises(CaseError, match=f"{tmp_path.name}: a folder, expected a file; move it away"):
            use(tmp_path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda path: reseal(path, -1), f"written by an older version: .* {VERSION}, found version {VERSION - 1}"),
        (lambda path: reseal(path, 1), f"written by a newer version: .* {VERSION}, found version {VERSION + 1}"),
        (lambda path: reseal(path, form="geom2iga solution"), 'expected "geom2iga geometry", found "geom2iga sol'),
        (lambda path: path.write_bytes(path.read_bytes()[SIZE:]), "written by an older version or by another program"),
        (lambda path: path.write_bytes(path.read_bytes()[:-1]), "damaged"),
        (lambda path: path.write_bytes(path.read_bytes() + b"\0"), "damaged"),
        (lambda path: path.write_bytes(b""), "empty"),
        (lambda path: path.write_bytes(b"\0" * 10_000), 'no "geom2iga geometry" file, or damaged at its beginning'),
        (lambda path: path.write_bytes(b"geom2iga cube\n"), 'no "geom2iga geometry" file, or damaged at its beginning'),
    ],
)
def test_what_became_of_a_file_is_said(whole, change, said):
    change(whole)
    assert refused(whole)
    with pytest.raises(CaseError, match=f"^{whole}: {said}[^\n]*; make it anew$"):
        read_model(whole)


def test_a_file_of_the_layout_before_is_refused(tmp_path):
    """It had no first block, and its format and version among the attributes alone."""
    path = tmp_path / "geometry.h5"
    with h5py.File(path, "w") as file:
        file.attrs.update({"format": FORMAT, "version": 2, "stamp": "stamp"})
        put_model(file, MODEL)
    assert refused(path)
    with pytest.raises(CaseError, match="older version"):
        read_model(path)


def test_a_file_with_any_bit_changed_is_refused(whole):
    content = whole.read_bytes()
    random = np.random.default_rng(0)
    for place in [*range(0, SIZE, 3), *random.integers(len(content), size=100)]:
        flipped = bytearray(content)
        flipped[place] ^= 1 << int(random.integers(8))
        whole.write_bytes(flipped)
        assert read_stamp(whole, FORMAT, VERSION) is None, place


@pytest.mark.parametrize("target", ["geometry.h5", "nowhere", "/dev/null"])
def test_a_link_that_leads_to_no_file_is_refused_and_replaced(whole, target):
    whole.unlink()
    whole.symlink_to(target)
    assert read_stamp(whole, FORMAT, VERSION) is None
    with pytest.raises(CaseError, match=whole.name):
        read_model(whole)
    write_model(whole, MODEL)
    assert_same_model(read_model(whole), MODEL)
    assert not whole.is_symlink()


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(path := tmp_path / "geometry.h5")
    with pytest.raises(CaseError, match=r"geometry\.h5: a pipe or device"):
        read_model(path)


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser reads everything")
def test_a_file_that_must_not_be_read_is_said_to_be_one(whole):
    whole.chmod(0)
    with pytest.raises(CaseError, match=r"cannot be read \(permission denied\)"):
        read_model(whole)


def test_a_file_of_another_case_is_told_by_its_stamp(whole):
    assert read_model(whole, "stamp").bodies
    with pytest.raises(CaseError, match=r"made from another case, .*; run geom2iga again$"):
        read_model(whole, "another", "run geom2iga again")


def test_what_is_not_believed_is_said(whole, caplog):
    assert read_stamp(whole.with_name("nowhere.h5"), FORMAT, VERSION) is None
    assert not caplog.messages
    whole.write_bytes(whole.read_bytes()[:-1])
    assert read_stamp(whole, FORMAT, VERSION) is None
    assert caplog.messages == [f"{whole}: damaged, its bytes are not those that were written; it is not used"]


def test_other_programs_open_the_file_as_any_of_hdf5(whole):
    with h5py.File(whole) as file:
        assert set(file) == {"patches", "bodies", "groups", "glued"}
    assert whole.read_bytes().startswith(f"{FORMAT} version {VERSION}\n".encode())


def test_a_file_is_checked_without_being_held_in_memory(tmp_path):
    path, size = tmp_path / "large.h5", 20_000_000
    with created(path, FORMAT, VERSION, "stamp") as file:
        file["zeros"] = np.zeros(size, dtype=np.uint8)
    tracemalloc.start()
    try:
        assert read_stamp(path, FORMAT, VERSION) == "stamp"
        assert tracemalloc.get_traced_memory()[1] < size / 10
    finally:
        tracemalloc.stop()


def test_somebody_elses_hdf5_file_is_refused(tmp_path):
    path = tmp_path / "other.h5"
    with h5py.File(path, "w") as file:
        file["temperature"] = np.arange(3)
    assert foreign(path)


@pytest.mark.parametrize(
    "part",
    [
        *("patches", "patches/0", "patches/0/degrees", "patches/1/knots_2", "patches/0/weights"),
        *("bodies", "bodies/0/patches", "groups", "groups/3/axis_side", "groups/3/patch"),
    ],
)
def test_a_file_that_lacks_a_part_or_has_nonsense_for_it_is_refused(whole, part):
    with altered(whole) as file:
        del file[part]
    with pytest.raises(CaseError, match=r"damaged \("):
        read_model(whole)
    for nonsense in (np.array([[0.5, -7.0]]), 3, "text", ["text"], np.void(b"\x80\x04N.")):
        with altered(whole) as file:
            if part in file:
                del file[part]
            file[part] = nonsense
        with pytest.raises(CaseError, match=r"damaged \("):
            read_model(whole)


def test_a_failed_write_leaves_the_old_file_and_no_temporary(whole, monkeypatch):
    before = whole.read_bytes()

    def fail(file, model):
        file["half"] = np.zeros(100)
        raise OSError("the disk is full")

    monkeypatch.setattr(files, "put_model", fail)
    with pytest.raises(OSError, match="disk is full"):
        write_model(whole, Model({}, {}, {}), "other")
    assert list(whole.parent.iterdir()) == [whole]
    assert whole.read_bytes() == before


def test_a_first_write_that_fails_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "put_model", lambda file, model: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_model(tmp_path / "geometry.h5", Model({}, {}, {}))
    assert not list(tmp_path.iterdir())


def test_a_file_appears_under_its_name_only_when_it_is_whole(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("old")
    with replacing(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
        assert temporary.suffix == ".csv"  # many writers choose the format by it
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]
