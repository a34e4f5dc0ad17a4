"""A shape model made ready for the renderer: matrices, faces, edges, rings."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
import warp as wp

from vig.likelihood.kernels.layout import RowLayout
from vig.likelihood.kernels.load import likelihood_kernels
from vig.scene import ShapeModel, point_layout
from vig.scene.light import L_COUNT
from vig_renderer.device import warp_array


class Geometry:
    """A shape model on one device, in one precision.

    Attributes:
        layout: Blocks of a point: latents, then framing.
        rows: Columns of a row of derivatives.
        positions: (K + 1, V * 3) mean and components: (1, coefficients) @ positions are the vertices.
        faces, edges, ring_start, ring: (F, 3), (E, 5), (V + 1,), (R, 3) int32, see `edges_of`, `rings_of`.
        basis: (V, 3, padded K) the components again, one row per vertex and axis.
        shadowed: Whether there is a transfer: what self-shadowing and interreflection add to the lobes
            A_l Y_lm of each vertex, see `ObjectClass.transfer`.
        transfer_mean, transfer_by_shape: (V, 9) of the mean shape and (V, 9, padded K) per component.
        reflectance: (V,) by which irradiance is multiplied, see `ObjectClass.reflectance`.
        kept: Passes and the like that may be used again for as long as the geometry lives.
    """

    def __init__(
        self,
        model: ShapeModel,
        dtype: torch.dtype = torch.float32,
        device: str = "cpu",
        transfer: np.ndarray | None = None,
        reflectance: np.ndarray | None = None,
    ):
        if model.modes < 1:
            raise ValueError("the renderer needs a shape model with one component or more; got none")
        self.model, self.dtype, self.device = model, dtype, device
        self.layout, self.rows = point_layout(model.modes), RowLayout(model.modes)
        stack = np.concatenate([model.mean[None], model.basis]).astype(np.float64)
        self.positions = torch.from_numpy(stack.reshape(len(stack), -1)).to(device, dtype).contiguous()
        padded = np.zeros((len(model.mean), 3, self.rows.shape))
        padded[:, :, : model.modes] = model.basis.transpose(1, 2, 0)
        self.basis = torch.from_numpy(padded).to(device, dtype)
        self.shadowed = transfer is not None
        if transfer is None:
            transfer = np.zeros((model.modes + 1, 1, L_COUNT))  # read by nobody
        elif transfer.shape != (expected := (model.modes + 1, len(model.mean), L_COUNT)):
            raise ValueError(f"transfer must be {expected} like the shape model; got {transfer.shape}")
        by_shape = np.zeros((*transfer.shape[1:], self.rows.shape))
        by_shape[:, :, : model.modes] = transfer[1:].transpose(1, 2, 0)
        self.transfer_mean = torch.from_numpy(transfer[0]).to(device, dtype).contiguous()
        self.transfer_by_shape = torch.from_numpy(by_shape).to(device, dtype)
        faces = np.ascontiguousarray(model.faces, np.int32)
        start, ring = rings_of(faces, len(model.mean))
        self.faces, self.edges, self.ring_start, self.ring = (
            torch.from_numpy(table).to(device) for table in (faces, edges_of(faces), start, ring)
        )
        known = np.ones(len(model.mean)) if reflectance is None else reflectance
        if known.shape != (len(model.mean),):
            raise ValueError(f"reflectance must be ({len(model.mean)},); got {known.shape}")
        self.reflectance = torch.from_numpy(known).to(device, dtype).contiguous()
        self.reflectance_wp = warp_array(self.reflectance, wp.dtype_from_torch(dtype))
        types = likelihood_kernels(dtype, model.modes, "gaussian")
        self.basis_wp = warp_array(self.basis, types.shape_row)
        self.transfer_mean_wp = warp_array(self.transfer_mean, types.lobe_vector)
        self.transfer_by_shape_wp = warp_array(self.transfer_by_shape, types.shape_row)
        self.faces_wp, self.edges_wp = warp_array(self.faces, wp.int32), warp_array(self.edges, wp.int32)
        self.ring_start_wp = warp_array(self.ring_start, wp.int32)
        self.ring_wp = warp_array(self.ring, wp.int32)
        self.kept: dict[str, list[Any]] = {}

    @property
    def vertex_count(self) -> int:
        """V."""
        return len(self.model.mean)


def edges_of(faces: np.ndarray) -> np.ndarray:
    """Edges of a triangle mesh: (E, 5) int32 of vertex a, vertex b, face, face beyond, corner beyond.

    `face` holds the edge as a to b; the face beyond holds it as b to a, `corner beyond` being that face's
    third vertex; both are -1 at a border. Edges of more than two faces are listed once per pair.
    """
    a, b, opposite = (np.roll(faces, -i, axis=1).reshape(-1).astype(np.int64) for i in range(3))
    size = int(faces.max(initial=0)) + 1
    # A directed edge as one number; its twin has the corners exchanged.
    here, there = _Grouped(a * size + b), _Grouped(b * size + a)
    reverse, count = here.find(there.keys)
    beyond = here.order[(reverse + np.minimum(here.rank, count - 1)).clip(0)]
    face, across = beyond // 3, opposite[beyond]
    face[count == 0] = across[count == 0] = -1
    rows = np.stack([a, b, np.arange(len(a)) // 3, face, across], axis=1)
    # Of twins the one with a < b is listed; an edge at a border has no twin.
    listed = np.lexsort((here.rank, here.first))
    listed = listed[((count == 0) | (a < b))[listed]]
    edges: np.ndarray = rows[listed].astype(np.int32)
    return edges


def rings_of(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Neighbours of each of `count` vertices: start (count + 1,) and ring (R, 3), both int32.

    Rows start[v] to start[v + 1] are (neighbour, next, previous): faces (v, neighbour, next) and (v,
    previous, neighbour). Where there is no such face, v itself stands for the missing corner, so that the
    sum of cross(neighbour - v, next - v) is the area-weighted normal of any mesh, and its derivative with
    respect to a neighbour is cross(next - previous, .), whether or not the faces close round v.
    """
    at, neighbour, following = (np.roll(faces, -i, axis=1).reshape(-1).astype(np.int64) for i in range(3))
    leaving, arriving = _Grouped(at * count + neighbour), _Grouped(at * count + following)
    # The last of the faces that arrive at a neighbour goes with the first that leaves from it, and so on.
    arrival, arrivals = arriving.find(leaving.keys)
    matched = leaving.rank < arrivals
    last = arriving.order[np.where(matched, arrival + arrivals - 1 - leaving.rank, 0)]
    previous = np.where(matched, neighbour[last], at) if len(at) else at
    _, departures = leaving.find(arriving.keys)
    _, arrived = arriving.find(arriving.keys)
    left = np.flatnonzero(arriving.rank < arrived - departures)
    left = left[np.lexsort((arriving.rank[left], arriving.first[left]))]
    rows = np.concatenate(
        [
            np.stack([neighbour, following, previous], axis=1),
            np.stack([following[left], at[left], neighbour[left]], axis=1),
        ]
    )
    of = np.concatenate([at, at[left]])
    start = np.concatenate([[0], np.bincount(of, minlength=count).cumsum()])
    return start.astype(np.int32), rows[np.argsort(of, kind="stable")].astype(np.int32)


class _Grouped:
    """Keys (N,), and of each the index of the first like it and its rank among those, in their order."""

    def __init__(self, keys: np.ndarray):
        self.keys = keys
        self.order = np.argsort(keys, kind="stable")
        self._sorted = keys[self.order]
        place, _ = self.find(keys)
        self.rank = np.empty(len(keys), np.int64)
        self.rank[self.order] = np.arange(len(keys)) - place[self.order]
        self.first = self.order[place]

    def find(self, keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where in `order` those like each of `keys` begin, and how many they are."""
        begin = np.searchsorted(self._sorted, keys, "left")
        return begin, np.searchsorted(self._sorted, keys, "right") - begin
