"""A shape model made ready for the renderer: matrices, faces, edges, rings."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
import warp as wp

from vig.likelihood.kernels.groups import RowLayout, kernel_types
from vig.renderer.device import warp_array
from vig.scene import ShapeModel, point_layout
from vig.scene.light import L_COUNT


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
        kept: Passes and the like that may be used again for as long as the geometry lives.
    """

    def __init__(
        self,
        model: ShapeModel,
        dtype: torch.dtype = torch.float32,
        device: str = "cpu",
        transfer: np.ndarray | None = None,
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
        types = kernel_types(dtype, model.modes)
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
    directed: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for face, corners in enumerate(faces.tolist()):
        for i in range(3):
            directed.setdefault((corners[i], corners[(i + 1) % 3]), []).append((face, corners[(i + 2) % 3]))
    rows = []
    for (a, b), here in directed.items():
        beyond = directed.get((b, a), [])
        for index, (face, _) in enumerate(here):
            if not beyond:
                rows.append((a, b, face, -1, -1))
            elif a < b:
                rows.append((a, b, face, *beyond[min(index, len(beyond) - 1)]))
    return np.array(rows, np.int32).reshape(-1, 5)


def rings_of(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Neighbours of each of `count` vertices: start (count + 1,) and ring (R, 3), both int32.

    Rows start[v] to start[v + 1] are (neighbour, next, previous): faces (v, neighbour, next) and (v,
    previous, neighbour). Where there is no such face, v itself stands for the missing corner, so that the
    sum of cross(neighbour - v, next - v) is the area-weighted normal of any mesh, and its derivative with
    respect to a neighbour is cross(next - previous, .), whether or not the faces close round v.
    """
    following: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for a, b, c in faces.tolist():
        following[a].append((b, c))
        following[b].append((c, a))
        following[c].append((a, b))
    start, rows = [0], []
    for vertex, pairs in enumerate(following):
        before: dict[int, list[int]] = {}
        for first, then in pairs:
            before.setdefault(then, []).append(first)
        for first, then in pairs:
            previous = before.get(first)
            rows.append((first, then, previous.pop() if previous else vertex))
        for then, left in before.items():
            rows += [(then, vertex, first) for first in left]
        start.append(len(rows))
    return np.array(start, np.int32), np.array(rows, np.int32).reshape(-1, 3)
