"""What is built for its settings, on a device: neither is changed or copied behind its back."""

from __future__ import annotations

from typing import Any, NoReturn

from pbd_warp.settings import NAMES


class BuiltForSettings:
    """Base of `Simulation`: its settings and its model are read-only, and it is not pickled."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name in NAMES or name == "time" or (name in ("settings", "model") and name in self.__dict__):
            raise AttributeError(
                f"{name} is read-only, as a simulation is built for it: like(...) and continue_with(...) make another"
            )
        super().__setattr__(name, value)

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        raise TypeError(
            "a simulation lives on its device and is neither pickled nor copied: save(path) and Simulation.load(path) "
            "keep it, like() and continue_with() make another"
        )
