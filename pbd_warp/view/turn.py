"""What the simulating thread does in one turn; it alone touches the session."""

from __future__ import annotations

import copy
import traceback
from dataclasses import dataclass
from typing import Any

from pbd_warp.errors import InputError
from pbd_warp.grab.recording import Recording
from pbd_warp.view import messages as say
from pbd_warp.view.history import Clip
from pbd_warp.view.remedies import remedies
from pbd_warp.view.report import description, status
from pbd_warp.view.session import Session


@dataclass
class Outcome:
    """Of one turn.

    refused: (page, sentence, remedies). notes: Sentences for all pages. made: Whether there is another frame.
    changed: It is another model now.
    """

    refused: list[tuple[int, str, list[dict[str, Any]]]]
    notes: list[str]
    made: bool
    packet: bytes
    changed: bool
    description: dict[str, Any] | None
    status: dict[str, Any] | None


def take_turn(
    session: Session, commands: list[tuple[int, say.Message | None]], due: bool, tell: bool, describe: bool
) -> Outcome:
    """Do what pages have asked for, and make a frame if one is due.

    Args:
        commands: (page, message); None: the page has gone.
        tell, describe: Whether status and description are wanted in any case.
    """
    before = session.generation
    refused = []
    for who, message in commands:
        try:
            if message is None:
                session.leave(who)
            else:
                session.do(who, message)
        except InputError as error:
            wanted = message.changes if isinstance(message, say.Change) else None
            refused.append((who, str(error), remedies(str(error), session.settings, session.dtype, wanted)))
        except Exception as error:  # a mistake of ours, or a device out of memory: pages live on
            traceback.print_exc()
            refused.append((who, f"{type(error).__name__}: {error}", []))
    try:
        made = due and session.advance()
    except Exception as error:
        traceback.print_exc()
        session.failure, made = f"{type(error).__name__}: {error}", False
    changed = session.generation != before
    notes, session.notes = session.notes, []
    return Outcome(
        refused=refused,
        notes=notes,
        made=made,
        packet=session.packet(),
        changed=changed,
        description=description(session) if describe or changed else None,
        status=status(session) if tell or changed or session.failure is not None else None,
    )


def clip_of(session: Session) -> tuple[Clip, Recording]:
    """What can be saved of a session, as it is now."""
    return session.clip_now(), copy.deepcopy(session.recording)


_TAKES_LONG = {say.Change: "Changing the settings", say.Reset: "Starting over", say.Rope: "Adding the rope"}


def what_takes_long(commands: list[tuple[int, say.Message | None]]) -> str | None:
    """What pages are to show while this is done, None where it is quick."""
    for _, message in commands:
        if isinstance(message, say.Open):
            return f"Opening {message.scene}"
        if type(message) in _TAKES_LONG:
            return _TAKES_LONG[type(message)]
    return None
