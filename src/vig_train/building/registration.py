"""Non-rigid registration: a template's vertices carried onto another surface of the same kind of thing.

The template moves with nodes spread over its surface, each of which carries an affine map (embedded
deformation, Sumner et al. 2007). The objective is that of non-rigid ICP (Amberg et al. 2007),

    sum_i w_i [ (n_i . (x_i - c_i))^2 + s |x_i - c_i|^2 ] + b sum_j v_j |x_i(j) - y_j|^2
        + alpha sum_ab |(X_a - X_b) G_ab|^2,

by Gauss-Newton: pairs are found anew in each step, both ways, from few stiff nodes to many soft ones.
Distances to planes let the surface slide: smoothness alone decides where along it a vertex comes to lie.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from vig_train.building.surface import SurfaceSample, vertex_areas
from vig_world.mesh import face_edges, vertex_normals


@dataclass(frozen=True)
class RegistrationStage:
    """A stage of registration.

    Attributes:
        nodes: Nodes of the deformation graph; 1 for one affine map.
        stiffness: alpha, from first to last step.
        reach: Distance at which a pair counts a quarter, in sizes, from first to last step.
        steps: Gauss-Newton steps.
        reverse_weight: b, the weight of distances from the target to the template.
        free_sliding: Whether vertices slide along planes freely; else each is drawn to its projection,
            coordinate by coordinate, which is several times quicker where nodes are many.
    """

    nodes: int
    stiffness: tuple[float, float]
    reach: tuple[float, float]
    steps: int
    reverse_weight: float
    free_sliding: bool = True


STAGES = (
    RegistrationStage(1, (1.0, 1.0), (0.5, 0.3), 8, 0.5),
    RegistrationStage(60, (0.03, 0.0005), (0.3, 0.2), 10, 0.5),
    RegistrationStage(250, (0.005, 0.0005), (0.2, 0.1), 8, 0.4),
    RegistrationStage(900, (0.01, 0.001), (0.1, 0.05), 6, 0.3, free_sliding=False),
)
TANGENTIAL_WEIGHT = 0.03  # s, the weight of distances along the surface over that of distances to it
NORMAL_WEIGHT = 0.05
"""Sizes of the object for which a difference of normals of length one counts in nearest-point search."""


@dataclass(frozen=True)
class DeformationGraph:
    """Nodes of a template, and how they move its vertices (embedded deformation).

    Attributes:
        skinning: (V, 4G) sparse; times maps (4G, 3) it gives vertices (V, 3).
        smoothness: (E, 4G) sparse; times maps it gives differences between neighbouring nodes.
        identity: (4G, 3) maps that leave the template as it is.
    """

    skinning: sp.csr_matrix
    smoothness: sp.csr_matrix
    identity: np.ndarray

    @staticmethod
    def of(vertices: np.ndarray, faces: np.ndarray, count: int) -> "DeformationGraph":
        """Make a graph of `count` nodes, far from each other along the surface."""
        chosen, distance = spread_nodes(vertices, edge_graph(vertices, faces), min(count, len(vertices)))
        # Four nodes move a vertex.
        nodes, influences = vertices[chosen], min(4, len(chosen))
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
        skinning = sp.csr_matrix((values, (rows, columns)), (len(vertices), 4 * len(chosen)))
        identity = np.concatenate([np.tile(np.eye(3), (len(chosen), 1, 1)), nodes[:, None]], axis=1)
        return DeformationGraph(skinning, _differences(nodes, near[:influences]), identity.reshape(-1, 3))


def edge_graph(vertices: np.ndarray, faces: np.ndarray) -> sp.csr_matrix:
    """Return lengths (V, V) of a mesh's edges, and of joints to neighbours in space, for parts that touch."""
    # Vertices near in space to which a vertex is joined, so that parts that only touch move together.
    spatial_neighbours = 4
    _, near = cKDTree(vertices).query(vertices, spatial_neighbours + 1)
    beside = np.stack([np.repeat(np.arange(len(vertices)), spatial_neighbours), near[:, 1:].ravel()], axis=1)
    edges = face_edges(faces)
    pairs = np.sort(np.concatenate([edges, beside]), axis=1)
    # A joint counts three times its length in space, an edge of the mesh its own length.
    factor = np.repeat([1.0, 3.0], [len(edges), len(beside)])
    length = factor * np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1) + 1e-12
    pairs, first = np.unique(pairs, axis=0, return_index=True)  # an edge counts where both are
    return sp.csr_matrix((length[first], pairs.T), (len(vertices), len(vertices)))


def spread_nodes(vertices: np.ndarray, graph: sp.csr_matrix, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (G,) that are far from each other, and distances (G, V) from them along the surface."""
    chosen = [int(np.linalg.norm(vertices - vertices.mean(0), axis=1).argmax())]
    # More than 200 nodes are spread by distances in space, not along the surface, for speed.
    if count <= 200:
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
    """Return rows that compare the affine maps of nodes that share a vertex: the difference of their linear
    parts, times their distance, and of where they take the middle between them.
    """
    if len(nodes) == 1:
        return sp.csr_matrix((0, 4))
    pairs = np.concatenate([near[[i, j]].T for i in range(len(near)) for j in range(i)])
    a, b = np.unique(np.sort(pairs, axis=1), axis=0).T
    length, middle = np.linalg.norm(nodes[a] - nodes[b], axis=1), (nodes[a] + nodes[b]) / 2
    row_start = 4 * np.arange(len(a))
    rows, columns, values = [], [], []
    for node, sign in ((a, 1.0), (b, -1.0)):
        for axis in range(3):
            rows += [row_start + axis, row_start + 3]
            columns += [4 * node + axis] * 2
            values += [0.5 * sign * length, sign * (middle - nodes[node])[:, axis]]
        rows.append(row_start + 3)
        columns.append(4 * node + 3)
        values.append(np.full(len(a), sign))
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sp.csr_matrix(entries, (4 * len(a), 4 * len(nodes)))


@dataclass(frozen=True)
class _Correspondences:
    """Targets of the vertices.

    Attributes:
        normal: (V, 3) normal of the plane at the nearest point of the target.
        gap: (V, 3) from the vertex to that point.
        weight: (V,) weight of the plane's distance; times `TANGENTIAL_WEIGHT`, of the point's.
        pull: (V, 3) from the vertex to the mean of the target's points whose nearest vertex it is.
        strength: (V,) weight of the pull.
    """

    normal: np.ndarray
    gap: np.ndarray
    weight: np.ndarray
    pull: np.ndarray
    strength: np.ndarray

    def point_to_plane_step(
        self, rig: DeformationGraph, stiffness: float, smooth: sp.csc_matrix, maps: np.ndarray
    ) -> np.ndarray:
        """Return the change of maps (4G, 3) of a Gauss-Newton step, all coordinates at once."""
        blocks = self.weight[:, None, None] * self.normal[:, :, None] * self.normal[:, None, :]
        blocks += (TANGENTIAL_WEIGHT * self.weight + self.strength)[:, None, None] * np.eye(3)
        along = (self.weight * (self.gap * self.normal).sum(1))[:, None] * self.normal
        total = rig.skinning.shape[1]
        parts = {
            (i, j): rig.skinning.T @ sp.diags(blocks[:, i, j]) @ rig.skinning
            for i in range(3)
            for j in range(i, 3)
        }
        rows = [[parts[min(i, j), max(i, j)] for j in range(3)] for i in range(3)]
        # Unknowns are reordered from coordinate by coordinate to node by node: less fill-in of the factor.
        by_node = np.arange(3 * total).reshape(3, total).T.ravel()
        matrix = sp.bmat(rows, format="csc")[by_node][:, by_node]
        matrix = matrix + stiffness * sp.kron(smooth, sp.eye(3), format="csc")
        right = rig.skinning.T @ (along + self._towards_points()) - stiffness * (smooth @ maps)
        return _solve(matrix, right.ravel()).reshape(-1, 3)

    def projected_step(
        self, rig: DeformationGraph, stiffness: float, smooth: sp.csc_matrix, maps: np.ndarray
    ) -> np.ndarray:
        """Return the change of maps (4G, 3) that draws each vertex to its projection on the plane."""
        along = (self.weight * (self.gap * self.normal).sum(1))[:, None] * self.normal
        weight = (1 + TANGENTIAL_WEIGHT) * self.weight + self.strength
        matrix = rig.skinning.T @ sp.diags(weight) @ rig.skinning + stiffness * smooth
        return _solve(matrix, rig.skinning.T @ (along + self._towards_points()) - stiffness * (smooth @ maps))

    def _towards_points(self) -> np.ndarray:
        return (TANGENTIAL_WEIGHT * self.weight)[:, None] * self.gap + self.strength[:, None] * self.pull


def _solve(matrix: sp.spmatrix, right: np.ndarray) -> np.ndarray:
    """Solve a symmetric positive definite system."""
    damped = (matrix + 1e-9 * sp.eye(matrix.shape[0])).tocsc()
    factor = splu(damped, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return np.asarray(factor.solve(right))


class Registration:
    """Registers a template to surfaces; values of the template alone are computed once.

    Args:
        vertices: (V, 3) of the template.
        faces: (F, 3), counter-clockwise seen from outside.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        self.middle = (vertices.min(0) + vertices.max(0)) / 2
        self.size = float(np.ptp(vertices, axis=0).max())
        self.vertices, self.faces = (vertices - self.middle) / self.size, faces
        self.stages = [(level, DeformationGraph.of(self.vertices, faces, level.nodes)) for level in STAGES]
        area = vertex_areas(self.vertices, faces)
        self.area = area / area.sum()

    def onto(self, target: SurfaceSample) -> np.ndarray:
        """Return the template's vertices (V, 3) on a surface in its pose and of about its size."""
        scaled_target = SurfaceSample((target.points - self.middle) / self.size, target.normals)
        tree = cKDTree(scaled_target.features(NORMAL_WEIGHT))
        moved = self.vertices
        for level, rig in self.stages:
            smooth = (rig.smoothness.T @ rig.smoothness).tocsc()
            maps, base = rig.identity, moved - rig.skinning @ rig.identity
            for step in range(level.steps):
                share = step / max(1, level.steps - 1)
                stiffness, reach = (a ** (1 - share) * b**share for a, b in (level.stiffness, level.reach))
                pairs = self._pairs(moved, scaled_target, tree, reach, level.reverse_weight)
                solve = pairs.point_to_plane_step if level.free_sliding else pairs.projected_step
                maps = maps + solve(rig, stiffness, smooth, maps)
                moved = base + rig.skinning @ maps
        return moved * self.size + self.middle

    def _pairs(
        self, moved: np.ndarray, target: SurfaceSample, tree: cKDTree, reach: float, reverse_weight: float
    ) -> _Correspondences:
        """Pair vertices with the target's points, both ways.

        A pair at distance d, relative to the reach r, with cosine c >= 0 between its normals has the weight
        c / (1 + (d / r)^2)^2.
        """
        moved_surface = SurfaceSample(moved, vertex_normals(moved, self.faces))
        _, index = tree.query(moved_surface.features(NORMAL_WEIGHT))
        gap, normal = target.points[index] - moved, target.normals[index]
        agree = np.clip((normal * moved_surface.normals).sum(1), 0, 1)
        weight = self.area * agree / (1 + (gap**2).sum(1) / reach**2) ** 2
        # The nearest vertex of the template is searched for 6,000 points of the target.
        samples = target.some(6000)
        _, vertex = cKDTree(moved_surface.features(NORMAL_WEIGHT)).query(samples.features(NORMAL_WEIGHT))
        pull_vector = samples.points - moved[vertex]
        agree = np.clip((samples.normals * moved_surface.normals[vertex]).sum(1), 0, 1)
        trust = agree / (1 + (pull_vector**2).sum(1) / reach**2) ** 2 / len(samples.points)
        count = len(moved)
        total = np.bincount(vertex, trust, count)
        sums = np.stack(
            [np.bincount(vertex, trust * pull_vector[:, axis], count) for axis in range(3)], axis=1
        )
        return _Correspondences(
            normal, gap, weight, sums / np.maximum(total, 1e-12)[:, None], reverse_weight * total
        )
