"""JSON files with a digest, and what no file that we read can do."""

import ast
import json
import os
import pickle
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import geom2iga
from geom2iga.errors import CaseError
from geom2iga.files import read_model, read_stamp, write_model
from geom2iga.seal import digest_of, listed, read_sealed
from solve.case import Contact
from solve.files import read_result
from tests.cases import block_patch, model_of
from tests.sealed import altered, reseal

ROOT = Path(geom2iga.__file__).parents[1]  # where it is installed
VALUES = st.recursive(st.none() | st.booleans() | st.floats() | st.integers() | st.text(), st.lists, max_leaves=5)


def write(path, values):
    path.write_text(json.dumps({**values, "digest": digest_of(values)}))
    return path


@pytest.fixture
def path(tmp_path):
    return tmp_path / "summary.json"


@settings(max_examples=20)
@given(st.dictionaries(st.text(), VALUES))
def test_a_summary_comes_back_as_it_was_written(tmp_path_factory, values):
    path = write(tmp_path_factory.mktemp("sealed") / "summary.json", values)
    assert repr(read_sealed(path)) == repr(json.loads(json.dumps({**values, "digest": digest_of(values)})))


def test_any_number_that_changed_is_seen_but_those_of_the_clock(path):
    write(path, {"dofs": 12, "stress": [1.5, -2.25], "seconds": {"newton": 0.75}, "peak_memory": 99})
    whole = path.read_text()
    for old, new in (("12", "13"), ("-2.25", "2.25"), ("dofs", "doff"), (digest_of(json.loads(whole)), "0" * 64)):
        path.write_text(whole.replace(old, new))
        with pytest.raises(CaseError, match=r"summary\.json: damaged, or not written by this program; make it anew"):
            read_sealed(path)
    path.write_text(whole.replace("0.75", "0.5").replace("99", "100").replace(",", ",\n"))
    assert read_sealed(path)["seconds"] == {"newton": 0.5}


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b"7", b"{}", b'{"digest": 1}', b"\xff\xfe\x00", b"[" * 100_000, b"9" * 10_000]
)
def test_what_is_no_summary_is_refused(path, content):
    path.write_bytes(content)
    with pytest.raises(CaseError, match="damaged, or not written by this program"):
        read_sealed(path)
    assert listed(path) == set()


HOSTILE = ["../mine.txt", "../../mine.txt", "/etc/passwd", "..", ".", "", "a\0b", "folder", "folder/inside", 7, None]


def test_only_files_beside_a_summary_are_listed(tmp_path):
    """A list that leads elsewhere, sealed or not, must remove nothing there."""
    folder = tmp_path / "case.out"
    (folder / "folder").mkdir(parents=True)
    for mine in (tmp_path / "mine.txt", folder / "folder/inside", folder / "bodies.vtu"):
        mine.write_text("mine")
    (folder / "link").symlink_to(tmp_path)
    path = write(folder / "summary.json", {"files": [*HOSTILE, "bodies.vtu", "link", "gone.png"]})
    assert listed(path) == {"bodies.vtu", "link"}
    path.write_text(path.read_text().replace("gone.png", "left.png"))
    assert listed(path) == set()
    for values in ({}, {"files": 7}, {"files": [["x"]]}, {"files": None}):
        assert listed(write(path, values)) == set()


class Payload:
    """Makes a file when it is unpickled."""

    def __init__(self, made):
        self.made = made

    def __reduce__(self):
        return os.mkdir, (str(self.made),)


@pytest.fixture
def made(tmp_path):
    """A folder that a payload would make, and does make where it is unpickled."""
    place = tmp_path / "made"
    pickle.loads(pickle.dumps(Payload(place)))
    assert place.is_dir()
    place.rmdir()
    return place


def test_no_reader_runs_what_lies_in_a_file(tmp_path, made):
    """A pickle is tried wherever a file can hold one: as the file, as a dataset of opaque or of any bytes, as text."""
    payload = pickle.dumps(Payload(made), protocol=0)
    path = tmp_path / "geometry.h5"
    readers = (read_model, read_result, read_sealed, lambda path: listed(path) or read_model(path))
    lists = np.empty(1, dtype=object)
    lists[0] = np.frombuffer(payload, dtype=np.uint8)
    kinds = {"text": ([payload], None), "opaque": (np.void(payload), None), "lists": (lists, h5py.vlen_dtype(np.uint8))}
    for form, reader in [(form, reader) for form in ("geom2iga geometry", "geom2iga solution") for reader in readers]:
        path.write_bytes(payload)
        with pytest.raises(CaseError):
            reader(path)
        for values, kind in kinds.values():
            write_model(path, model_of(block_patch()))
            with altered(path) as file:
                for place in ("patches/0/weights", "patches/0/degrees", "groups/0/patch"):
                    del file[place]
                    file.create_dataset(place, shape=np.shape(values), dtype=kind, data=values)
                for name in ("stamp", "status", "materials", "history", "statistics", "diagnosis"):
                    file.attrs[name] = np.void(payload)
            reseal(path, form=form)
            with pytest.raises(CaseError):
                reader(path)
            read_stamp(path, "geom2iga geometry", 3)
    assert not made.exists()


def test_no_table_runs_what_is_written_in_it(made):
    for text in (f"__import__('os').mkdir({str(made)!r})", f"!!python/object/apply:os.mkdir [{made}]"):
        with pytest.raises(ValueError, match="validation error"):
            Contact.model_validate_json(json.dumps({"secondary": text, "primary": "b", "penalty": text}))
    assert not made.exists()


RUNS_CODE = {"pickle", "marshal", "shelve", "dill", "joblib", "cloudpickle", "yaml", "torch", "code", "runpy", "dbm"}


def _offences(source):
    """Calls and imports by which what was read could be run."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (f"import {alias.name}" for alias in node.names if alias.name.split(".")[0] in RUNS_CODE)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in RUNS_CODE:
            yield f"import {node.module}"
        elif isinstance(node, ast.Call) and getattr(node.func, "id", None) in ("eval", "exec", "compile", "__import__"):
            yield f"{ast.unparse(node)}"
        elif isinstance(node, ast.keyword) and node.arg == "allow_pickle":
            yield "allow_pickle"


@pytest.mark.parametrize(
    "source", ["import pickle", "from yaml import load", "eval(text)", "np.load(path, allow_pickle=True)"]
)
def test_what_could_run_code_is_found(source):
    assert list(_offences(source))


def test_nothing_that_we_read_files_with_can_run_code():
    """A process of our own is handed its work by pickle, in a folder that no other user may write to."""
    sources = [path for package in ("geom2iga", "solve", "post") for path in (ROOT / package).rglob("*.py")]
    found = {
        str(path.relative_to(ROOT)): offences for path in sources if (offences := list(_offences(path.read_text())))
    }
    assert found == {"geom2iga/cad/isolated.py": ["import pickle"]}
