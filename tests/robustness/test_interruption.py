import pytest

from tests.robustness.disks import can_mount
from tests.robustness.interruption import campaign
from tests.robustness.kinds import KINDS
from tests.robustness.runs import WITHOUT_PICTURES


@pytest.fixture(scope="module")
def quick():
    """The case without what takes its time."""
    with campaign(WITHOUT_PICTURES) as cut:
        yield cut


@pytest.fixture(scope="module")
def whole():
    """The case with all outputs."""
    with campaign() as cut:
        yield cut


@pytest.mark.parametrize("name", ["kill at a file", pytest.param("full disk at a file", marks=pytest.mark.slow)])
def test_a_run_that_was_cut_off_is_taken_up_again(quick, name):
    _, wrong = quick.attempt(KINDS[name], 1)
    assert not wrong


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_whatever_happens_to_a_run_the_next_one_ends_as_if_nothing_had(whole, name):
    if KINDS[name].mounts and not can_mount():
        pytest.skip("nothing may be mounted here")
    _, wrong = whole.attempt(KINDS[name], list(KINDS).index(name))
    assert not wrong
