import numpy as np
import pytest

from tests.robustness import file_mutants
from tests.robustness.file_mutants import Mutant, drawn, fault, finish

BELIEVED = Mutant("geometry.h5", "flipped", "reading")


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    return finish(tmp_path_factory.mktemp("finished"))


@pytest.mark.parametrize("number", [*range(12), *(pytest.param(n, marks=pytest.mark.slow) for n in range(12, 30))])
def test_a_damaged_file_is_refused_or_made_anew(finished, tmp_path, number):
    mutant, _, wrong = fault(number, finished, tmp_path / "mutant")
    assert not wrong, f"{mutant}: {wrong}"


def test_a_mutant_is_the_same_by_its_number():
    assert [drawn(number)[0] for number in range(50)] == [drawn(number)[0] for number in range(50)]
    assert len({drawn(number)[0] for number in range(50)}) > 40


def test_a_reader_that_believes_what_is_damaged_is_found(finished, tmp_path, monkeypatch):
    monkeypatch.setattr(file_mutants, "drawn", lambda number: (BELIEVED, np.random.default_rng(number)))
    monkeypatch.setattr(file_mutants, "read_model", lambda path, stamp: None)
    assert fault(0, finished, tmp_path / "mutant")[2] == "believed"
