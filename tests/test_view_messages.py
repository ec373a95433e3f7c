"""What pages may say: every message that makes no sense is refused, whatever it is."""

import contextlib
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

import pbd_warp as pbd
from pbd_warp.view import messages as say
from pbd_warp.view.changes import CHANGES

anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)
FIELDS = {kind: fields for kind, (fields, _) in say._PARSERS.items()}
odd_messages = (
    anything
    | st.sampled_from(list(FIELDS)).flatmap(
        lambda kind: st.fixed_dictionaries({"type": st.just(kind), **dict.fromkeys(FIELDS[kind], anything)})
    )
    | st.fixed_dictionaries({"type": anything}, optional=dict.fromkeys(("position", "on", "scene"), anything))
    | st.fixed_dictionaries(
        {"type": st.just("change"), "changes": st.dictionaries(st.sampled_from(list(CHANGES)), anything)}
    )
)
odd_texts = st.text(max_size=60) | st.binary(max_size=60) | odd_messages.map(json.dumps)


@given(odd_texts)
def test_whatever_is_said_is_a_message_or_an_input_error(text):
    with contextlib.suppress(pbd.InputError):
        assert isinstance(say.parse(text), say.Message)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('{"type": "select", "particle": 3, "frame": 7, "generation": 1}', say.Select(3, 7, 1)),
        ('{"type": "move", "position": [0, 1.5, -2]}', say.Move((0.0, 1.5, -2.0))),
        ('{"type": "release"}', say.Release()),
        ('{"type": "rewind", "frame": 3}', say.Rewind(3)),
        ('{"type": "record", "on": true}', say.Record(True)),
        ('{"type": "change", "changes": {"grab_acceleration": null}}', say.Change({"grab_acceleration": None})),
        (
            '{"type": "open", "scene": "chain", "parameters": {"links": "5"}, "changes": {"damping": 0}}',
            say.Open("chain", {"links": "5"}, {"damping": 0.0}),
        ),
    ],
)
def test_what_makes_sense_is_understood(text, expected):
    assert say.parse(text) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", "unknown message None"),
        ("[" * 4000, "must be JSON"),
        ("1" * 4000, "must be"),
        ('{"type": "step", "type": "jump"}', "unknown message 'jump'"),
        ('{"type": ["select"]}', "unknown message"),
        ('{"type": "step", "frames": 3}', "nothing else"),
        ('{"type": "pause", "on": 1}', "true or false"),
        ('{"type": "record", "on": null}', "true or false"),
        ('{"type": "seen", "count": -1}', "at least 0"),
        ('{"type": "seen", "count": true}', "whole number"),
        ('{"type": "rewind", "frame": -1}', "at least 0"),
        ('{"type": "select", "particle": -1, "frame": 0, "generation": 1}', "particle must be at least 0"),
        ('{"type": "select", "particle": 1, "frame": 0.5, "generation": 1}', "frame must be a whole number"),
        ('{"type": "select", "particle": 1, "frame": 0}', "must have particle, frame, generation"),
        ('{"type": "move", "position": [0, 0]}', "3 numbers"),
        ('{"type": "move", "position": [0, 0, NaN]}', "position must be"),
        ('{"type": "move", "position": [0, 0, 1e7]}', "position must be"),
        ('{"type": "move", "position": [0, 0, "1"]}', "position must be a number"),
        (json.dumps({"type": "move", "position": [0, 0, 10**400]}), "position must be"),
        ('{"type": "open", "scene": 1, "parameters": {}, "changes": {}}', "must be a text"),
        ('{"type": "open", "scene": "rope", "parameters": {"n": 1}, "changes": {}}', "object of texts"),
        ('{"type": "open", "scene": "chain", "parameters": {"links": "1e9"}, "changes": {}}', "at most 20000"),
        ('{"type": "open", "scene": "chain", "parameters": {"links": "nan"}, "changes": {}}', "at most 20000"),
        ('{"type": "open", "scene": "chain", "parameters": {}, "changes": 3}', "changes must be"),
        ('{"type": "rope", "points": 3, "pinned": []}', "points must be a list"),
        ('{"type": "rope", "points": [[0, 0, 0], [1, 0]], "pinned": []}', "3 numbers"),
        ('{"type": "rope", "points": [[0, 0, 0], [1, 0, 0]], "pinned": [5]}', "pinned names point 5"),
        ('{"type": "rope", "points": [[0, 0, 0]], "pinned": []}', "2 to 100 points"),
        ('{"type": "change", "changes": {}}', "changes must be"),
        ('{"type": "change", "changes": [1]}', "changes must be"),
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
        ('{"type": "change", "changes": {"grab_acceleration": 0}}', "grab_acceleration must be"),
        ('{"type": "change", "changes": {"max_contacts": 1e9}}', "whole number"),
        ('{"type": "change", "changes": {"dtype": "float16"}}', "unknown dtype 'float16'"),
        (b"\x00\x01", "must be text"),
        (" " * 20_000, "at most 16384"),
    ],
)
def test_what_makes_no_sense_is_refused(text, message):
    with pytest.raises(pbd.InputError, match=message):
        say.parse(text)
