"""Settings of all tests."""

import logging
import signal

import pytest
from hypothesis import settings

from geom2iga.terminal import log

# Shells let what they start in the background ignore Ctrl-C, and so what that starts: tests send it to what they start.
signal.signal(signal.SIGINT, signal.default_int_handler)

pytest.register_assert_rewrite("tests.oracles")  # so that a failed law shows its numbers

settings.register_profile("tests", deadline=None, max_examples=25, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=300)  # pytest --hypothesis-profile=explore
settings.load_profile("tests")


@pytest.fixture
def quiet_log():
    """Leave the log as it was."""
    yield
    for handler in list(log.handlers):
        log.removeHandler(handler)
        handler.close()
    log.propagate, log.level = True, logging.NOTSET
