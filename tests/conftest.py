"""Settings of all tests."""

import pytest
from hypothesis import settings

pytest.register_assert_rewrite("tests.oracles")  # so that a failed law shows its numbers

settings.register_profile("tests", deadline=None, max_examples=25, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=300)  # pytest --hypothesis-profile=explore
settings.load_profile("tests")
