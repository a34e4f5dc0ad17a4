"""The template of a class: one mesh, closed, of the fit's size, denser where the surface curves."""

import math

import numpy as np
import scipy.sparse as sp
import trimesh
from scipy import ndimage
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

from vig_train.building.surface import SurfaceSample, neighbour_mean, sample_points, vertex_areas
from vig_world.mesh import face_edges, vertex_normals

TEMPLATE_VERTICES = 2600  # vertices of a template, about
MAX_ROUNDS = 30  # rounds of Lloyd's algorithm; also the most rounds in which flawed clusters are split


def remesh(
    vertices: np.ndarray, faces: np.ndarray, count: int = TEMPLATE_VERTICES
) -> tuple[np.ndarray, np.ndarray]:
    """Return about so many vertices, evenly spread over a closed mesh (V, 3), (F, 3) in place and direction.

    The dual of a centroidal partition of the surface (Valette and Chassery 2004), in the six dimensions of
    points and normals (Levy and Bonneel 2013). Closed as the mesh is.
    """
    size = float(np.ptp(vertices, axis=0).max())
    # 40 points of the dense surface for each vertex of the template.
    area_per_point = float(vertex_areas(vertices, faces).sum()) / (40 * count)
    points, corners = split_long_edges(vertices, faces, 1.5 * math.sqrt(area_per_point))
    dense = trimesh.Trimesh(points, corners, process=False)
    edges = face_edges(corners)
    normals, smooth = vertex_normals(points, corners), neighbour_mean(corners, len(points))
    for _ in range(4):
        normals = smooth @ normals
    # A difference of normals of length one counts as .03 sizes, which separates the sides of a wall.
    features = np.concatenate([points, 0.03 * size * normals], axis=1)
    areas = vertex_areas(points, corners)
    # Normals weigh .1 where areas decide the density of vertices, so that curved places grow.
    curvature = _vertex_areas_in(
        np.concatenate([points, 0.1 * size * normals], axis=1), corners
    ) / areas.clip(1e-12)
    for _ in range(40):
        curvature = smooth @ curvature
    # Vertices are at most three times as dense where the surface curves as on flat places.
    areas = areas * curvature.clip(1, 3.0)
    for attempt in range(3):
        cluster = _partition(features, areas, edges, count, attempt)
        for _ in range(MAX_ROUNDS):
            mesh = _dual(points, corners, areas, cluster)
            flawed = np.union1d(_non_manifold_vertices(mesh), _clusters_not_discs(cluster, corners))
            if not len(flawed):
                break
            cluster = _split_clusters(cluster, flawed, points, edges)
        same_topology = mesh.euler_number == dense.euler_number and mesh.body_count == dense.body_count
        if not len(flawed) and same_topology:
            return np.asarray(mesh.vertices), np.asarray(mesh.faces)
    raise ValueError("no closed mesh of that size was found")


def split_long_edges(
    vertices: np.ndarray, faces: np.ndarray, longest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the same surface, with edges that are too long cut in two until none is; closed as before."""
    while True:
        low, high = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1).T.astype(np.int64)
        numbered, edge = np.unique(low * len(vertices) + high, return_inverse=True)
        edges = np.stack(np.divmod(numbered, len(vertices)), axis=1)
        too_long = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1) > longest
        if not too_long.any():
            return vertices, faces
        middle = np.where(too_long, len(vertices) + np.cumsum(too_long) - 1, -1)[edge.reshape(-1, 3)]
        vertices = np.concatenate([vertices, vertices[edges[too_long]].mean(1)])
        parts = []
        cuts_of_face = (middle >= 0).sum(1)
        parts.append(faces[cuts_of_face == 0])
        for cuts, odd_one in ((1, middle >= 0), (2, middle < 0)):
            # Corners are rotated so that the side that differs from the other two comes first.
            chosen = cuts_of_face == cuts
            turn = (odd_one[chosen].argmax(1)[:, None] + np.arange(3)) % 3
            a, b, c = np.take_along_axis(faces[chosen], turn, axis=1).T
            ab, bc, ca = np.take_along_axis(middle[chosen], turn, axis=1).T
            if cuts == 1:
                parts += [np.stack(triangle, axis=1) for triangle in ((a, ab, c), (ab, b, c))]
            else:
                parts += [np.stack(triangle, axis=1) for triangle in ((a, b, bc), (a, bc, ca), (ca, bc, c))]
        a, b, c = faces[cuts_of_face == 3].T
        ab, bc, ca = middle[cuts_of_face == 3].T
        parts += [
            np.stack(triangle, axis=1) for triangle in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        ]
        faces = np.concatenate(parts)


def _vertex_areas_in(features: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return areas round each vertex, in the space of the features (N, D): (N,)."""
    side_a, side_b = (
        features[faces[:, 1]] - features[faces[:, 0]],
        features[faces[:, 2]] - features[faces[:, 0]],
    )
    gram = (side_a**2).sum(1) * (side_b**2).sum(1) - (side_a * side_b).sum(1) ** 2
    return np.asarray(np.bincount(faces.ravel(), np.repeat(np.sqrt(gram.clip(0)), 3), len(features)) / 6)


def _non_manifold_vertices(mesh: trimesh.Trimesh) -> np.ndarray:
    """Return vertices where a mesh is no manifold: at edges without exactly two faces, or where two fans of
    faces touch at a vertex alone.
    """
    ends = mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)  # the two of each side of each face
    corner = np.arange(mesh.faces.size).reshape(-1, 3)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    turned = ends[:, 0] > ends[:, 1]
    ends[turned], corner[turned] = ends[turned, ::-1], corner[turned, ::-1]
    edges, edge, sides = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    # Corners of neighbouring faces at one vertex belong to one fan.
    order = np.argsort(edge.ravel(), kind="stable")
    pairs = corner[order[sides[edge.ravel()[order]] == 2]].reshape(-1, 2, 2).transpose(0, 2, 1).reshape(-1, 2)
    graph = sp.csr_matrix((np.ones(len(pairs)), pairs.T), (mesh.faces.size,) * 2)
    _, fan = connected_components(graph, directed=False)
    of_vertex = np.unique(np.stack([mesh.faces.ravel(), fan], axis=1), axis=0)[:, 0]
    touching = np.flatnonzero(np.bincount(of_vertex, minlength=len(mesh.vertices)) > 1)
    return np.union1d(edges[sides != 2].ravel(), touching)


def _clusters_not_discs(owner: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return clusters that are no discs: whose Euler number is not one, such as a ring round a neck."""
    inner = [(faces[:, [k, (k + 1) % 3]], 0.5) for k in range(3)] + [(faces, -1.0)]
    euler = np.bincount(owner).astype(float)
    for corners, weight in inner:
        mine = owner[corners]
        euler -= weight * np.bincount(mine[(mine == mine[:, :1]).all(1), 0], minlength=len(euler))
    return np.flatnonzero(euler != 1)


def _split_clusters(
    owner: np.ndarray, chosen: np.ndarray, points: np.ndarray, edges: np.ndarray
) -> np.ndarray:
    """Return clusters with the chosen ones cut in two, across their longest direction."""
    owner, count = owner.copy(), owner.max() + 1
    for number, cluster in enumerate(chosen):
        mine = np.flatnonzero(owner == cluster)
        off = points[mine] - points[mine].mean(0)
        along = off @ np.linalg.svd(off, full_matrices=False)[2][0]
        owner[mine[along > 0]] = count + number
    return _connected_clusters(owner, edges)


def _partition(
    features: np.ndarray, areas: np.ndarray, edges: np.ndarray, count: int, seed: int
) -> np.ndarray:
    """Return the cluster of each point (N,): Lloyd's algorithm, then each cluster in one piece."""
    rng = np.random.default_rng(seed)
    centres = features[rng.choice(len(features), count, replace=False, p=areas / areas.sum())]
    owner = np.zeros(len(features), int)
    for _ in range(MAX_ROUNDS):
        owner = cKDTree(centres).query(features)[1]
        weight = np.bincount(owner, areas, len(centres))
        centres = (
            np.stack([np.bincount(owner, areas * column, len(centres)) for column in features.T], axis=1)[
                weight > 0
            ]
            / weight[weight > 0, None]
        )
    return _connected_clusters(cKDTree(centres).query(features)[1], edges)


def _connected_clusters(owner: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return clusters, numbered anew, whose pieces but the largest went to a neighbouring cluster."""
    while True:
        inside = owner[edges[:, 0]] == owner[edges[:, 1]]
        graph = sp.csr_matrix((np.ones(inside.sum()), edges[inside].T), (len(owner),) * 2)
        _, piece = connected_components(graph, directed=False)
        sizes = np.bincount(piece)
        owner_of_piece = owner[np.unique(piece, return_index=True)[1]]
        order = np.lexsort((-sizes, owner_of_piece))
        largest = np.zeros(len(sizes), bool)
        largest[order[np.unique(owner_of_piece[order], return_index=True)[1]]] = True
        stray = ~largest[piece]
        if not stray.any():
            return np.unique(owner, return_inverse=True)[1]
        across = np.concatenate([edges, edges[:, ::-1]])
        across = across[stray[across[:, 0]] & ~stray[across[:, 1]]]
        if not len(across):
            return np.unique(owner, return_inverse=True)[1]
        owner = owner.copy()
        owner[across[:, 0]] = owner[across[:, 1]]


def _dual(points: np.ndarray, faces: np.ndarray, areas: np.ndarray, owner: np.ndarray) -> trimesh.Trimesh:
    """Return the mesh with a vertex for each cluster, a triangle where three meet."""
    corners = owner[faces]
    a, b, c = corners.T
    meet = corners[(a != b) & (b != c) & (c != a)]
    turned = np.take_along_axis(meet, (meet.argmin(1)[:, None] + np.arange(3)) % 3, axis=1)
    triangles = np.unique(turned, axis=0)
    count = owner.max() + 1
    weight = np.bincount(owner, areas, count)[:, None]
    middle = np.stack([np.bincount(owner, areas * column, count) for column in points.T], axis=1) / weight
    # The mean of a curved cluster lies off the surface; its point nearest to the mean lies on it.
    off = np.linalg.norm(points - middle[owner], axis=1)
    order = np.lexsort((off, owner))
    chosen = order[np.unique(owner[order], return_index=True)[1]]
    return trimesh.Trimesh(points[chosen], triangles, process=False)


def outer_surface(
    vertices: np.ndarray, faces: np.ndarray, visible: SurfaceSample
) -> tuple[np.ndarray, np.ndarray]:
    """Return one closed surface round all of a mesh (V, 3), (F, 3) drawn onto the visible surface."""
    outer, cell = _voxel_surface(vertices, faces)
    return _project_onto(np.asarray(outer.vertices), np.asarray(outer.faces), visible, cell)


def _voxel_surface(vertices: np.ndarray, faces: np.ndarray) -> tuple[trimesh.Trimesh, float]:
    """Return the closed surface of the voxels that a mesh takes, and their size: parts joined, cracks closed.

    Cavities with openings of more than a hundredth of the size count as outside.

    Args:
        vertices: (V, 3) of the mesh.
        faces: (F, 3) triangles, in any order of corners.
    """
    low, size = vertices.min(0), float(np.ptp(vertices, axis=0).max())
    cell, margin = size / 160, 3
    count = int(12 * vertex_areas(vertices, faces).sum() / cell**2)
    points = np.concatenate([sample_points(vertices, faces, count), vertices[np.unique(faces)]])
    voxel = ((points - low) / cell).astype(int) + margin
    occupied = np.zeros(voxel.max(0) + 1 + margin, bool)
    occupied[tuple(voxel.T)] = True
    empty_regions, _ = ndimage.label(~occupied)
    solid = empty_regions != empty_regions[0, 0, 0]
    thin = solid & ~ndimage.binary_opening(solid)
    solid |= ndimage.binary_dilation(thin)  # else smoothing perforates walls of one cell
    level = ndimage.gaussian_filter(solid.astype(np.float32), 0.8)
    surface, triangles, _, _ = marching_cubes(level, 0.5)
    mesh = trimesh.Trimesh((surface - margin + 0.5) * cell + low, triangles[:, ::-1])
    if mesh.volume < 0:
        mesh.invert()
    return max(mesh.split(only_watertight=True), key=lambda part: part.area, default=mesh), cell


def _project_onto(
    vertices: np.ndarray, faces: np.ndarray, visible: SurfaceSample, cell: float
) -> tuple[np.ndarray, np.ndarray]:
    """Move vertices, which are off by about half a cell, onto a surface, smoothly."""
    smooth = neighbour_mean(faces, len(vertices))
    tree = cKDTree(np.concatenate([visible.points, 2 * cell * visible.normals], axis=1))
    for _ in range(4):
        normals = vertex_normals(vertices, faces)
        _, index = tree.query(np.concatenate([vertices, 2 * cell * normals], axis=1))
        normal = visible.normals[index]
        along = ((visible.points[index] - vertices) * normal).sum(1)
        along[(np.abs(along) > 2 * cell) | ((normal * normals).sum(1) < 0.3)] = 0
        move = along[:, None] * normal
        for _ in range(2):
            move = smooth @ move
        vertices = vertices + move
    return vertices, faces


def closed_template(
    vertices: np.ndarray, faces: np.ndarray, visible: SurfaceSample, count: int = TEMPLATE_VERTICES
) -> tuple[np.ndarray, np.ndarray]:
    """Return a template of a mesh (V, 3), (F, 3): from itself if it is closed, else from its outer surface.

    Raises ValueError where neither gives a closed mesh.
    """
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    if mesh.is_watertight and mesh.is_winding_consistent and mesh.body_count == 1:
        if mesh.volume < 0:
            faces = faces[:, ::-1]
        try:
            return remesh(vertices, faces, count)
        except ValueError:
            pass
    return remesh(*outer_surface(vertices, faces, visible), count)


def genus(vertices: np.ndarray, faces: np.ndarray) -> int:
    """Return the genus of a mesh's outer surface: the number of holes through it."""
    return max(0, 1 - int(_voxel_surface(vertices, faces)[0].euler_number) // 2)
