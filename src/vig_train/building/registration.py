"""Non-rigid registration: a template's vertices carried onto another surface of the same kind of thing.

The template moves with nodes spread over its surface, each of which carries an affine map (embedded
deformation, Sumner et al. 2007). What is minimised is that of non-rigid ICP (Amberg et al. 2007),

    sum_i w_i [ (n_i . (x_i - c_i))^2 + s |x_i - c_i|^2 ] + b sum_j v_j |x_i(j) - y_j|^2
        + alpha sum_ab |(X_a - X_b) G_ab|^2,

by Gauss-Newton: pairs are found anew in each step, both ways, from few stiff nodes to many soft ones.
Distances to planes let the surface slide: smoothness alone decides where along it a vertex comes to lie.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from vig_train.building.surface import Surface, edges_of, vertex_areas
from vig_world.mesh import vertex_normals


@dataclass(frozen=True)
class Level:
    """A stage of registration.

    Attributes:
        nodes: Of the template; 1 for one affine map.
        stiffness: alpha, from first to last step.
        reach: Distance at which a pair counts a quarter, in sizes, from first to last step.
        steps: Of Gauss-Newton.
        back: b, the weight of the way from the target to the template.
        slides: Whether vertices slide along planes freely; else each is drawn to its projection, coordinate
            by coordinate, which is several times quicker where nodes are many.
    """

    nodes: int
    stiffness: tuple[float, float]
    reach: tuple[float, float]
    steps: int
    back: float
    slides: bool = True


LEVELS = (
    Level(1, (1.0, 1.0), (0.5, 0.3), 8, 0.5),
    Level(60, (0.03, 0.0005), (0.3, 0.2), 10, 0.5),
    Level(250, (0.005, 0.0005), (0.2, 0.1), 8, 0.4),
    Level(900, (0.01, 0.001), (0.1, 0.05), 6, 0.3, slides=False),
)
SLIDING = 0.03
"""s, the weight of distances along the surface over that of distances to it."""
DIRECTION = 0.05
"""Sizes of the object that a difference of normals of one counts as, when nearest points are found."""
SAMPLES = 6000
"""Of the target's points that look for the template."""
INFLUENCES = 4
"""Nodes that move a vertex."""
NEIGHBOURS, DETOUR = 4, 3.0
"""Vertices near in space to which a vertex is joined, and how much longer that way counts than an edge."""
ALONG = 200
"""With more nodes than this they are spread by distances in space, else by those along the surface."""


@dataclass(frozen=True)
class Rig:
    """Nodes of a template, and how they move its vertices.

    Attributes:
        moves: (V, 4G) sparse; times maps (4G, 3) it gives vertices (V, 3).
        differs: (E, 4G) sparse; times maps it gives differences between neighbouring nodes.
        rest: (4G, 3) maps that leave the template as it is.
    """

    moves: sp.csr_matrix
    differs: sp.csr_matrix
    rest: np.ndarray

    @staticmethod
    def of(vertices: np.ndarray, faces: np.ndarray, count: int) -> Rig:
        """So many nodes, far from each other along the surface."""
        chosen, distance = spread_nodes(vertices, edge_graph(vertices, faces), min(count, len(vertices)))
        nodes, influences = vertices[chosen], min(INFLUENCES, len(chosen))
        near = np.argsort(distance, axis=0, kind="stable")[: influences + 1]
        far = np.take_along_axis(distance, near, axis=0)
        edge = far[-1] if len(near) > influences else far[-1] + 1.0
        weight = np.clip(1 - far[:influences] / np.maximum(edge, 1e-9), 1e-4, None) ** 2
        weight /= weight.sum(0)
        node = near[:influences].T
        local = np.concatenate([vertices[:, None] - nodes[node], np.ones((*node.shape, 1))], axis=2)
        rows = np.repeat(np.arange(len(vertices)), influences * 4)
        columns = (4 * node[..., None] + np.arange(4)).ravel()
        values = (weight.T[..., None] * local).ravel()
        moves = sp.csr_matrix((values, (rows, columns)), (len(vertices), 4 * len(chosen)))
        rest = np.concatenate([np.tile(np.eye(3), (len(chosen), 1, 1)), nodes[:, None]], axis=1)
        return Rig(moves, _differences(nodes, near[:influences]), rest.reshape(-1, 3))


def edge_graph(vertices: np.ndarray, faces: np.ndarray) -> sp.csr_matrix:
    """Lengths (V, V) of a mesh's edges, and of ways to neighbours in space, which join parts that touch."""
    _, near = cKDTree(vertices).query(vertices, NEIGHBOURS + 1)
    beside = np.stack([np.repeat(np.arange(len(vertices)), NEIGHBOURS), near[:, 1:].ravel()], axis=1)
    lengths: dict[tuple[int, int], float] = {}
    for pairs, factor in ((beside, DETOUR), (edges_of(faces), 1.0)):  # an edge counts where both are
        length = factor * np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1) + 1e-12
        ordered = np.sort(pairs, axis=1)
        lengths |= dict(zip(map(tuple, ordered.tolist()), length.tolist(), strict=True))
    rows, columns = np.array(list(lengths)).T
    shape = (len(vertices), len(vertices))
    return sp.csr_matrix((np.array(list(lengths.values())), (rows, columns)), shape)


def spread_nodes(vertices: np.ndarray, graph: sp.csr_matrix, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (G,) that are far from each other, and distances (G, V) from them along the surface."""
    chosen = [int(np.linalg.norm(vertices - vertices.mean(0), axis=1).argmax())]
    if count <= ALONG:
        rows = [dijkstra(graph, directed=False, indices=chosen[0])]
        while len(chosen) < count:
            least = np.min(rows, axis=0)
            chosen.append(int(np.where(np.isfinite(least), least, -1).argmax()))
            rows.append(dijkstra(graph, directed=False, indices=chosen[-1]))
        distance = np.array(rows)
    else:
        least = np.linalg.norm(vertices - vertices[chosen[0]], axis=1)
        while len(chosen) < count:
            chosen.append(int(least.argmax()))
            least = np.minimum(least, np.linalg.norm(vertices - vertices[chosen[-1]], axis=1))
        distance = dijkstra(graph, directed=False, indices=chosen, limit=6.0 * least.max())
    finite = np.isfinite(distance)
    return np.array(chosen), np.where(finite, distance, 1e3 * distance[finite].max())


def _differences(nodes: np.ndarray, near: np.ndarray) -> sp.csr_matrix:
    """Rows that compare the maps of nodes which move one vertex together: their linear parts, and where they
    take the middle between them.
    """
    if len(nodes) == 1:
        return sp.csr_matrix((0, 4))
    pairs = np.concatenate([near[[i, j]].T for i in range(len(near)) for j in range(i)])
    a, b = np.unique(np.sort(pairs, axis=1), axis=0).T
    length, middle = np.linalg.norm(nodes[a] - nodes[b], axis=1), (nodes[a] + nodes[b]) / 2
    first = 4 * np.arange(len(a))
    rows, columns, values = [], [], []
    for node, sign in ((a, 1.0), (b, -1.0)):
        for axis in range(3):
            rows += [first + axis, first + 3]
            columns += [4 * node + axis] * 2
            values += [0.5 * sign * length, sign * (middle - nodes[node])[:, axis]]
        rows.append(first + 3)
        columns.append(4 * node + 3)
        values.append(np.full(len(a), sign))
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sp.csr_matrix(entries, (4 * len(a), 4 * len(nodes)))


@dataclass(frozen=True)
class _Pairs:
    """What each vertex is drawn to.

    Attributes:
        normal: (V, 3) of the plane at the nearest point of the target.
        gap: (V, 3) from the vertex to that point.
        weight: (V,) of the distance to the plane; times `SLIDING` of that to the point.
        pull: (V, 3) from the vertex to the mean of the target's points that are nearest to it.
        strength: (V,) weight of that.
    """

    normal: np.ndarray
    gap: np.ndarray
    weight: np.ndarray
    pull: np.ndarray
    strength: np.ndarray

    def slid(self, rig: Rig, stiffness: float, smooth: sp.csc_matrix, maps: np.ndarray) -> np.ndarray:
        """The change of maps (4G, 3) of a Gauss-Newton step, all coordinates at once."""
        blocks = self.weight[:, None, None] * self.normal[:, :, None] * self.normal[:, None, :]
        blocks += (SLIDING * self.weight + self.strength)[:, None, None] * np.eye(3)
        along = (self.weight * (self.gap * self.normal).sum(1))[:, None] * self.normal
        total = rig.moves.shape[1]
        parts = {
            (i, j): rig.moves.T @ sp.diags(blocks[:, i, j]) @ rig.moves for i in range(3) for j in range(i, 3)
        }
        rows = [[parts[min(i, j), max(i, j)] for j in range(3)] for i in range(3)]
        by_node = np.arange(3 * total).reshape(3, total).T.ravel()  # from coordinate by coordinate
        matrix = sp.bmat(rows, format="csc")[by_node][:, by_node]
        matrix = matrix + stiffness * sp.kron(smooth, sp.eye(3), format="csc")
        right = rig.moves.T @ (along + self._towards_points()) - stiffness * (smooth @ maps)
        return _solved(matrix, right.ravel()).reshape(-1, 3)

    def projected(self, rig: Rig, stiffness: float, smooth: sp.csc_matrix, maps: np.ndarray) -> np.ndarray:
        """The change of maps (4G, 3) that draws each vertex to its projection on the plane."""
        along = (self.weight * (self.gap * self.normal).sum(1))[:, None] * self.normal
        weight = (1 + SLIDING) * self.weight + self.strength
        matrix = rig.moves.T @ sp.diags(weight) @ rig.moves + stiffness * smooth
        return _solved(matrix, rig.moves.T @ (along + self._towards_points()) - stiffness * (smooth @ maps))

    def _towards_points(self) -> np.ndarray:
        return (SLIDING * self.weight)[:, None] * self.gap + self.strength[:, None] * self.pull


def _solved(matrix: sp.spmatrix, right: np.ndarray) -> np.ndarray:
    """Solve a symmetric positive definite system."""
    damped = (matrix + 1e-9 * sp.eye(matrix.shape[0])).tocsc()
    factor = splu(damped, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return np.asarray(factor.solve(right))


class Registration:
    """A template that is carried onto surfaces; what only depends on it is made once.

    Args:
        vertices: (V, 3) of the template.
        faces: (F, 3), counter-clockwise seen from outside.
        levels: Stages, from stiff to soft.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, levels: tuple[Level, ...] = LEVELS):
        self.middle = (vertices.min(0) + vertices.max(0)) / 2
        self.size = float(np.ptp(vertices, axis=0).max())
        self.vertices, self.faces = (vertices - self.middle) / self.size, faces
        self.stages = [(level, Rig.of(self.vertices, faces, level.nodes)) for level in levels]
        area = vertex_areas(self.vertices, faces)
        self.area = area / area.sum()

    def onto(self, target: Surface) -> np.ndarray:
        """Vertices (V, 3) on a surface in the template's pose and of about its size."""
        aim = Surface((target.points - self.middle) / self.size, target.normals)
        tree = cKDTree(aim.features(DIRECTION))
        now = self.vertices
        for level, rig in self.stages:
            smooth = (rig.differs.T @ rig.differs).tocsc()
            maps, before = rig.rest, now - rig.moves @ rig.rest
            for step in range(level.steps):
                share = step / max(1, level.steps - 1)
                stiffness, reach = (a ** (1 - share) * b**share for a, b in (level.stiffness, level.reach))
                pairs = self._pairs(now, aim, tree, reach, level.back)
                solve = pairs.slid if level.slides else pairs.projected
                maps = maps + solve(rig, stiffness, smooth, maps)
                now = before + rig.moves @ maps
        return now * self.size + self.middle

    def _pairs(self, now: np.ndarray, aim: Surface, tree: cKDTree, reach: float, back: float) -> _Pairs:
        """Pair vertices with the target's points, both ways; far ones and turned ones count little."""
        own = Surface(now, vertex_normals(now, self.faces))
        _, index = tree.query(own.features(DIRECTION))
        gap, normal = aim.points[index] - now, aim.normals[index]
        agree = np.clip((normal * own.normals).sum(1), 0, 1)
        weight = self.area * agree / (1 + (gap**2).sum(1) / reach**2) ** 2
        some = aim.some(SAMPLES)
        _, vertex = cKDTree(own.features(DIRECTION)).query(some.features(DIRECTION))
        away = some.points - now[vertex]
        agree = np.clip((some.normals * own.normals[vertex]).sum(1), 0, 1)
        trust = agree / (1 + (away**2).sum(1) / reach**2) ** 2 / len(some.points)
        count = len(now)
        total = np.bincount(vertex, trust, count)
        sums = np.stack([np.bincount(vertex, trust * away[:, axis], count) for axis in range(3)], axis=1)
        return _Pairs(normal, gap, weight, sums / np.maximum(total, 1e-12)[:, None], back * total)
