"""The native functions as kernels, and each thread's scratch memory."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from vig.renderer.device import Prepared, initialise
from vig_world.renderers.raster.encoding import encode_image
from vig_world.renderers.raster.fragments import collect_fragments
from vig_world.renderers.raster.records import address
from vig_world.renderers.raster.shading import shade_samples
from vig_world.renderers.raster.sweeping import strew_points, sweep_shadows
from vig_world.renderers.raster.target import light_target
from vig_world.renderers.raster.visibility import draw_faces

MODULE = "vig_synthesis_raster"


@functools.cache
def kernels() -> SimpleNamespace:
    """The kernels, compiled at first use; each takes the address of a record and runs on one thread."""
    initialise()

    @wp.kernel(module=MODULE)
    def draw(task: wp.uint64):
        draw_faces(task)

    @wp.kernel(module=MODULE)
    def collect(task: wp.uint64):
        collect_fragments(task)

    @wp.kernel(module=MODULE)
    def shade(task: wp.uint64):
        shade_samples(task)

    @wp.kernel(module=MODULE)
    def encode(task: wp.uint64):
        encode_image(task)

    @wp.kernel(module=MODULE)
    def strew(sweep: wp.uint64):
        strew_points(sweep)

    @wp.kernel(module=MODULE)
    def sweep(sweep: wp.uint64):
        sweep_shadows(sweep)

    @wp.kernel(module=MODULE)
    def light(target: wp.uint64):
        light_target(target)

    return SimpleNamespace(
        draw=draw, collect=collect, shade=shade, encode=encode, strew=strew, sweep=sweep, light=light
    )


class Workspace(threading.local):
    """What one thread needs again and again: records at fixed addresses, and buffers that only grow."""

    def __init__(self) -> None:
        self._records: dict[str, np.ndarray] = {}
        self._fields: dict[tuple[str, tuple[str, ...]], np.ndarray] = {}
        self._buffers: dict[str, np.ndarray] = {}
        self._addresses: dict[str, int] = {}
        self._launches: dict[tuple[str, str], Callable[[], object]] = {}

    def record(self, name: str, dtype: np.dtype) -> np.ndarray:
        """The record (1,) of that name, holding what it held."""
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
        """An array of `count` or more elements, holding anything."""
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
            command = wp.launch(
                getattr(kernels(), kernel),
                dim=1,
                inputs=[address(self._records[record])],
                device="cpu",
                record_cmd=True,
            )
            self._launches[key] = Prepared(command)
        self._launches[key]()


workspace = Workspace()
