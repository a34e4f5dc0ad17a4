"""bop.csv: the poses of a run as BOP's evaluation reads them, scene_id,im_id,obj_id,score,R,t,time.

Scene and image are numbered by the photos' paths, `.../000001/rgb/000003.png`, where all have such; else by
files' names that are numbers; else the scene is 0 and the image the photo's place among the photos.
Translations are in millimetres, poses those before the camera that took the photo (see
`Explanation.pinhole_pose`).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vig.io.files import atomic_write
from vig.record import read_explanation
from vig_app.exports.formats.bop import MILLIMETRES
from vig_app.exports.run import SCENE_NUMBERS, ExportedRun

FILE = "bop.csv"


def write(path: Path, run: ExportedRun) -> None:
    """A line for each object."""
    numbers = run.image_numbers(SCENE_NUMBERS)
    with atomic_write(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
        print("scene_id,im_id,obj_id,score,R,t,time", file=file)
        for row in run.objects:
            explanation = read_explanation(run.folder / row["folder"])
            pose = np.array(explanation["pinhole"]["camera_from_object"], float)
            rotation = " ".join(f"{number:.8g}" for number in pose[:3, :3].ravel())
            translation = " ".join(f"{MILLIMETRES * number:.8g}" for number in pose[:3, 3])
            scene, image = numbers[row["photo"]]
            fields = scene, image, run.class_ids[row["class"]], row["score"], rotation, translation
            print(*fields, row["seconds"], sep=",", file=file)
