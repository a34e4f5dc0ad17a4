"""The table of a run, read again and in the result files of BOP and COCO."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import vig
from vig.io.errors import UserError
from vig_app.cli.main import main
from vig_app.examples import example_photos
from vig_app.report.page import write_thumbnail
from vig_app.report.sheet import PER_SHEET, TILE, write_sheets
from vig_app.runs import RunSettings, Task, run
from vig_app.runs.results import COLUMNS, bop_csv, coco_json, read_results, write_table

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


def test_a_table_is_read_as_it_was_written(results: Path, rows: list[dict[str, object]]) -> None:
    ledger = [json.loads(line)["rows"][0] for line in (results / "results.jsonl").read_text().splitlines()]
    assert rows == ledger and tuple(rows[0]) == COLUMNS
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
    head, *lines = bop_csv(results, tmp_path / "bop.csv", object_id=5).read_text().splitlines()
    assert head == "scene_id,im_id,obj_id,score,R,t,time"
    found = {}
    for line in lines:
        scene, image, thing, score, turn, place, seconds = line.split(",")
        rotation = np.array(turn.split(" "), float).reshape(3, 3)
        translation = np.array(place.split(" "), float)
        found[int(scene), int(image), int(thing)] = rotation, translation, float(score), float(seconds)
    assert list(found) == [(7, 3, 5), (7, 4, 5)]
    explainer = vig.Explainer()
    answers = zip(found.values(), (None, FOCAL), rows[:2], strict=True)
    for (rotation, translation, score, seconds), focal, row in answers:
        again = explainer.explain(str(row["photo"]), (20, 30, 150, 150), focal=focal)
        _, pose, _ = again.pinhole_pose()
        np.testing.assert_allclose(rotation, pose[:3, :3], atol=1e-6)
        np.testing.assert_allclose(translation, 1000 * pose[:3, 3], rtol=1e-4, atol=1e-3)
        assert (score, seconds) == (row["confidence"], row["seconds"])


def test_the_masks_of_a_run_are_a_coco_result_file(results: Path, tmp_path: Path) -> None:
    found = json.loads(coco_json(results, tmp_path / "coco.json").read_text())
    assert [(one["image_id"], one["file_name"]) for one in found] == [(3, "000003.png"), (4, "000004.png")]
    for one in found:
        seen = np.asarray(Image.open(results / Path(one["file_name"]).stem / "mask.png")) == 255
        counts = one["segmentation"]["counts"]
        flat = np.repeat(np.arange(len(counts)) % 2 == 1, counts)
        height, width = one["segmentation"]["size"]
        np.testing.assert_array_equal(flat.reshape(width, height).T, seen)
        x, y, wide, high = one["bbox"]
        assert seen[y : y + high, x : x + wide].sum() == seen.sum() and 0 <= one["score"] <= 1
    if importlib.util.find_spec("pycocotools") is not None:
        from pycocotools.coco import COCO

        truth = COCO()
        truth.dataset = {"images": [{"id": each, "height": 200, "width": 400} for each in (3, 4)]}
        truth.dataset |= {"annotations": [], "categories": [{"id": 1, "name": "teapot"}]}
        truth.createIndex()
        assert len(truth.loadRes(found).anns) == 2


def test_files_without_numbers_are_numbered_by_their_place(results: Path, tmp_path: Path) -> None:
    renamed = [row | {"photo": f"{name}.png"} for row, name in zip(read_results(results), "abc", strict=True)]
    other = tmp_path / "other"
    other.mkdir()
    for row in renamed[:2]:
        (other / str(row["folder"])).symlink_to(results / str(row["folder"]))
    write_table(other, renamed)
    lines = bop_csv(other, other / "bop.csv").read_text().splitlines()
    assert [line.split(",")[:3] for line in lines[1:]] == [["0", "0", "1"], ["0", "1", "1"]]
    assert [one["image_id"] for one in json.loads(coco_json(other, other / "c.json").read_text())] == [0, 1]


def test_a_run_without_a_result_makes_valid_files(tmp_path: Path) -> None:
    write_table(tmp_path, [dict.fromkeys(COLUMNS) | {"photo": "a.png", "folder": "a", "error": "none"}])
    assert json.loads(coco_json(tmp_path, tmp_path / "coco.json").read_text()) == []
    assert len(bop_csv(tmp_path, tmp_path / "bop.csv").read_text().splitlines()) == 1


def test_the_command_writes_both(results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, code in (([str(results)], 0), ([str(tmp_path)], 2)):
        with pytest.raises(SystemExit) as ended:
            main(["export", *arguments, "--to", "bop", "coco", "--out", str(tmp_path / "files")])
        assert (ended.value.code or 0) == code
    told = capsys.readouterr()
    assert told.out.split() == [str(tmp_path / "files" / name) for name in ("bop.csv", "coco.json")]
    assert told.err.count("\n") == 1 and "Name the folder of its results" in told.err


def test_sheets_show_what_is_strangest_first(tmp_path: Path) -> None:
    """Frames by verdict, in the order of the tiles; two sheets of 200, no stale third."""

    def row(name: str, verdict: str | None, confidence: float | None) -> dict[str, object]:
        error = None if verdict else f"{name}: no\npicture"
        return {"photo": name, "folder": name, "error": error, "verdict": verdict, "confidence": confidence}

    few = [
        row("t.png", "trusted", 0.9), row("a.png", "ambiguous", 0.5), row("l.png", "ambiguous", 0.2),
        row("e\n.png", None, None), row("f.png", "failed", 0.0), row("r.png", "reverted", None),
    ]  # fmt: skip
    for one in few[:3]:
        (tmp_path / str(one["folder"])).mkdir()
        write_thumbnail(tmp_path / str(one["folder"]), np.full((300, 500, 3), 200, np.uint8))
    (tmp_path / "sheet-3.jpg").touch()
    assert write_sheets(tmp_path, few) == [tmp_path / "sheet.jpg"]
    sheet = np.asarray(Image.open(tmp_path / "sheet.jpg")).astype(int)
    frames = [sheet[8 + line, 20 + across] for line in (0, 208) for across in (0, 174, 348)]
    frames = [np.asarray(frame) for frame in frames]
    colours = [(110, 119, 129), (207, 34, 46), (207, 34, 46), (191, 135, 0), (191, 135, 0), (45, 164, 78)]
    assert np.abs(np.array(frames) - colours).max() < 12
    assert np.abs(sheet[10 + 208 + TILE // 2, 10 + TILE // 2] - 200).max() < 5  # the picture of l.png
    many = [row(f"{number}.png", "trusted", 0.9) for number in range(PER_SHEET + 1)]
    assert [path.name for path in write_sheets(tmp_path, many)] == ["sheet.jpg", "sheet-2.jpg"]
    assert not (tmp_path / "sheet-3.jpg").exists()
