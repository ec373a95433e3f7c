"""The campaign of faults in short; `python tests/campaign`, or `pytest tests/test_campaign.py --long`, is all of it."""

import os

import pytest
from campaign import damage, inputs, kills, threads
from campaign.processes import Processes, may_trace

pytestmark = pytest.mark.skipif(os.name == "nt", reason="commands in forked processes")


@pytest.fixture(scope="module")
def processes():
    with Processes(("worm", "rope", "chain")) as made:
        yield made


@pytest.fixture
def part(request):
    """What the figures are divided by."""
    return 1 if request.config.getoption("--long") else 40


def complaints(pairs):
    return [f"{moment}: {complaint}" for moment, complaint in pairs if complaint]


@pytest.mark.parametrize("case", kills.CASES, ids=lambda case: case.name + case.suffix)
def test_what_goes_on_after_a_kill_is_byte_equal(processes, tmp_path, part, case):
    if not may_trace():
        pytest.skip("needs strace, and leave to attach it")
    assert complaints(kills.check(processes, case, tmp_path, max(part // 4, 1))) == []


def test_a_damaged_checkpoint_is_refused_or_what_it_was(processes, tmp_path, part):
    figures, wrong = damage.check(processes, tmp_path, 20_000 // part)
    assert wrong == []
    assert figures["refused"] > 0.5 * figures["damages"], "what is not are dates and the like"


@pytest.mark.parametrize(
    ("check", "count"), [(inputs.check_arguments, 1000), (inputs.check_stages, 1000), (inputs.check_drags, 500)]
)
def test_no_input_ends_in_a_traceback_or_in_wrong_output(processes, tmp_path, part, check, count):
    assert complaints(check(processes, tmp_path / "inputs", count // part)) == []


def test_threads_get_what_one_alone_gets(part):
    assert threads.check(8, 200 // part) == []
