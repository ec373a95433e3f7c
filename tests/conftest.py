"""What all tests share. Hypothesis draws the same examples every time."""

import os
import sys

import numpy as np
import pytest
import warp as wp
from browser import ARGUMENTS, CHROMIUM, Page
from hypothesis import HealthCheck, settings

from pbd_warp.cli import main

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


@pytest.fixture
def call(monkeypatch, tmp_path, capsys):
    """Run the command line in an empty folder; gives exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def run(*args):
        monkeypatch.setattr(sys, "argv", ["pbd-warp", *map(str, args)])
        with pytest.raises(SystemExit) as stop:
            main()
        return stop.value.code, *capsys.readouterr()

    return run


WINDOW = {"width": 900, "height": 560}


@pytest.fixture(scope="module")
def chromium():
    if CHROMIUM is None:
        reason = "the browser tests need Chromium: apt-get install --no-install-recommends chromium"
        pytest.fail(reason) if os.environ.get("CI") else pytest.skip(reason)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def open_page(chromium):
    """A page of a server in a browser context (and so a process) of its own; no page may have had an error."""
    opened = []

    def make(server, ready=True, **options):
        # Playwright's own waiting needs eval, which the page's security policy forbids.
        context = chromium.new_context(**{"viewport": WINDOW, "bypass_csp": True, **options})
        opened.append((context, Page(context, server, ready)))
        return opened[-1][1]

    yield make
    errors = [error for _, page in opened for error in page.errors]
    for context, _ in opened:
        context.close()
    assert errors == []
