"""The same case gives the same files, and the same numbers whatever the number of threads."""

from pathlib import Path

import pytest

from solve.bricks import SPANS, THREADED, find_bricks
from solve.rules import exact_rules
from solve.space import number_control_points
from tests.cases import block_patch, model_of
from tests.robustness.determinism import CLOSE, EXAMPLES, ROOT, check, differing, distance, run

RINGS = """
title = "rings"

[geometry]
degree = 2

[[geometry.pipe]]
name = "inner"
inner = 20.0
outer = 30.0
height = 2.0
angle = 90.0
spans = [4, 6, 1]

[[geometry.pipe]]
name = "outer"
inner = 30.0
outer = 40.0
height = 2.0
angle = 90.0
spans = [3, 5, 1]

[[solve.material]]
young = 2000.0
poisson = 0.3

[[solve.support]]
on = "inner/inner"
ux = 0.0
uy = 0.0
uz = 0.0

[[solve.support]]
on = "outer/outer"
ux = -0.1
uy = -0.1
uz = 0.01

[[solve.contact]]
secondary = "inner/outer"
primary = "outer/inner"

[solve.steps]
count = 2

[post]
pictures = false
report = false
"""

MANY_SPANS = """
[geometry]
degree = 2

[[geometry.block]]
name = "lower"
size = [2.0, 2.0, 1.0]
spans = [23, 23, 12]                # one thread cuts it into more bricks than two do, and two share several

[[geometry.block]]
name = "upper"
origin = [0.5, 0.5, 1.0]
size = [1.0, 1.0, 1.0]
spans = [8, 8, 6]
rotate = { angle = 20.0 }

[[solve.material]]
young = 1000.0
poisson = 0.3

[[solve.support]]
on = "lower/bottom"
ux = 0.0
uy = 0.0
uz = 0.0

[[solve.support]]
on = "upper/top"
ux = 0.001
uy = 0.0
uz = -0.01

[[solve.contact]]
secondary = "upper/bottom"
primary = "lower/top"

[solve.linear]
method = "METHOD"

[post]
pictures = false
report = false
bezier = false
samples = 2
"""


def written(folder: Path, text: str) -> Path:
    """A case file in a folder of its own."""
    folder.mkdir()
    (folder / "case.toml").write_text(text)
    return folder / "case.toml"


def test_two_runs_write_the_same_bytes_but_for_times_and_threads_change_rounding_alone(tmp_path):
    case = written(tmp_path / "case", RINGS)
    once, again, threaded = (run(case, tmp_path / str(n), count, n) for n, count in enumerate((1, 1, 2)))
    assert differing(once, again) == []
    assert distance(once, threaded) <= CLOSE


def test_another_case_differs_in_all_that_is_computed(tmp_path):
    case = written(tmp_path / "case", RINGS)
    other = written(tmp_path / "other", RINGS.replace("ux = -0.1", "ux = -0.1000001"))
    one, two = run(case, tmp_path / "1"), run(other, tmp_path / "2")
    assert {"bodies.vtu", "history.csv", "solution.h5", "summary.json"} <= set(differing(one, two))
    assert distance(one, two) > 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_writes_the_same_bytes_again_with_its_pictures_and_its_report(name):
    files, apart = check(ROOT / "examples" / name / "case.toml")
    assert files == []
    assert apart <= CLOSE


@pytest.mark.slow
@pytest.mark.parametrize("method", ["direct", "iterative"])
def test_threads_that_share_the_work_change_rounding_alone_and_do_so_in_every_run_alike(method, tmp_path):
    files, apart = check(written(tmp_path / "case", MANY_SPANS.replace("METHOD", method)), (2, 2, 1))
    assert files == []
    assert apart <= CLOSE


def test_one_thread_cuts_the_body_of_many_spans_into_other_bricks_than_two_and_these_share_several():
    patch = block_patch("lower", size=(2, 2, 1), degree=2, spans=(23, 23, 12))
    rules = exact_rules(number_control_points(model_of(patch)))["lower"]
    alone, shared = (len(list(find_bricks(patch, rules, spans=spans))) for spans in (SPANS, THREADED * SPANS))
    assert alone > shared > 1
