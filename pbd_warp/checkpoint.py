"""Checkpoints: a simulation in a file, from which it goes on as if it had never stopped, bit for bit on the CPU.

A NumPy archive (.npz, each member with its checksum): a JSON header, the model's arrays, and every device array of the
simulation, so that there is no list of what is state and what is scratch to get wrong.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from pbd_warp import check
from pbd_warp.atomic import replacing
from pbd_warp.errors import InputError, SimulationFailed
from pbd_warp.model.builder import DTYPES, find_device
from pbd_warp.model.flat import flat_arrays, model_from
from pbd_warp.model.model import Model
from pbd_warp.paths import check_file
from pbd_warp.settings import Settings
from pbd_warp.version import __version__

FORMAT = "pbd-warp checkpoint"
VERSION = 3


@dataclass(frozen=True)
class Checkpoint:
    """A simulation at the end of a frame.

    progress: What else it needs to go on, as values that JSON can hold.
    arrays: All its device arrays by name.
    extra: What the caller wants to find there again.
    """

    model: Model
    settings: Settings
    progress: dict[str, Any]
    arrays: Mapping[str, np.ndarray]
    extra: dict[str, Any]

    def write(self, path: str | Path) -> None:
        """Write it to a file, which appears when it is complete.

        Raises:
            InputError: the folder does not exist or cannot be written to.
            SimulationFailed: the state is not finite, the disk is full, or failed otherwise; an older file of that name
                is still there.
        """
        path = check_file(Path(path))
        for name in ("x", "v"):
            if not np.isfinite(self.arrays[name]).all():
                raise SimulationFailed(f"a checkpoint keeps no state that is not finite: {path} was not written")
        header: dict[str, Any] = {
            "format": FORMAT,
            "version": VERSION,
            "written by": __version__,
            "device": str(self.model.device),
            "dtype": self.model.dtype,
            "settings": self.settings.to_json(),
            "progress": self.progress,
            "extra": self.extra,
        }
        members: dict[str, Any] = {f"model/{name}": values for name, values in flat_arrays(self.model)}
        members |= {f"array/{name}": values for name, values in self.arrays.items()}
        header["members"] = ["header", *members]
        members["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
        with replacing(path) as temporary, open(temporary, "wb") as file:
            np.savez(file, **members)

    @classmethod
    def read(cls, path: str | Path, device: Any = None) -> Checkpoint:
        """What `write` wrote.

        Args:
            device: Where to; the device it was on unless given.

        Raises:
            InputError: no such file, a truncated or damaged one, one that is no checkpoint, or of another version.
        """
        header, members = _read(Path(path))
        try:
            settings = Settings.from_json(header["settings"])
            if header["dtype"] not in DTYPES:
                raise InputError(f"its dtype is {header['dtype']!r}")
            model = model_from(_below("model/", members), find_device(device or header["device"]), header["dtype"])
            progress = _checked_progress(header["progress"])
            if not isinstance(header["extra"], dict):
                raise InputError("its extra is no table")
        except (KeyError, TypeError, InputError) as error:
            raise InputError(f"checkpoint {path} does not fit this pbd-warp: {error}") from None
        return cls(model, settings, progress, _below("array/", members), header["extra"])

    def refuse_other(self, model: Model, settings: Settings, path: str | Path) -> None:
        """Raise an InputError where it is of another model or of other settings than these."""
        theirs, ours = json.loads(json.dumps(self.settings.to_json())), json.loads(json.dumps(settings.to_json()))
        for name, here in ours.items():
            if theirs[name] != here:
                raise InputError(f"checkpoint {path} was made with {name} {_plain(theirs[name])}, not {_plain(here)}")
        if self.model.dtype != model.dtype:
            raise InputError(f"checkpoint {path} is in {self.model.dtype}, not {model.dtype}")
        there = dict(flat_arrays(self.model))
        for name, values in flat_arrays(model):
            if name not in there or not np.array_equal(there[name], values):
                raise InputError(f"checkpoint {path} is of another model: its {name} is not the same")

    def fill(self, arrays: Mapping[str, wp.array], fixed: Collection[str], path: str | Path) -> None:
        """Bring a simulation's arrays to what they were.

        Args:
            fixed: Names of those that never change, such as the particles of an edge: kernels trust them.

        Raises:
            InputError: one does not fit, is not finite, or is fixed and another; no array has changed then.
        """
        for name, array in arrays.items():
            there, here = self.arrays.get(name), array.numpy()
            if there is None or there.shape != here.shape or there.dtype != here.dtype:
                raise InputError(f"checkpoint {path} has no fitting array {name}: it was made by another pbd-warp")
            if np.issubdtype(there.dtype, np.floating) and not np.isfinite(there).all():
                raise InputError(f"checkpoint {path} holds numbers that are not finite, in {name}")
            if name in fixed and not np.array_equal(there, here):
                raise InputError(f"checkpoint {path} is of another model: its {name} is not the same")
        for name, array in arrays.items():
            if array.size:
                array.assign(self.arrays[name])


def _read(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The header and all members, each read to its end, where its checksum is compared."""
    if not path.is_file():
        raise InputError(f"there is no checkpoint {path}")
    try:
        with zipfile.ZipFile(path) as archive:
            members = {}
            for info in archive.infolist():
                if info.compress_type != zipfile.ZIP_STORED:  # so nothing is larger than the file
                    raise ValueError(f"{info.filename} is compressed")
                members[info.filename.removesuffix(".npy")] = _array(info.filename, archive.read(info))
        header = json.loads(members["header"].tobytes())
        if header["format"] != FORMAT:
            raise ValueError("it is of another format")
        version, writer = header["version"], str(header["written by"])
        if version == VERSION and sorted(header["members"]) != sorted(members):
            raise ValueError("members are missing")
    except Exception as error:  # whatever the bytes of the file make of NumPy, zipfile and JSON
        raise InputError(
            f"{path} is no whole checkpoint of pbd-warp (truncated, damaged or something else): {error}"
        ) from None
    if version != VERSION:
        raise InputError(
            f"checkpoint {path} has format version {version} (written by pbd-warp {writer}), "
            f"and this pbd-warp reads version {VERSION}: run it again from the start"
        )
    return header, members


def _array(name: str, content: bytes) -> np.ndarray:
    """A member, if it is numbers and of just the size that its header says: NumPy itself would stop reading there."""
    file = io.BytesIO(content)
    if np.lib.format.read_magic(file) != (1, 0):
        raise ValueError(f"{name} has another format")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
    count = 1
    for length in shape:
        count *= length
    data = content[file.tell() :]
    if dtype.kind not in "fiu" or fortran or any(length < 0 for length in shape) or count * dtype.itemsize != len(data):
        raise ValueError(f"{name} is not as large as it says")
    return np.frombuffer(data, dtype).reshape(shape)


def _below(folder: str, members: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name.removeprefix(folder): values for name, values in members.items() if name.startswith(folder)}


def _checked_progress(progress: Any) -> dict[str, Any]:
    if not isinstance(progress, dict) or progress.keys() != {"frame", "retried", "moved", "failures"}:
        raise InputError("its progress must have frame, retried, moved, failures")
    for name in ("frame", "retried"):
        check.whole(name, progress[name], low=0)
    return progress


def _plain(value: Any) -> str:
    return json.dumps(value) if isinstance(value, dict) else str(value)
