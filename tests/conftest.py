"""What all tests share. Hypothesis draws the same examples every time."""

import numpy as np
import pytest
import warp as wp
from hypothesis import HealthCheck, settings

settings.register_profile(
    "same", derandomize=True, deadline=None, max_examples=30, suppress_health_check=list(HealthCheck)
)
settings.load_profile("same")
wp.config.log_level = wp.LOG_ERROR


def pytest_addoption(parser):
    parser.addoption("--long", action="store_true", help="all of the campaign of faults, not a part of it")
    parser.addoption(
        "--pictures", metavar="FOLDER", help="keep there the pictures that the tests of the live view make"
    )


@pytest.fixture
def rng():
    return np.random.default_rng(7)
