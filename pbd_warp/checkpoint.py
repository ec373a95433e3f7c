"""Checkpoints: a simulation in a file, from which it goes on as if it had never stopped, bit for bit on the CPU.

A NumPy archive (.npz, each member with its checksum): a JSON header, the model's arrays, and every device array of the
simulation, so that there is no list of what is state and what is scratch to get wrong.
"""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from pbd_warp import check
from pbd_warp.atomic import replacing
from pbd_warp.errors import InputError
from pbd_warp.model.builder import DTYPES, find_device
from pbd_warp.model.constraints import DistanceSet, PointSet
from pbd_warp.model.model import Colliders, Contacts, Model
from pbd_warp.settings import Settings
from pbd_warp.version import __version__

FORMAT = "pbd-warp checkpoint"
VERSION = 2


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
            SimulationFailed: the disk is full, or failed otherwise; an older file of that name is still there.
        """
        path = Path(path)
        check.folder(path.parent)
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
        members: dict[str, Any] = {f"model/{name}": values for name, values in _flat(self.model)}
        members |= {f"array/{name}": values for name, values in self.arrays.items()}
        header["members"] = ["header", *members]
        members["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
        with replacing(path, path.with_name(f".{path.name}.{os.getpid()}")) as temporary, open(temporary, "wb") as file:
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
            model = _model(members, find_device(device or header["device"]), header["dtype"])
            arrays = {
                name.removeprefix("array/"): values for name, values in members.items() if name.startswith("array/")
            }
            return cls(model, settings, header["progress"], arrays, header["extra"])
        except (KeyError, TypeError, IndexError, InputError) as error:
            raise InputError(
                f"checkpoint {path} does not fit this pbd-warp: it was made by another ({error})"
            ) from None

    def refuse_other(self, model: Model, settings: Settings, path: str | Path) -> None:
        """Raise an InputError where it is of another model or of other settings than these."""
        theirs, ours = json.loads(json.dumps(self.settings.to_json())), json.loads(json.dumps(settings.to_json()))
        for name, here in ours.items():
            if theirs[name] != here:
                raise InputError(f"checkpoint {path} was made with {name} {_plain(theirs[name])}, not {_plain(here)}")
        if self.model.dtype != model.dtype:
            raise InputError(f"checkpoint {path} is in {self.model.dtype}, not {model.dtype}")
        there = dict(_flat(self.model))
        for name, values in _flat(model):
            if name not in there or not np.array_equal(there[name], values):
                raise InputError(f"checkpoint {path} is of another model: its {name} is not the same")

    def fill(self, arrays: Mapping[str, wp.array], path: str | Path) -> None:
        """Bring a simulation's arrays to what they were; none is changed where one does not fit (InputError)."""
        for name, array in arrays.items():
            there = self.arrays.get(name)
            if there is None or there.shape != array.numpy().shape:
                raise InputError(f"checkpoint {path} has no fitting array {name}: it was made by another pbd-warp")
        for name, array in arrays.items():
            if array.size:
                array.assign(self.arrays[name])


def _read(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    if not path.is_file():
        raise InputError(f"there is no checkpoint {path}")
    try:
        with zipfile.ZipFile(path):  # NumPy takes other files for its own old formats
            pass
        with np.load(path, allow_pickle=False) as archive:
            members = {name: archive[name] for name in archive.files}
        header = json.loads(members["header"].tobytes())
        if header["format"] != FORMAT or (
            header["version"] == VERSION and sorted(header["members"]) != sorted(members)
        ):
            raise KeyError("members")
    except (zipfile.BadZipFile, KeyError, ValueError, TypeError, OSError, EOFError, RuntimeError) as error:
        raise InputError(
            f"{path} is no whole checkpoint of pbd-warp (truncated, damaged or something else): {error}"
        ) from None
    if header["version"] != VERSION:
        raise InputError(
            f"checkpoint {path} has format version {header['version']} (written by pbd-warp {header['written by']}), "
            f"and this pbd-warp reads version {VERSION}: run it again from the start"
        )
    return header, members


def _plain(value: Any) -> str:
    return json.dumps(value) if isinstance(value, dict) else str(value)


def _flat(model: Model) -> Iterator[tuple[str, np.ndarray]]:
    """A model's arrays by name."""
    for field in fields(model):
        value = getattr(model, field.name)
        if is_dataclass(value):
            for inner in fields(value):
                yield f"{field.name}.{inner.name}", np.asarray(getattr(value, inner.name))
        elif isinstance(value, np.ndarray):
            yield field.name, value
    yield "ropes", np.concatenate([np.zeros(0, np.int32), *model.ropes])
    yield "rope_lengths", np.array([len(rope) for rope in model.ropes], int)
    yield "copy_count", np.array(model.copy_count)


def _model(members: dict[str, np.ndarray], device: Any, dtype: str) -> Model:
    flat = {name.removeprefix("model/"): values for name, values in members.items() if name.startswith("model/")}

    def inner(kind: type, name: str) -> Any:
        return kind(**{field.name: flat.pop(f"{name}.{field.name}") for field in fields(kind)})

    distance, point, colliders = inner(DistanceSet, "distance"), inner(PointSet, "point"), inner(Colliders, "colliders")
    contacts = None
    if "contacts.friction" in flat:
        contacts = Contacts(float(flat.pop("contacts.friction")), float(flat.pop("contacts.restitution")))
    ropes = np.split(flat.pop("ropes"), np.cumsum(flat.pop("rope_lengths"))[:-1])
    copy_count = int(flat.pop("copy_count"))
    return Model(
        **flat,
        copy_count=copy_count,
        distance=distance,
        point=point,
        contacts=contacts,
        colliders=colliders,
        ropes=tuple(rope for rope in ropes if len(rope)),
        device=device,
        real=DTYPES[dtype],
    )
