"""Rounds meshes by their normals, so that large pictures show no corners where small ones show none."""

import numpy as np

CUTS = 4  # parts into which each edge of a curved face is cut
SAME = 0.999  # cosine of the angle below which two faces have one normal where they meet
MIN_BEND, MAX_BEND = 1e-5, 0.6
"""Metres by which an edge bends at least; and most of it, of its length, before it is left as it is."""


def round_mesh(
    vertices: np.ndarray, normals: np.ndarray, faces: np.ndarray, uv: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    """Return a mesh whose curved faces are cubic patches, cut into `CUTS` x `CUTS` triangles.

    Curved PN triangles (Vlachos et al. 2001): edges leave their ends at a right angle to the normal; where
    two faces meet at a crease, along both. Flat faces stay as they are. Shading normals are interpolated.

    Args:
        vertices: (V, 3), metres.
        normals: (V, 3), unit length; a crease has several vertices at one place.
        faces: (F, 3).
        uv: (F, 3, 2) coordinates of the faces' corners, or None.

    Returns:
        As the arguments, float32 and int32.
    """
    points, directions = vertices[faces].astype(np.float64), normals[faces].astype(np.float64)
    controls = _edge_controls(vertices, faces, points, directions)
    edges = np.roll(points, -1, 1) - points
    straight = np.stack([points + edges / 3, points + 2 * edges / 3], 2)
    bend = np.linalg.norm(controls - straight, axis=-1).max((1, 2))
    curved = bend > MIN_BEND
    weights, corners, small = _pattern()
    patch = np.concatenate([points[curved], controls[curved].reshape(-1, 6, 3)], 1)
    middle = patch[:, 3:].mean(1) * 1.5 - patch[:, :3].mean(1) * 0.5
    cut = np.einsum("mk,fkd->fmd", weights, np.concatenate([patch, middle[:, None]], 1))
    turned = np.einsum("mk,fkd->fmd", corners, directions[curved])
    turned /= np.maximum(np.linalg.norm(turned, axis=-1, keepdims=True), 1e-9)
    first = len(vertices) + len(corners) * np.arange(curved.sum())
    new_faces = np.concatenate([faces[~curved], (first[:, None, None] + small).reshape(-1, 3)])
    new_uv = None
    if uv is not None:
        finer = np.einsum("mk,fkd->fmd", corners, uv[curved])[:, small]
        new_uv = np.concatenate([uv[~curved], finer.reshape(-1, 3, 2)]).astype(np.float32)
    return (
        np.concatenate([vertices, cut.reshape(-1, 3)]).astype(np.float32),
        np.concatenate([normals, turned.reshape(-1, 3)]).astype(np.float32),
        new_faces.astype(np.int32),
        new_uv,
    )


def _edge_controls(
    vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    """Return the two inner control points (F, 3, 2, 3) of the edges from each corner to the next."""
    # closer than a micrometre, two vertices are one place
    place = np.unique(np.round(vertices / 1e-6).astype(np.int64), axis=0, return_inverse=True)[1].ravel()
    start, end = place[faces].ravel(), np.roll(place[faces], -1, 1).ravel()
    own = np.stack([directions.reshape(-1, 3), np.roll(directions, -1, 1).reshape(-1, 3)], 1)
    key = np.minimum(start, end) * (place.max() + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    _, begins, counts = np.unique(key[order], return_index=True, return_counts=True)
    partner = np.arange(len(key))
    pairs = begins[counts == 2]
    partner[order[pairs]], partner[order[pairs + 1]] = order[pairs + 1], order[pairs]
    other = np.where((start[partner] == start)[:, None, None], own[partner], own[partner][:, ::-1])
    a, b = points.reshape(-1, 3), np.roll(points, -1, 1).reshape(-1, 3)
    ends = np.stack([a, b], 1)
    along = np.stack([b - a, a - b], 1)
    both = own + other
    both /= np.maximum(np.linalg.norm(both, axis=-1, keepdims=True), 1e-9)
    smooth = along - (along * both).sum(-1, keepdims=True) * both
    crease = np.cross(own, other)
    crease /= np.maximum(np.linalg.norm(crease, axis=-1, keepdims=True), 1e-9)
    creased = (along * crease).sum(-1, keepdims=True) * crease
    leaving = np.where(((own * other).sum(-1) > SAME)[..., None], smooth, creased)
    length = np.linalg.norm(along, axis=-1, keepdims=True)
    wild = np.linalg.norm(leaving - along, axis=-1, keepdims=True) > MAX_BEND * length
    leaving = np.where(wild.any(1, keepdims=True), along, leaving)
    controls: np.ndarray = ends + leaving / 3
    return controls.reshape(*faces.shape, 2, 3)


def _pattern() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the weights of 10 control points and 3 corners for a cut patch's M points, and its triangles."""
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(CUTS + 1), np.arange(CUTS + 1), indexing="ij"))
    inside = i + j <= CUTS
    i, j = i[inside], j[inside]
    v, w = i / CUTS, j / CUTS
    u = 1 - v - w
    # Corners 0, 1, 2 have u, v, w; edge controls lie near the start and the end of 0-1, 1-2, 2-0.
    weights = np.stack(
        [u**3, v**3, w**3, 3 * u * u * v, 3 * u * v * v, 3 * v * v * w, 3 * v * w * w]
        + [3 * w * w * u, 3 * w * u * u, 6 * u * v * w],
        1,
    )
    number = {pair: k for k, pair in enumerate(zip(i.tolist(), j.tolist(), strict=True))}
    triangles = []
    for a, b in number:
        if a + b < CUTS:
            triangles.append((number[a, b], number[a + 1, b], number[a, b + 1]))
        if a + b < CUTS - 1:
            triangles.append((number[a + 1, b], number[a + 1, b + 1], number[a, b + 1]))
    return weights, np.stack([u, v, w], 1), np.array(triangles)
