import csv
import json
from pathlib import Path

import numpy as np
import pytest
import pyvista

import geom2iga
import solve
from geom2iga.errors import CaseError
from post.case import PostCase
from post.data import size_of_data, write_data
from post.export import export
from post.fields import Samples
from post.pipeline import main
from post.probes import sample_probes
from post.wanted import check_wanted

LINE = {"name": "axis", "start": [1.6, 0.9, 0.0], "end": [1.6, 0.9, 2.0], "points": 11, "field": "stress_zz"}
ALL = {
    "samples": 3,
    "pictures": False,
    "report": False,
    "gauss_points": True,
    "point": [{"name": "inside", "at": [0.5, 0.5, 0.5]}],
    "line": [LINE],
}


@pytest.fixture(scope="module")
def stepped(bent_case):
    case = bent_case.changed({"solve.steps": {"factors": [0.25, 0.5, 1.0]}})
    return solve.solve(geom2iga.build(case), case)


@pytest.fixture(scope="module")
def written(stepped, tmp_path_factory):
    """A folder with all data files of three load steps."""
    folder = tmp_path_factory.mktemp("data")
    export(stepped, {"post": ALL}, folder)
    return folder


def test_every_file_that_is_written_is_listed(written):
    listed = json.loads((written / "summary.json").read_text())["files"]
    assert {path.name for path in written.iterdir()} == {*listed, "summary.json"}


@pytest.mark.parametrize("kind", ["bezier", "contact"])
def test_a_collection_names_a_file_for_each_load_step_that_holds_its_displacement(written, stepped, kind):
    reader = pyvista.get_reader(written / f"{kind}.pvd")
    assert reader.time_values == [1.0, 2.0, 3.0]
    largest = []
    for time in reader.time_values:
        reader.set_active_time_value(time)
        largest.append(np.linalg.norm(reader.read()[0]["displacement"], axis=1).max())
    assert 0 < largest[0] < largest[1] < largest[2]
    alone = pyvista.read(written / f"{kind}.vtu")
    assert np.linalg.norm(alone["displacement"], axis=1).max() == largest[2]


def test_earlier_load_steps_may_be_left_out(stepped, tmp_path):
    post = PostCase.model_validate({"post": {"load_steps": False}}).post
    names = list(write_data(Samples(stepped, 2), post, sample_probes(stepped, post), tmp_path))
    assert names == ["history.csv", "load_steps.csv", "reactions.csv", "contact.vtu", "bezier.vtu"]
    assert {path.name for path in tmp_path.iterdir()} == set(names)


def test_the_size_of_the_large_files_is_known_beforehand(written, stepped):
    found = sum(path.stat().st_size for path in written.glob("*.vtu") if not path.name.startswith("contact"))
    post = PostCase.model_validate({"post": ALL}).post
    headers = 5 * 4000
    assert 0 <= found - size_of_data(stepped, post, 3) < headers


def test_reactions_balance_the_loads_of_each_load_step(written, stepped):
    rows = list(csv.DictReader((written / "reactions.csv").read_text().splitlines()))
    bare = 2 * 2 - stepped.pairs[0].control_area.sum()  # of the lower top, under a pressure of 1 as the upper one
    for step, share in (("1", 0.25), ("2", 0.5), ("3", 1.0)):
        total = [sum(float(row[f"force_{axis}"]) for row in rows if row["load_step"] == step) for axis in "xyz"]
        assert total[1] == pytest.approx(-0.2 * share, abs=1e-9)  # against the shear of 0.2 on the top of area 1
        assert total[2] == pytest.approx((1 + bare) * share, rel=1e-9)


def test_a_point_has_a_row_per_load_step_and_a_line_one_per_point_and_body(written):
    point = list(csv.DictReader((written / "point_inside.csv").read_text().splitlines()))
    assert [row["load_factor"] for row in point] == ["0.25", "0.5", "1.0"]
    line = list(csv.DictReader((written / "line_axis.csv").read_text().splitlines()))
    assert len(line) >= 11
    assert {row["body"] for row in line} == {"lower", "upper"}


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"picture": [{"name": "a", "field": "ux", "bodies": ["uper"]}]}, 'picture.0..bodies.*"uper".*did you mean'),
        ({"line": [{**LINE, "body": "lowr"}]}, r"post\.line\[0\].*did you mean"),
        ({"point": [{"name": "p", "at": [9.0, 0.0, 0.0]}]}, r"post\.point\[0\]\.at.*outside"),
    ],
)
def test_what_the_model_does_not_have_is_said_before_anything_is_solved(bent, wanted, message):
    with pytest.raises(CaseError, match=message):
        check_wanted(bent.model, [], PostCase.model_validate({"post": wanted}))


def test_two_probes_of_one_name_are_refused(tmp_path, capfd):
    text = Path("examples/contact_patch_test/case.toml").read_text()
    twice = (
        '[post]\n[[post.point]]\nname = "p"\nat = [1.0, 1.0, 0.5]\n' + '[[post.point]]\nname = "p"\nat = [1, 1, 0]\n'
    )
    (tmp_path / "case.toml").write_text(text + twice)
    assert main([str(tmp_path / "case.toml")]) == 2
    assert 'point: two are named "p"' in capfd.readouterr().err
