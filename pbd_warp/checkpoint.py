"""Checkpoints: a simulation in a file, from which it goes on as if it had never stopped, bit for bit on the CPU.

A NumPy archive (.npz, each member with its checksum): a JSON header, the model's arrays, and every device array of the
simulation, so that there is no list of what is state and what is scratch to get wrong.
"""

from __future__ import annotations

import inspect
import json
import os
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pbd_warp import check
from pbd_warp.atomic import replacing
from pbd_warp.errors import InputError
from pbd_warp.model.builder import DTYPES, find_device
from pbd_warp.model.model import Colliders, Contacts, Model
from pbd_warp.simulation import Simulation
from pbd_warp.step.constraints.distance import DistanceSet
from pbd_warp.step.constraints.point import PointSet
from pbd_warp.step.divergence import Limits
from pbd_warp.step.methods import METHODS
from pbd_warp.version import __version__

FORMAT = "pbd-warp checkpoint"
VERSION = 1


def save(sim: Simulation, path: str | Path, extra: Mapping[str, Any] | None = None) -> None:
    """Write a simulation to a file, which appears when it is complete.

    Args:
        extra: What the caller wants to find there again; anything that JSON can hold.

    Raises:
        InputError: the folder does not exist or cannot be written to.
        SimulationFailed: the disk is full, or failed otherwise; an older file of that name is still there.
    """
    path = Path(path)
    check.folder(path.parent)
    header = {
        "format": FORMAT,
        "version": VERSION,
        "written by": __version__,
        "device": str(sim.model.device),
        "dtype": sim.model.dtype,
        "settings": _settings(sim),
        "frame": sim.frame,
        "retried": sim.retried,
        "held": sim.held,
        "led": sim.led,
        "extra": dict(extra or {}),
    }
    members: dict[str, Any] = {f"model/{name}": values for name, values in _flat(sim.model)}
    members |= {f"array/{name}": array.numpy() for name, array in sim.arrays.items()}
    header["members"] = ["header", *members]
    members["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    with replacing(path, path.with_name(f".{path.name}.{os.getpid()}")) as temporary, open(temporary, "wb") as file:
        np.savez(file, **members)


def load(path: str | Path, device: Any = None) -> Simulation:
    """The simulation of a file, model and settings included.

    Args:
        device: Where to; the device it was on unless given.

    Raises:
        InputError: no such file, a truncated or damaged one, one that is no checkpoint, or of another version.
    """
    header, members = _read(Path(path))
    try:
        settings = dict(header["settings"])
        if settings.keys() != set(inspect.signature(Simulation).parameters) - {"model"}:
            raise KeyError(f"settings {', '.join(settings)}")
        method = dict(settings.pop("method"))
        model = _model(members, find_device(device or header["device"]), header["dtype"])
        sim = Simulation(
            model, method=METHODS[method.pop("name")](**method), limits=Limits(**settings.pop("limits")), **settings
        )
    except (KeyError, TypeError, IndexError) as error:
        raise InputError(f"checkpoint {path} does not fit this pbd-warp: it was made by another ({error})") from None
    _fill(sim, header, members, path)
    return sim


def extra_of(path: str | Path) -> dict[str, Any]:
    """The `extra` that was saved; raises as `load`."""
    return _read(Path(path))[0]["extra"]


def restore(sim: Simulation, path: str | Path) -> None:
    """Bring a simulation to where a file says it was.

    Raises:
        InputError: as `load`, and where the file is of another model or of other settings; `sim` is as it was.
    """
    header, members = _read(Path(path))
    for name, here in _settings(sim).items():
        there = header["settings"].get(name)
        if there != here:
            raise InputError(f"checkpoint {path} was made with {name} {_plain(there)}, not {_plain(here)}")
    if header["dtype"] != sim.model.dtype:
        raise InputError(f"checkpoint {path} is in {header['dtype']}, not {sim.model.dtype}")
    for name, values in _flat(sim.model):
        there = members.get(f"model/{name}")
        if there is None or not np.array_equal(there, values):
            raise InputError(f"checkpoint {path} is of another model: its {name} is not the same")
    _fill(sim, header, members, path)


def _fill(sim: Simulation, header: dict[str, Any], members: dict[str, np.ndarray], path: str | Path) -> None:
    for name, array in sim.arrays.items():
        there = members.get(f"array/{name}")
        if there is None or there.shape != array.numpy().shape:
            raise InputError(f"checkpoint {path} has no fitting array {name}: it was made by another pbd-warp")
    for name, array in sim.arrays.items():
        if array.size:
            array.assign(members[f"array/{name}"])
    sim.frame, sim.retried = header["frame"], header["retried"]
    sim.held = header["held"]
    sim.led = tuple(header["led"]) if header["led"] else None


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


def _settings(sim: Simulation) -> dict[str, Any]:
    """As JSON would give them back."""
    method = {"name": sim.method.name, **vars(sim.method)}
    return json.loads(json.dumps({**sim.settings, "method": method, "limits": vars(sim.settings["limits"])}))


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


def _model(members: dict[str, np.ndarray], device: Any, dtype: str) -> Model:
    flat = {name.removeprefix("model/"): values for name, values in members.items() if name.startswith("model/")}

    def part(kind: type, name: str) -> Any:
        return kind(**{field.name: flat.pop(f"{name}.{field.name}") for field in fields(kind)})

    distance, point, colliders = part(DistanceSet, "distance"), part(PointSet, "point"), part(Colliders, "colliders")
    contacts = None
    if "contacts.friction" in flat:
        contacts = Contacts(float(flat.pop("contacts.friction")), float(flat.pop("contacts.restitution")))
    ropes = np.split(flat.pop("ropes"), np.cumsum(flat.pop("rope_lengths"))[:-1])
    return Model(
        **flat,
        distance=distance,
        point=point,
        contacts=contacts,
        colliders=colliders,
        ropes=tuple(rope for rope in ropes if len(rope)),
        device=device,
        real=DTYPES[dtype],
    )
