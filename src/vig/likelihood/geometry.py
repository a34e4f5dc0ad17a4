"""A shape model made ready for evaluation: components, faces, edges, rings."""

import numpy as np
import numpy.typing as npt

from vig.scene import ShapeModel, point_layout
from vig.scene.light import L_COUNT
from vig_native import engine


class Geometry:
    """A shape model in one precision.

    Attributes:
        layout: Blocks of a point: latents, then framing.
        native: The same geometry for the native library.
        positions: (K + 1, V, 3) mean and components; (1, coefficients) times these are the vertices.
        faces, edges: (F, 3), (E, 5) int32, see `edges_of`.
        rings: (V + 1,), (R, 3) int32, see `rings_of`.
        transfer: (K + 1, V, 9) increments of self-shadowing and interreflection to the lobes A_l Y_lm of each
            vertex, of the mean shape and per component, see `ObjectClass.transfer`; None for none.
        reflectance: (V,) by which irradiance is multiplied, see `ObjectClass.reflectance`.
    """

    def __init__(
        self,
        model: ShapeModel,
        dtype: npt.DTypeLike = np.float32,
        transfer: np.ndarray | None = None,
        reflectance: np.ndarray | None = None,
    ):
        if model.modes < 1:
            raise ValueError("the renderer needs a shape model with one component or more; got none")
        real = np.dtype(dtype)
        if real not in (np.float32, np.float64):
            raise ValueError(f"the renderer works in float32 or float64; got {dtype}")
        self.model, self.dtype, self.layout = model, real, point_layout(model.modes)
        count = len(model.mean)
        if transfer is not None and transfer.shape != (expected := (model.modes + 1, count, L_COUNT)):
            raise ValueError(f"transfer must be {expected} like the shape model; got {transfer.shape}")
        reflectance = np.ones(count) if reflectance is None else reflectance
        if reflectance.shape != (count,):
            raise ValueError(f"reflectance must be ({count},); got {reflectance.shape}")
        self.positions = np.concatenate([model.mean[None], model.basis]).astype(real)
        self.transfer = None if transfer is None else np.ascontiguousarray(transfer, real)
        self.reflectance = np.ascontiguousarray(reflectance, real)
        self.faces = np.ascontiguousarray(model.faces, np.int32)
        self.edges, self.rings = edges_of(self.faces), rings_of(self.faces, count)
        blocks = [self.layout.at(name) for name in ("azimuth", "elevation", "albedo", "light", "framing")]
        self.native = engine.geometry(
            [self.layout.size, self.layout.at("shape"), model.modes, *blocks],
            self.positions,
            self.faces,
            self.edges,
            *self.rings,
            self.reflectance,
            self.transfer,
        )

    @property
    def vertex_count(self) -> int:
        """Return V, the number of vertices."""
        return len(self.model.mean)


def edges_of(faces: np.ndarray) -> np.ndarray:
    """Return edges of a triangle mesh: (E, 5) int32 of vertex a, vertex b, face, face beyond, corner beyond.

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
    # The one of two twins with a < b is listed; an edge at a border has no twin.
    listed = np.lexsort((here.rank, here.first))
    listed = listed[((count == 0) | (a < b))[listed]]
    edges: np.ndarray = rows[listed].astype(np.int32)
    return edges


def rings_of(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return neighbours of each of `count` vertices: start (count + 1,) and ring (R, 3), both int32.

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
        """Return the start in `order` of the keys equal to each of `keys`, and their number."""
        begin = np.searchsorted(self._sorted, keys, "left")
        return begin, np.searchsorted(self._sorted, keys, "right") - begin
