"""BOP: camera, pose and boxes as its datasets have them, and the model, all in millimetres.

A run is one file, bop.csv, its poses as BOP's evaluation reads them: scene_id,im_id,obj_id,score,R,t,time.
Scene and image are numbered by the photos' paths, `.../000001/rgb/000003.png`, where all have such; else by
files' names that are numbers; else the scene is 0 and the image the photo's place among the photos. Poses are
those before the camera that took the photo (see `Explanation.pinhole_pose`).
"""

import math
from pathlib import Path

import numpy as np

from vig.explanation import Explanation
from vig.io.files import atomic_write, write_bytes, write_json
from vig.photo.masks import bop_box
from vig.record import read_explanation
from vig_app.exports.run import OBJECT_ID, SCENE_NUMBERS, ExportedRun

MILLIMETRES = 1000.0  # millimetres in a metre
MODEL = f"bop/models/obj_{OBJECT_ID:06}.ply"
FILES = ("bop/scene_camera.json", "bop/scene_gt.json", "bop/scene_gt_info.json", MODEL)
RUN_FILES = ("bop.csv",)
POSE_COLUMNS = "scene_id,im_id,obj_id,score,R,t,time"


def write(folder: Path, explanation: Explanation) -> None:
    """Write the photo as image 0 of its scene."""
    pose, pixels, visible = explanation.camera_from_object, explanation.amodal.sum(), explanation.mask.sum()
    truth = {
        "obj_id": OBJECT_ID,
        "cam_R_m2c": pose[:3, :3].ravel().tolist(),
        "cam_t_m2c": (MILLIMETRES * pose[:3, 3]).tolist(),
        "score": score(explanation),
    }
    info = {
        "bbox_obj": bop_box(explanation.amodal),
        "bbox_visib": bop_box(explanation.mask),
        "px_count_all": int(pixels),
        "px_count_visib": int(visible),
        "visib_fract": float(visible / pixels) if pixels else 0.0,
    }
    camera = {"cam_K": explanation.camera.K.ravel().tolist(), "depth_scale": 1.0}
    for path, content in zip(FILES, (camera, [truth], [info]), strict=False):
        write_json(folder / path, {"0": content})
    vertices, faces = explanation.vertices, explanation.object_class.shape_model.faces
    rows = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    rows += [f"property float {axis}" for axis in "xyz"]
    rows += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows += [" ".join(f"{number:.4f}" for number in row) for row in MILLIMETRES * vertices]
    rows += [f"3 {a} {b} {c}" for a, b, c in faces]
    write_bytes(folder / MODEL, ("\n".join(rows) + "\n").encode())


def score(explanation: Explanation) -> float | None:
    """Return the confidence that the view is right, None for a class without calibration."""
    return None if math.isnan(explanation.confidence) else round(explanation.confidence, 5)


def write_run(folder: Path, run: ExportedRun) -> None:
    """Write a line for each object."""
    numbers = run.image_numbers(SCENE_NUMBERS)
    with atomic_write(folder / RUN_FILES[0]) as temporary, open(temporary, "w", encoding="utf-8") as file:
        print(POSE_COLUMNS, file=file)
        for row in run.objects:
            explanation = read_explanation(run.folder / row["folder"])
            pose = np.array(explanation["pinhole"]["camera_from_object"], float)
            pose[:3, 3] *= MILLIMETRES
            scene, image = numbers[row["photo"]]
            number = run.class_ids[row["class"]]
            print(pose_line(scene, image, number, row["score"], pose, row["seconds"]), file=file)


def pose_line(
    scene: int, image: int, number: int, score: float | None, pose: np.ndarray, seconds: float
) -> str:
    """Return the line, of `POSE_COLUMNS`, of a pose (4, 4) in millimetres of the object of a number."""
    rotation, shift = (" ".join(f"{x:.8g}" for x in part.ravel()) for part in (pose[:3, :3], pose[:3, 3]))
    return f"{scene},{image},{number},{score},{rotation},{shift},{seconds}"
