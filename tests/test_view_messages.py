"""What pages may say: every message that makes no sense is refused, whatever it is."""

import contextlib
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

import pbd_warp as pbd
from pbd_warp.view import messages as say

CAMERA = {"eye": [0, 0, 3], "forward": [0, 0, -1], "up": [0, 1, 0], "field_of_view": 0.8, "size": [800, 600]}

anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)
kinds = st.sampled_from(["click", "move", "release", "pause", "step", "reset", "change", "load", "seen"])
cameras = st.fixed_dictionaries(dict.fromkeys(CAMERA, anything))
odd_messages = (
    anything
    | st.fixed_dictionaries(
        {"type": kinds | anything}, optional=dict.fromkeys(("at", "on", "scene", "count"), anything)
    )
    | st.fixed_dictionaries(
        {"type": st.sampled_from(["click", "move"]), "camera": cameras | st.just(CAMERA), "at": anything}
    )
    | st.fixed_dictionaries(
        {"type": st.just("change"), "changes": st.dictionaries(st.sampled_from(list(say._CHANGES)), anything)}
    )
)
odd_texts = st.text(max_size=60) | st.binary(max_size=60) | odd_messages.map(json.dumps)


@given(odd_texts)
def test_whatever_is_said_is_a_message_or_an_input_error(text):
    with contextlib.suppress(pbd.InputError):
        assert isinstance(say.parse(text), say.Message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", "unknown message None"),
        ("[" * 4000, "must be JSON"),
        ("1" * 4000, "must be"),
        ('{"type": "step", "type": "jump"}', "unknown message 'jump'"),
        ('{"type": ["click"]}', "unknown message"),
        ('{"type": "step", "frames": 3}', "nothing else"),
        ('{"type": "pause", "on": 1}', "true or false"),
        ('{"type": "seen", "count": -1}', "at least 0"),
        ('{"type": "seen", "count": true}', "whole number"),
        ('{"type": "load", "scene": 1}', "must be a text"),
        ('{"type": "change", "changes": {}}', "changes must be"),
        ('{"type": "change", "changes": {"fps": 1}}', "unknown setting 'fps'"),
        ('{"type": "change", "changes": {"substeps": 1000000}}', "at most 512"),
        ('{"type": "change", "changes": {"substeps": 2.5}}', "whole number"),
        ('{"type": "change", "changes": {"iterations": 0}}', "at least 1"),
        ('{"type": "change", "changes": {"stiffness": NaN}}', "stiffness must be"),
        ('{"type": "change", "changes": {"stiffness": "1"}}', "stiffness must be a number"),
        ('{"type": "change", "changes": {"damping": 1.5}}', "damping must be"),
        ('{"type": "change", "changes": {"gravity": [0, -Infinity, 0]}}', "gravity must be"),
        ('{"type": "change", "changes": {"gravity": [0, 0]}}', "3 numbers"),
        ('{"type": "change", "changes": {"gravity": [0, -1e9, 0]}}', "gravity must be"),
        ('{"type": "change", "changes": {"method": 3}}', "must be a text"),
        (json.dumps({"type": "click", "camera": CAMERA, "at": [1e30, 0]}), "at must be within"),
        (json.dumps({"type": "click", "camera": CAMERA, "at": [float("nan"), 0]}), "finite"),
        (json.dumps({"type": "click", "camera": CAMERA, "at": [1]}), "2 numbers"),
        (json.dumps({"type": "click", "camera": {**CAMERA, "eye": [0, 0, 10**400]}, "at": [1, 1]}), "must be"),
        (json.dumps({"type": "click", "camera": {**CAMERA, "size": [0, 0]}, "at": [1, 1]}), "one pixel"),
        (json.dumps({"type": "click", "camera": {"eye": [0, 0, 1]}, "at": [1, 1]}), "camera must have"),
        (b"\x00\x01", "must be text"),
        (" " * 5000, "at most 4096"),
    ],
)
def test_what_makes_no_sense_is_refused(text, message):
    with pytest.raises(pbd.InputError, match=message):
        say.parse(text)
