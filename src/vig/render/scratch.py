"""Tensors kept from call to call, with Warp's views of them: a fit's loop allocates little."""

from __future__ import annotations

import threading
from typing import Any

import torch
import warp as wp

from vig.render.device import warp_array


class Scratch:
    """Named tensors of fixed shape on one device; what they hold is overwritten by the next call."""

    def __init__(self, device: str):
        self.device = device
        self._kept: dict[str, tuple[torch.Tensor, wp.array]] = {}

    def get(
        self, name: str, shape: tuple[int, ...], dtype: torch.dtype, kind: Any
    ) -> tuple[torch.Tensor, wp.array]:
        """The tensor of that name, made at first use, and its view as an array of `kind`."""
        kept = self._kept.get(name)
        if kept is None or kept[0].shape != shape or kept[0].dtype != dtype:
            tensor = torch.empty(shape, dtype=dtype, device=self.device)
            kept = self._kept[name] = tensor, warp_array(tensor, kind)
        return kept

    def put(self, name: str, value: torch.Tensor, dtype: torch.dtype, kind: Any) -> wp.array:
        """Copy a tensor in, converted to `dtype`; returns the view."""
        tensor, view = self.get(name, tuple(value.shape), dtype, kind)
        tensor.copy_(value)
        return view


class ScratchPool:
    """One `Scratch` per thread and key, so that threads do not write into each other's."""

    def __init__(self, device: str):
        self._device, self._local = device, threading.local()

    def of(self, *key: int) -> Scratch:
        """The calling thread's scratch for a key, such as batch size and image size."""
        pool = self._local.__dict__.setdefault("pool", {})
        if key not in pool:
            pool[key] = Scratch(self._device)
        return pool[key]
