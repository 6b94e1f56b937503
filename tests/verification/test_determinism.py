"""The same case gives the same files, and the same numbers whatever the number of threads."""

from pathlib import Path

import pytest

from solve.bricks import SPANS, THREADED, find_bricks
from solve.rules import exact_rules
from solve.space import number_control_points
from tests.cases import TWO_BLOCKS, block_patch, model_of
from tests.robustness.determinism import CLOSE, EXAMPLES, ROOT, check, differing, distance, run

POST = """
[post]
pictures = false
report = false
"""
RINGS = (ROOT / "examples/lame_rings/case.toml").read_text() + "[solve.steps]\ncount = 2\n" + POST
UPPER = "size = [1.0, 1.0, 1.0]"
MANY_SPANS = (  # one thread cuts the lower block into more bricks than two do, and two share several
    TWO_BLOCKS.replace("degree = 1", "degree = 2")
    .replace("spans = [2, 2, 1]", "spans = [23, 23, 12]")
    .replace(UPPER, f"{UPPER}\nspans = [8, 8, 6]\nrotate = {{ angle = 20.0 }}")
) + f'[solve.linear]\nmethod = "METHOD"\n{POST}bezier = false\nsamples = 2\n'


def written(folder: Path, text: str) -> Path:
    """A case file in a folder of its own."""
    folder.mkdir()
    (folder / "case.toml").write_text(text)
    return folder / "case.toml"


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    """The output of a run, with one thread."""
    folder = tmp_path_factory.mktemp("once")
    return run(written(folder / "case", RINGS), folder / "run")


def test_two_runs_write_the_same_bytes_but_for_times_and_threads_change_rounding_alone(once, tmp_path):
    case = written(tmp_path / "case", RINGS)
    again, threaded = run(case, tmp_path / "again", 1, 1), run(case, tmp_path / "threaded", 2, 2)
    assert differing(once, again) == []
    assert distance(once, threaded) <= CLOSE


def test_another_case_differs_in_all_that_is_computed(once, tmp_path):
    other = run(written(tmp_path / "case", RINGS.replace("pressure = 25.0", "pressure = 25.00001")), tmp_path / "run")
    assert {"bodies.vtu", "history.csv", "solution.h5", "summary.json"} <= set(differing(once, other))
    assert distance(once, other) > 1e-8


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
