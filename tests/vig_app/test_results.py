"""The table of a run, read again and in the result files of BOP and COCO."""

import csv
import errno
import importlib.util
import io
import json
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

import vig
from tests.support import run_vig
from vig.io.errors import UserError
from vig_app.examples import example_photos
from vig_app.exports import export_run
from vig_app.results import COLUMNS, RowsOnDisk, kind_of, read_results, write_table
from vig_app.runs import RunSettings, Task, run

FOCAL = 400.0


@pytest.fixture(scope="module")
def rows(results: Path) -> list[dict[str, object]]:
    return read_results(results)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two photos of BOP's scene 7, one with a known focal length, one that is none, in a run's folder."""
    folder, out = tmp_path_factory.mktemp("bop") / "000007" / "rgb", tmp_path_factory.mktemp("out")
    folder.mkdir(parents=True)
    tasks = []
    for number, example in enumerate(example_photos()[2:4]):
        photo = folder / f"{3 + number:06d}.png"
        with Image.open(example.photo) as picture:
            wide = Image.new("RGB", (400, 200), (90, 90, 90))
            wide.paste(picture, (20, 30))  # off the middle, where a pose depends on the principal point
            wide.save(photo)
        tasks.append(Task(photo, out / photo.stem, (20, 30, 150, 150), FOCAL if number else None))
    (folder / "000009.png").write_text("no photo")
    tasks.append(Task(folder / "000009.png", out / "000009"))
    write_table(out, run(tasks, out, RunSettings()))
    return out


def test_camera_and_pose_of_a_row_put_the_object_onto_the_photo(results: Path, rows: list[dict]) -> None:
    """Those of the camera that took it, whose middle is the photo's: the example lies far to the left."""
    for row in rows[:2]:
        assert (row["center_x"], row["center_y"]) == (200, 100) and row["focal_px"] == row["focal_y_px"]
        assert row["distance_known"] == (row["focal_from"] == "given")
        glb = trimesh.load(results / row["folder"] / "object.glb", force="mesh")
        explained = json.loads((results / row["folder"] / "explanation.json").read_text())
        positions = trimesh.transform_points(glb.vertices, np.linalg.inv(explained["glb_from_object"]))
        pose = np.reshape([row[f"camera_from_object_{i}{j}"] for i in range(3) for j in range(4)], (3, 4))
        points = np.c_[positions, np.ones(len(positions))].T
        x, y, depth = pose @ points
        place = np.stack(
            [row["focal_px"] * x / depth + row["center_x"], row["focal_y_px"] * y / depth + row["center_y"]]
        )
        camera = explained["camera"]
        fitted = np.array(camera["K"]) @ (np.array(camera["camera_from_object"])[:3] @ points)
        off = np.abs(place - fitted[:2] / fitted[2])
        assert off.mean() < 1.5  # pixels; 0.75 of a lens that is not known


def test_a_table_is_read_as_it_was_written(results: Path, rows: list[dict[str, object]]) -> None:
    ledger = [json.loads(line)["rows"][0] for line in (results / "results.jsonl").read_text().splitlines()]
    assert rows == ledger and tuple(rows[0]) == tuple(COLUMNS)
    if importlib.util.find_spec("pandas") is not None:
        import pandas

        assert len(pandas.DataFrame(rows)) == 3
    with pytest.raises(UserError, match="expected the table of `vig fit` of several photos"):
        read_results(results / "000003")
    (results / "000003" / "results.csv").write_text("a,b\n1,2\n")
    with pytest.raises(UserError, match="got a damaged file"):
        read_results(results / "000003")
    (results / "000003" / "results.csv").unlink()


def test_the_poses_of_a_run_are_read_by_a_reader_of_bop(
    results: Path, tmp_path: Path, rows: list[dict[str, object]]
) -> None:
    """Ten lines after BOP's own description: scene_id,im_id,obj_id,score,R,t,time; R by rows, t in mm."""
    head, *lines = export_run(results, ["bop"], tmp_path, first_id=5)[0].read_text().splitlines()
    assert head == "scene_id,im_id,obj_id,score,R,t,time"
    poses = {}
    for line in lines:
        scene, image, thing, score, turn, place, seconds = line.split(",")
        rotation = np.array(turn.split(" "), float).reshape(3, 3)
        translation = np.array(place.split(" "), float)
        poses[int(scene), int(image), int(thing)] = rotation, translation, float(score), float(seconds)
    assert list(poses) == [(7, 3, 5), (7, 4, 5)]
    explainer = vig.Explainer()
    answers = zip(poses.values(), (None, FOCAL), rows[:2], strict=True)
    for (rotation, translation, score, seconds), focal, row in answers:
        again = explainer.explain(str(row["photo"]), (20, 30, 150, 150), focal=focal)
        _, pose, _ = again.pinhole_pose()
        np.testing.assert_allclose(rotation, pose[:3, :3], atol=1e-6)
        np.testing.assert_allclose(translation, 1000 * pose[:3, 3], rtol=1e-4, atol=1e-3)
        assert (score, seconds) == (row["confidence"], row["seconds"])


def test_a_run_is_one_coco_file_of_images_categories_and_both_masks(results: Path, tmp_path: Path) -> None:
    described = json.loads(export_run(results, ["coco"], tmp_path, first_id=5)[0].read_text())
    images = {image["id"]: image for image in described["images"]}
    assert [(number, image["file_name"]) for number, image in images.items()] == [
        (3, "000003.png"),
        (4, "000004.png"),
    ]
    assert described["categories"] == [
        {"id": 5, "name": "teapot", "keypoints": ["spout", "handle", "knob"], "skeleton": []}
    ]
    assert [each["image_id"] for each in described["annotations"]] == [3, 4]
    for annotation in described["annotations"]:
        image = images[annotation["image_id"]]
        levels = np.asarray(Image.open(results / Path(image["file_name"]).stem / "mask.png"))
        assert levels.shape == (image["height"], image["width"])
        for name, expected in (("segmentation", levels > 0), ("visible_segmentation", levels == 255)):
            counts = annotation[name]["counts"]
            flat = np.repeat(np.arange(len(counts)) % 2 == 1, counts)
            height, width = annotation[name]["size"]
            np.testing.assert_array_equal(flat.reshape(width, height).T, expected)
        x, y, wide, high = annotation["bbox"]
        assert (levels[y : y + high, x : x + wide] > 0).sum() == (levels > 0).sum() == annotation["area"]
        assert annotation["category_id"] == 5 and 0 <= annotation["score"] <= 1


def test_files_without_numbers_are_numbered_by_their_place(results: Path, tmp_path: Path) -> None:
    renamed = [row | {"photo": f"{name}.png"} for row, name in zip(read_results(results), "abc", strict=True)]
    other = tmp_path / "other"
    other.mkdir()
    for row in renamed[:2]:
        (other / str(row["folder"])).symlink_to(results / str(row["folder"]))
    write_table(other, renamed)
    poses, masks = export_run(other, ["bop", "coco"])
    lines = poses.read_text().splitlines()
    assert [line.split(",")[:3] for line in lines[1:]] == [["0", "0", "1"], ["0", "1", "1"]]
    assert [each["image_id"] for each in json.loads(masks.read_text())["annotations"]] == [0, 1]


def test_a_run_without_a_result_makes_valid_files(tmp_path: Path) -> None:
    write_table(tmp_path, [dict.fromkeys(COLUMNS) | {"photo": "a.png", "folder": "a", "error": "none"}])
    poses, masks = export_run(tmp_path, ["bop", "coco"])
    described = json.loads(masks.read_text())
    assert described["images"] == described["annotations"] == [] == described["categories"]
    assert len(poses.read_text().splitlines()) == 1


def test_the_command_writes_both(results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, code in (([str(results)], 0), ([str(tmp_path)], 2)):
        assert run_vig("export", *arguments, "--to", "bop", "coco", "--out", tmp_path / "files") == code
    output = capsys.readouterr()
    names = ("bop.csv", "coco.json", "")
    assert output.out.split() == [str(tmp_path / "files" / name) for name in names]
    exported, refused = output.err.splitlines()
    assert exported.startswith("vig: exported bop.csv, coco.json: ")
    assert "Name the folder of its results" in refused


def test_a_format_with_files_for_each_photo_is_told_how_to_have_them(results: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="bop, coco, .*yolo; got 'ros'.* vig fit --export ros"):
        export_run(results, ["bop", "ros"], tmp_path)
    assert not list(tmp_path.iterdir())


def test_rows_of_a_run_are_kept_on_disk_in_the_order_of_the_photos() -> None:
    """At most 600 bytes of memory a photo, of some 7,000 that such a row takes."""
    count = 3000
    rows = RowsOnDisk(f"p{number}" for number in range(count))
    full = {name: f"{name} is so many bytes: {'x' * 100}" for name in COLUMNS}
    tracemalloc.start()
    try:
        for number in reversed(range(count)):
            rows.add(full | {"folder": f"p{number}", "confidence": 0.1 + number})
        grown = tracemalloc.get_traced_memory()[0] / count
    finally:
        tracemalloc.stop()
    assert grown < 600 and len(rows) == count
    rows.add(full | {"folder": "p7/1-mug", "photo": "caf\udce9.jpg"})
    rows.add(full | {"folder": "p9", "verdict": None})
    again = list(rows)
    assert len(rows) == count and len(again) == count + 1
    assert [row["folder"] for row in again[6:11]] == ["p6", "p7", "p7/1-mug", "p8", "p9"]
    assert again[8]["photo"] == "caf\udce9.jpg" and again[10]["verdict"] is None
    assert again[0] == next(iter(rows)) == full | {"folder": "p0", "confidence": 0.1}


@pytest.mark.parametrize(
    "name", ["=1+1", "@SUM(A1)", "+1", "-1", "\t=1", "\r1", "'=1", "\uff1d1", "'a", "a=1"]
)
def test_no_text_of_a_table_is_a_formula(name: str, tmp_path: Path) -> None:
    row = dict.fromkeys(COLUMNS) | {
        "photo": f"{name}.png",
        "folder": name,
        "error": f"{name}: why",
        "roll_deg": -1.5,
    }
    write_table(tmp_path, [row])
    with open(tmp_path / "results.csv", encoding="utf-8", newline="") as file:
        (cells,) = csv.DictReader(file)
    texts = [name for name, column in COLUMNS.items() if kind_of(column) is str]
    assert len(texts) == 8
    assert not any(cells[column].startswith(("=", "@", "+", "-", "\t", "\r", "\uff1d")) for column in texts)
    assert cells["roll_deg"] == "-1.5" and read_results(tmp_path) == [row]


@pytest.mark.parametrize("when", ["made", "written"])
def test_rows_stay_in_memory_where_no_file_takes_them(when: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk for temporary files loses no table."""

    def full(**_: object) -> io.BytesIO:
        raise OSError(errno.ENOSPC, "full")

    class Short(io.BytesIO):
        def write(self, line: Any) -> int:
            return super().write(line[:5]) if len(self.getvalue()) > 40 else super().write(line)

    monkeypatch.setattr("tempfile.TemporaryFile", full if when == "made" else lambda **_: Short())
    rows = RowsOnDisk(["a", "b", "c"])
    for name in "bac":
        rows.add({"folder": name, "error": None, "verdict": name * 20})
    assert [row["verdict"] for row in rows] == ["a" * 20, "b" * 20, "c" * 20]
