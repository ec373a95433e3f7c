"""USD's errors as ours."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from pxr import Tf


@contextmanager
def as_os_error() -> Iterator[None]:
    """What USD cannot write or read is an OSError, as if Python could not."""
    try:
        yield
    except Tf.ErrorException as error:
        raise OSError(reason(error)) from error


def reason(error: BaseException) -> str:
    """USD's errors are many lines of where in its source; the first one's words are the reason."""
    if isinstance(error, Tf.ErrorException) and error.args:
        return str(getattr(error.args[0], "commentary", error))
    return str(error)
