"""An explanation in the formats of other tools: BOP, COCO, nerfstudio, ROS, USD."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from vig import __version__
from vig.explanation import Explanation
from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig.output.glb import LOOKS_BACK
from vig.photo.images import coded, write_png
from vig.photo.masks import box_of
from vig.renderer.shading import smooth_normals
from vig.scene import Camera, ObjectClass

MILLIMETRES = 1000.0
OBJECT_ID = 1
"""BOP and COCO count classes from 1; an explanation has one."""


@dataclass(frozen=True)
class Exported:
    """What the formats are made of.

    Attributes:
        photo: The photo's file name.
        object_class: What the photo was explained as.
        vertices: (V, 3) metres, in the object's frame.
        colours: (parts, 3) linear RGB.
        camera: Of the photo.
        camera_from_object: (4, 4).
        pinhole: (3, 3) intrinsic matrix of a camera whose principal point is the photo's middle.
        pose: (4, 4) from the object's frame, in metres, before that camera.
        covariance: (6, 6) of that pose: x, y, z in metres, then turns about these axes in radians.
        amodal: (H, W) bool, what the object covers.
        mask: (H, W) bool, what of it is seen.
        confidence: That the view is right, NaN where unknown.
        picture: (H, W, 3) uint8 sRGB.
    """

    photo: str
    object_class: ObjectClass
    vertices: np.ndarray
    colours: np.ndarray
    camera: Camera
    camera_from_object: np.ndarray
    pinhole: np.ndarray
    pose: np.ndarray
    covariance: np.ndarray
    amodal: np.ndarray
    mask: np.ndarray
    confidence: float
    picture: np.ndarray

    @staticmethod
    def of(explanation: Explanation, photo: str) -> Exported:
        """What of an explanation is exported."""
        pinhole, pose, covariance = explanation.pinhole_pose()
        return Exported(
            photo,
            explanation.object_class,
            explanation.vertices,
            explanation.part_albedo,
            explanation.camera,
            explanation.camera_from_object,
            pinhole,
            pose,
            covariance,
            explanation.amodal,
            explanation.mask,
            explanation.confidence,
            coded(explanation.picture),
        )


def write_bop(folder: Path, one: Exported) -> None:
    """`bop/`: scene_camera.json, scene_gt.json, scene_gt_info.json and the model, in millimetres."""
    pose, hidden = one.camera_from_object, one.amodal.sum()
    box, seen = bop_box(one.amodal), bop_box(one.mask)
    truth = {
        "obj_id": OBJECT_ID,
        "cam_R_m2c": pose[:3, :3].ravel().tolist(),
        "cam_t_m2c": (MILLIMETRES * pose[:3, 3]).tolist(),
        "score": _known(one.confidence),
    }
    info = {
        "bbox_obj": box,
        "bbox_visib": seen,
        "px_count_all": int(hidden),
        "px_count_visib": int(one.mask.sum()),
        "visib_fract": float(one.mask.sum() / hidden) if hidden else 0.0,
    }
    camera = {"cam_K": one.camera.K.ravel().tolist(), "depth_scale": 1.0}
    for name, content in (("scene_camera", camera), ("scene_gt", [truth]), ("scene_gt_info", [info])):
        _write(folder / "bop" / f"{name}.json", {"0": content})
    model = one.object_class.shape_model
    rows = ["ply", "format ascii 1.0", f"element vertex {len(one.vertices)}"]
    rows += [f"property float {axis}" for axis in "xyz"]
    rows += [f"element face {len(model.faces)}", "property list uchar int vertex_indices", "end_header"]
    rows += [" ".join(f"{number:.4f}" for number in row) for row in MILLIMETRES * one.vertices]
    rows += [f"3 {a} {b} {c}" for a, b, c in model.faces]
    with atomic_write(folder / "bop" / "models" / f"obj_{OBJECT_ID:06}.ply") as temporary:
        temporary.write_text("\n".join(rows) + "\n")


def write_coco(folder: Path, one: Exported) -> None:
    """coco.json: an image and an annotation with its amodal and its visible mask as run lengths."""
    height, width = one.mask.shape
    image = number_of_name(one.photo) or 1
    annotation = {
        "id": 1,
        "image_id": image,
        "category_id": OBJECT_ID,
        "iscrowd": 0,
        "bbox": bop_box(one.amodal),
        "area": int(one.amodal.sum()),
        "segmentation": run_lengths(one.amodal),
        "visible_segmentation": run_lengths(one.mask),
        "score": _known(one.confidence),
    }
    described = {
        "info": {"description": f"vig {__version__}"},
        "images": [{"id": image, "file_name": one.photo, "width": width, "height": height}],
        "categories": [{"id": OBJECT_ID, "name": one.object_class.name}],
        "annotations": [annotation],
    }
    _write(folder / "coco.json", described)


def write_nerfstudio(folder: Path, one: Exported) -> None:
    """transforms.json: the photo's camera in the object's frame; `nerfstudio/` with the photo and its mask.

    Where the mask is 0 nerfstudio does not train: on what hides the object and what is around it.
    """
    camera, photo, mask = one.camera, "nerfstudio/photo.png", "nerfstudio/mask.png"
    write_png(folder / photo, one.picture)
    write_png(folder / mask, one.mask)
    frame = {
        "file_path": photo,
        "mask_path": mask,
        "transform_matrix": (np.linalg.inv(one.camera_from_object) @ LOOKS_BACK).tolist(),
    }
    described = {
        "camera_model": "OPENCV",
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.focal,
        "fl_y": camera.focal_y or camera.focal,
        "cx": camera.cx,
        "cy": camera.cy,
        "frames": [frame],
    }
    _write(folder / "transforms.json", described)


def write_ros(folder: Path, one: Exported) -> None:
    """pose.yaml (geometry_msgs/PoseWithCovarianceStamped) and camera_info.yaml (sensor_msgs/CameraInfo).

    The frame is the optical one of a camera whose principal point is the photo's middle.
    """
    (x, y, z), (i, j, k, w) = one.pose[:3, 3].tolist(), quaternion(one.pose[:3, :3])
    stamp = {"header": {"frame_id": "camera_optical_frame"}}
    pose = {"position": {"x": x, "y": y, "z": z}, "orientation": {"x": i, "y": j, "z": k, "w": w}}
    covariance = one.covariance.ravel().tolist()
    # YAML holds JSON.
    _write(folder / "pose.yaml", stamp | {"pose": {"pose": pose, "covariance": covariance}})
    projection = np.c_[one.pinhole, np.zeros(3)]
    info = {
        "width": one.camera.width,
        "height": one.camera.height,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": one.pinhole.ravel().tolist(),
        "r": np.eye(3).ravel().tolist(),
        "p": projection.ravel().tolist(),
    }
    _write(folder / "camera_info.yaml", stamp | info)


def write_usd(folder: Path, one: Exported) -> None:
    """object.usdc: Z up, metres; a mesh a part with its material, and the photo's camera.

    Raises:
        UserError: usd-core is not installed.
    """
    try:
        from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade
    except ImportError:
        raise UserError("the export to USD needs usd-core; run pip install 'vig[usd]'") from None
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, f"/{_identifier(one.object_class.name)}")
    stage.SetDefaultPrim(root.GetPrim())
    model = one.object_class.shape_model
    owner = model.parts[model.faces[:, 0]]
    normals = smooth_normals(torch.from_numpy(one.vertices), torch.from_numpy(model.faces)).numpy()
    normals[~normals.any(1)] = 0, 0, 1  # of vertices without area
    for number in np.unique(owner).tolist():
        used, faces = np.unique(model.faces[owner == number], return_inverse=True)
        path = root.GetPath().AppendChild(_identifier(model.part_names[number]))
        mesh = UsdGeom.Mesh.Define(stage, path)
        mesh.CreatePointsAttr([Gf.Vec3f(*row) for row in one.vertices[used].tolist()])
        mesh.CreateFaceVertexCountsAttr([3] * (faces.size // 3))
        mesh.CreateFaceVertexIndicesAttr(faces.ravel().tolist())
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        low, high = one.vertices[used].min(0).tolist(), one.vertices[used].max(0).tolist()
        mesh.CreateExtentAttr([Gf.Vec3f(*low), Gf.Vec3f(*high)])
        mesh.CreateNormalsAttr([Gf.Vec3f(*row) for row in normals[used].tolist()])
        mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        colour = Gf.Vec3f(*one.colours[number].tolist())
        mesh.CreateDisplayColorAttr([colour])
        material = UsdShade.Material.Define(stage, path.AppendChild("material"))
        shader = UsdShade.Shader.Define(stage, path.AppendChild("material").AppendChild("surface"))
        shader.CreateIdAttr("UsdPreviewSurface")
        shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(colour)
        shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    eye, camera = UsdGeom.Camera.Define(stage, root.GetPath().AppendChild("camera")), one.camera
    # Apertures and focal length share a unit, here the pixel.
    eye.CreateFocalLengthAttr(camera.focal)
    eye.CreateHorizontalApertureAttr(float(camera.width))
    tall = camera.focal / (camera.focal_y or camera.focal)  # of a pixel, in widths of one
    eye.CreateVerticalApertureAttr(tall * camera.height)
    eye.CreateHorizontalApertureOffsetAttr(camera.width / 2 - camera.cx)
    eye.CreateVerticalApertureOffsetAttr(tall * (camera.cy - camera.height / 2))
    eye.CreateClippingRangeAttr(Gf.Vec2f(0.01, 1000.0))
    seen_from = np.linalg.inv(one.camera_from_object) @ LOOKS_BACK
    eye.AddTransformOp().Set(Gf.Matrix4d(*seen_from.T.ravel().tolist()))
    with atomic_write(folder / "object.usdc") as temporary:
        stage.GetRootLayer().Export(str(temporary))


WRITTEN = (
    "bop/scene_camera.json",
    "bop/scene_gt.json",
    "bop/scene_gt_info.json",
    f"bop/models/obj_{OBJECT_ID:06}.ply",
    "coco.json",
    "transforms.json",
    "nerfstudio/photo.png",
    "nerfstudio/mask.png",
    "pose.yaml",
    "camera_info.yaml",
    "object.usdc",
)
"""All files of all formats."""


def remove_exports(folder: Path) -> None:
    """Remove the exports of an earlier result, and folders that held nothing else."""
    for name in WRITTEN:
        path = folder / name
        path.unlink(missing_ok=True)
        for parent in path.parents:
            if parent == folder or not parent.is_dir() or any(parent.iterdir()):
                break
            parent.rmdir()


def number_of_name(photo: str) -> int | None:
    """The number at the end of a file's name: 139 of COCO_val2014_000000000139.jpg; None where none is."""
    digits = re.search(r"([0-9]{1,18})\.\w+$", photo)
    return int(digits[1]) if digits else None


WRITERS = {
    "bop": write_bop,
    "coco": write_coco,
    "nerfstudio": write_nerfstudio,
    "ros": write_ros,
    "usd": write_usd,
}


def quaternion(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """x, y, z, w of a rotation (3, 3)."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat().tolist()
    return x, y, z, w


def bop_box(mask: np.ndarray) -> list[int]:
    """x, y, width, height round a mask (H, W) bool; -1 four times for nothing, as BOP has it."""
    return list(box_of(mask) or (-1, -1, -1, -1))


def run_lengths(mask: np.ndarray) -> dict[str, Any]:
    """COCO's uncompressed run lengths of a mask (H, W) bool: down the columns, zeros first."""
    flat = mask.ravel(order="F")
    changes = np.flatnonzero(np.diff(flat)) + 1
    starts = np.concatenate([[0], changes, [flat.size]])
    counts = np.diff(starts).tolist()
    return {"size": list(mask.shape), "counts": [0, *counts] if flat[0] else counts}


def _write(path: Path, content: Any) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n")


def _known(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 5)


def _identifier(name: str) -> str:
    """A name as USD takes it: letters, digits and underscores, no digit first."""
    kept = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in name)
    return kept if kept[:1].isalpha() else f"_{kept}"


def export_explanation(
    explanation: Explanation, folder: str | Path, formats: Sequence[str], photo: str
) -> Path:
    """The work of `Explanation.export`."""
    if isinstance(formats, str) or (unknown := [name for name in formats if name not in WRITERS]):
        came = f"'{formats}'" if isinstance(formats, str) else f"'{unknown[0]}'"
        raise UserError(f"expected a list of formats out of {', '.join(WRITERS)}; got {came}. Name these.")
    if formats:
        exported = Exported.of(explanation, photo)
        for name in formats:
            WRITERS[name](Path(folder), exported)
    return Path(folder)
