"""The native functions in the package's `.cc` files as kernels, and each thread's scratch memory."""

from __future__ import annotations

import threading
from collections.abc import Callable
from importlib import resources
from typing import Any

import numpy as np
import warp as wp

from vig_renderer import device
from vig_renderer.device import Prepared, initialise
from vig_renderer.once import make_once
from vig_renderer.raster import PIXEL_BOX
from vig_world.raster.records import address, declarations

MODULE = "vig_world_raster"
FUNCTIONS = {
    "raster/draw": "Task",
    "raster/collect": "Task",
    "raster/shade": "Task",
    "raster/surface": "Task",
    "raster/spread": "Task",
    "raster/normals": "Task",
    "raster/encode": "Task",
    "raster/scatter": "Sweep",
    "raster/sweep": "Sweep",
    "raster/light": "Target",
    "raster/settle": "Search",
    "composition/places": "Places",
    "composition/occluder": "Occluder",
}
"""Each native function, with the record that it works on: `FOLDER/NAME.cc` holds its body."""


def source(name: str) -> str:
    """The text of a native function: declarations, `task`, body."""
    record = FUNCTIONS[name]
    # Contraction: products and sums in one instruction.
    return (
        "#pragma clang fp contract(fast)\n"
        + declarations()
        + f"{record}* const task = ({record}*)address;\n"
        + _body(name)
    )


def _body(name: str) -> str:
    """The text of `FOLDER/NAME.cc` with what it includes."""
    body = resources.files("vig_world").joinpath(f"{name}.cc").read_text("utf-8")
    if "#include <draw>\n" in body:
        body = body.replace("#include <draw>\n", _body("raster/draw"))
    return body.replace("#include <pixel_box>\n", PIXEL_BOX.read_text("utf-8"))


@make_once
def kernels() -> dict[str, wp.Kernel]:
    """The kernels by name, compiled at first use: functions of a record's address that run on one thread."""
    initialise()
    return {path.rpartition("/")[2]: _kernel(path) for path in FUNCTIONS}


def _kernel(path: str) -> wp.Kernel:
    name = path.rpartition("/")[2]

    def function(address: wp.uint64): ...

    function.__qualname__ = f"{name}_native"  # Warp identifies functions and kernels of a module by this
    native = wp.func_native(snippet=source(path))(function)

    def run(task: wp.uint64):
        native(task)

    run.__qualname__ = name
    return wp.kernel(module=MODULE)(run)


class Workspace(threading.local):
    """A thread's reusable memory: records at fixed addresses, and buffers that only grow."""

    def __init__(self) -> None:
        self._records: dict[str, np.ndarray] = {}
        self._fields: dict[tuple[str, tuple[str, ...]], np.ndarray] = {}
        self._buffers: dict[str, np.ndarray] = {}
        self._addresses: dict[str, int] = {}
        self._launches: dict[tuple[str, str], Callable[[], object]] = {}

    def record(self, name: str, dtype: np.dtype) -> np.ndarray:
        """The record (1,) of that name, with its previous contents."""
        if name not in self._records:
            self._records[name] = np.zeros(1, dtype)
        return self._records[name]

    def fields(self, name: str, dtype: np.dtype, names: tuple[str, ...]) -> np.ndarray:
        """A view (1,) of some fields of a record, to be set at once."""
        key = name, names
        if key not in self._fields:
            self._fields[key] = self.record(name, dtype)[list(names)]
        return self._fields[key]

    def buffer(self, name: str, count: int, dtype: Any) -> np.ndarray:
        """An array of at least `count` elements, with arbitrary contents."""
        held = self._buffers.get(name)
        if held is None or len(held) < count:
            held = self._buffers[name] = np.empty(count * 5 // 4 + 64, dtype)
            self._addresses[name] = address(held)
        return held

    def place(self, name: str, count: int, dtype: Any) -> int:
        """The address of `buffer(name, count, dtype)`."""
        self.buffer(name, count, dtype)
        return self._addresses[name]

    def launch(self, kernel: str, record: str) -> None:
        """Run a kernel on a record."""
        key = kernel, record
        if key not in self._launches:
            self._launches[key] = Prepared(
                device.record(kernels()[kernel], 1, [address(self._records[record])])
            )
        self._launches[key]()


workspace = Workspace()
