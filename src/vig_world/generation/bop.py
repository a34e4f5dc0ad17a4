"""The BOP format's own files and numbers, as its toolkit computes and reads them.

Format: https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md; its
script `calc_gt_info.py` defines the numbers of `scene_gt_info.json`. Lengths are in millimetres.
"""

import json
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import pdist

from vig.photo.masks import bop_box
from vig.scene import Camera, ObjectClass, Symmetry
from vig_world.dataset.format import DEPTH_SCALES, OBJECT_ID, Size
from vig_world.mesh import Mesh, vertex_normals
from vig_world.raster.picture import CANVAS
from vig_world.raster.view import View


def scene_camera(view: View, depth_scale: float) -> dict[str, Any]:
    """Return one image's entry of `scene_camera.json`: cam_K and cam_R_w2c row by row, cam_t_w2c mm.

    `depth_scale` is the millimetres of a unit of its depth image.

    The pixel in the upper left corner covers [0, 1] x [0, 1], as in the toolkit's renderers: for projections
    at which pixels' centres are whole numbers, take half a pixel from the principal point.
    """
    matrix = view.camera.K.ravel().tolist()
    rotation, translation = view.rotation.ravel().tolist(), (1000 * view.translation).tolist()
    return {"cam_K": matrix, "depth_scale": depth_scale, "cam_R_w2c": rotation, "cam_t_w2c": translation}


def pose(view: View) -> dict[str, Any]:
    """Return the object's entry of `scene_gt.json`: the object's frame is the world's."""
    rotation, translation = view.rotation.ravel().tolist(), (1000 * view.translation).tolist()
    return {"cam_R_m2c": rotation, "cam_t_m2c": translation, "obj_id": OBJECT_ID}


def visibility(
    canvas: np.ndarray, amodal: np.ndarray, visible: np.ndarray, depth: np.ndarray
) -> dict[str, Any]:
    """Return the object's entry of `scene_gt_info.json`.

    Args:
        canvas: (3H, 3W) bool, the silhouette on a canvas whose middle third is the image.
        amodal: (H, W) bool.
        visible: (H, W) bool.
        depth: (H, W), the depth image, 0 where unknown.
    """
    whole, visible_pixels = int(np.count_nonzero(canvas)), int(np.count_nonzero(visible))
    height, width = visible.shape
    aside = CANVAS // 2
    return {
        "bbox_obj": bop_box(canvas, (-aside * width, -aside * height)) if visible_pixels else [-1] * 4,
        "bbox_visib": bop_box(visible),
        "px_count_all": whole,
        "px_count_valid": int(np.count_nonzero(amodal & (depth > 0))),
        "px_count_visib": visible_pixels,
        "visib_fract": visible_pixels / whole if whole else 0.0,
    }


def camera(size: Size) -> dict[str, Any]:
    """Return `camera.json`: the standard camera, which all images of the paper's world share."""
    width, height = size
    standard = View(Camera.standard(min(size)), np.eye(3), np.zeros(3)).reframe(width, height).camera
    return {
        "cx": standard.cx,
        "cy": standard.cy,
        "depth_scale": DEPTH_SCALES[0],
        "fx": standard.focal,
        "fy": standard.focal,
        "height": standard.height,
        "width": standard.width,
    }


TARGETS = "test_targets_bop19.json"


def localisation_targets(gt_info: list[dict[str, Any]]) -> list[dict[str, int]]:
    """Return `test_targets_bop19.json`: the images on which methods are judged, from each image's gt_info."""
    return [
        {"im_id": index, "inst_count": 1, "obj_id": OBJECT_ID, "scene_id": 0}
        for index, info in enumerate(gt_info)
        if info["visib_fract"] >= 0.1
    ]


def shared_files(object_class: ObjectClass, size: Size) -> dict[str, bytes]:
    """Return the files of all splits by their names: the camera, and the class's mean shape with its numbers.

    BOP has one model per object; the samples' own shapes differ.
    """
    model = Mesh(object_class.shape_model.mean, object_class.shape_model.faces)
    return {
        "camera.json": json.dumps(camera(size)).encode(),
        "models/models_info.json": json.dumps(models_info(model, object_class.symmetry)).encode(),
        f"models/obj_{OBJECT_ID:06d}.ply": ply(model),
    }


def ply(mesh: Mesh) -> bytes:
    """Return a mesh in metres as an ASCII PLY file in millimetres, with vertex normals, as BOP's models."""
    vertices = 1000 * mesh.vertices.astype(np.float64)
    rows = np.concatenate([vertices, vertex_normals(mesh.vertices, mesh.faces)], axis=1)
    properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    header = (
        f"ply\nformat ascii 1.0\nelement vertex {len(rows)}\n{properties}"
        f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    points = "".join("{:.4f} {:.4f} {:.4f} {:.5f} {:.5f} {:.5f}\n".format(*row) for row in rows)
    faces = "".join("3 {} {} {}\n".format(*face) for face in mesh.faces)
    return (header + points + faces).encode()


SYMMETRIES: dict[Symmetry, dict[str, Any]] = {
    Symmetry.NONE: {},
    Symmetry.HALF_TURN: {"symmetries_discrete": [[-1.0, 0, 0, 0, 0, -1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0]]},
    Symmetry.ANY_TURN: {"symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]},
}
"""Symmetries in the form of BOP's files of models: equivalent poses (4 x 4, row by row), and axes."""


def models_info(mesh: Mesh, symmetry: Symmetry = Symmetry.NONE) -> dict[str, dict[str, Any]]:
    """Return `models/models_info.json`: bounding box, diameter (of the farthest vertices), mm; symmetries."""
    vertices = 1000 * mesh.vertices.astype(np.float64)
    low, size = vertices.min(0), np.ptp(vertices, axis=0)
    try:
        outer = vertices[ConvexHull(vertices).vertices]
    except QhullError:  # a flat object
        outer = vertices
    described = {f"min_{axis}": float(value) for axis, value in zip("xyz", low, strict=True)}
    described |= {f"size_{axis}": float(value) for axis, value in zip("xyz", size, strict=True)}
    return {str(OBJECT_ID): {"diameter": float(pdist(outer).max()), **described, **SYMMETRIES[symmetry]}}
