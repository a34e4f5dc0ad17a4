"""What files and folders say of photos."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from vig.io.errors import UserError
from vig.photo import read_photo
from vig_app.cli.hints import cameras_of, mask_of
from vig_app.cli.naming import by_photo, in_order, note_order
from vig_app.cli.options import CameraOptions
from vig_app.cli.photos import photos_of, result_folders


@pytest.mark.parametrize(
    "names",
    [
        "1.png 2.png 9.png 10.png 12.png",
        "frame-2.png frame-10.png frame-100.png",
        "frame_9.jpg frame_10.jpg",
        "2024-1-9_8.png 2024-1-10_7.png 2024-10-1_0.png",
        "1700000000.25.png 1700000000.5.png 1700000001.125.png",  # Unix times
        "Cam1_9.png cam1_10.png cam2_1.png",
    ],
)
def test_frames_are_in_the_order_in_which_people_count(
    names: str, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = list(map(Path, names.split()))
    assert in_order(sorted(paths)) == in_order(paths[::-1]) == paths
    note_order(paths)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("01.png 1.png 2.png", "order 01.png, 1.png, 2.png; their names have a number twice"),
        ("1.png 1_mask.png 2.png 2_mask.png", "1.png, 1_mask.png, 2.png, ...; their names are of 2 forms"),
        ("a.png b.png", "are of 2 forms (a, b)"),
    ],
)
def test_names_that_may_not_give_the_order_are_named(
    names: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    note_order(in_order(map(Path, names.split())))
    assert words in capsys.readouterr().err


def test_entries_are_of_photos_by_name_or_by_the_end_of_their_path(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a, b = tmp_path / "s1" / "rgb" / "0.png", tmp_path / "s2" / "rgb" / "0.png"
    c = tmp_path / "c.png"
    path = Path("boxes.json")
    assert by_photo({"c.png": 1}, [c], "boxes", path) == {c: 1}
    assert by_photo({str(c): 1}, [c], "boxes", path) == {c: 1}
    both = {"s1/rgb/0.png": 1, "./s2\\rgb\\0.png": 2}
    assert by_photo(both, [a, b, c], "boxes", path) == {a: 1, b: 2}
    assert by_photo({"0.png": 1, "rgb/0.png": 2}, [a], "boxes", path) == {a: 2}, "the longer name counts"
    with pytest.raises(UserError, match="got '0.png', which is the name of 2.* such as 's1/rgb/0.png'"):
        by_photo({"0.png": 1}, [a, b], "boxes", path)
    assert by_photo({"0.png": 1}, [a, a], "boxes", path) == {a: 1}, "one photo given twice"
    capsys.readouterr()
    assert by_photo({"c.png": 1, "d.png": 2, "e.png": 3}, [c], "boxes", path) == {c: 1}
    assert capsys.readouterr().err == "vig: boxes of 2 other photos passed over: d.png, e.png\n"
    with pytest.raises(UserError, match="got one of 'd.png'"):
        by_photo({"d.png": 1}, [c], "boxes", path)


def test_names_that_differ_by_unicode_composition_are_the_same(tmp_path: Path) -> None:
    """An accent may be stored with its letter, or as a character of its own."""
    composed, decomposed = "K\u00e4nnchen.png", "Ka\u0308nnchen.png"
    photos = [tmp_path / name for name in (composed, decomposed)]
    entry, path = {composed: 1}, Path("boxes.json")
    assert by_photo(entry, photos[1:], "boxes", path) == {photos[1]: 1}
    assert by_photo({composed: 1, decomposed: 2}, photos, "boxes", path) == {photos[0]: 1, photos[1]: 2}
    masks = tmp_path / "masks"
    masks.mkdir()
    (masks / decomposed).write_bytes(b"")
    assert mask_of(masks, photos[:1])(photos[0]) == masks / decomposed
    Image.new("RGB", (20, 20)).save(photos[1])
    assert photos_of(tuple(photos[:1]), tmp_path / "out") == photos[1:], "as it is stored"
    assert read_photo(photos[0]).shape == (20, 20, 3)
    folders = result_folders(photos, tmp_path)
    assert [folder.name for folder in folders] == [composed[:-4], f"{decomposed[:-4]}-2"]


def test_a_folder_of_results_has_a_name_that_file_systems_take(tmp_path: Path) -> None:
    photos = [tmp_path / ("\u00e4" * 125 + end + ".png") for end in "ab"]
    names = [folder.name for folder in result_folders(photos, tmp_path)]
    assert names == ["\u00e4" * 100, "\u00e4" * 100 + "-2"]


def test_a_lookup_takes_no_longer_among_many_photos(tmp_path: Path) -> None:
    """Square work would take minutes: of names alike, of numbers, and of boxes by path."""
    count = 5_000
    photos = [tmp_path / str(number) / "000001.png" for number in range(count)]
    entries = {f"{number}/000001.png": number for number in range(count)}
    began = time.process_time()
    assert by_photo(entries, photos, "boxes", Path("boxes.json")) == dict(
        zip(photos, range(count), strict=True)
    )
    assert len(set(result_folders(photos, tmp_path))) == count
    photos = [tmp_path / f"{number:06}.png" for number in range(count)]
    file = tmp_path / "scene_camera.json"
    file.write_text(json.dumps({str(number): [number] for number in range(count)}))
    assert cameras_of(CameraOptions(cameras=file), photos) == [[number] for number in range(count)]
    assert time.process_time() - began < 10


def test_one_mask_is_not_that_of_two_photos(tmp_path: Path) -> None:
    photos = [tmp_path / scene / "0.png" for scene in ("s1", "s2")]
    masks = tmp_path / "masks"
    masks.mkdir()
    (masks / "0.png").write_bytes(b"")
    with pytest.raises(UserError, match="expected a mask for each photo; got '.*0.png' for .*s1.* and .*s2"):
        mask_of(masks, photos)
    for scene in ("s1", "s2"):
        (masks / scene).mkdir()
        (masks / scene / "0.png").write_bytes(b"")
    of = mask_of(masks, photos)
    assert [of(photo) for photo in photos] == [masks / "s1" / "0.png", masks / "s2" / "0.png"]


def test_what_a_folder_holds_beside_photos_is_named_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "photos"
    (folder / "more").mkdir(parents=True)
    Image.fromarray(np.zeros((20, 20, 3), np.uint8)).save(folder / "b.png")
    Image.fromarray(np.zeros((20, 20, 3), np.uint8)).save(folder / "a.jpg")
    for name in ("clip.mp4", "paper.pdf", "._b.png", ".DS_Store", "Thumbs.db"):
        (folder / name).write_bytes(b"%PDF-1.7" if name == "paper.pdf" else b"\0\5\x16\7")
    assert photos_of((folder,), tmp_path / "out") == [folder / "a.jpg", folder / "b.png"]
    assert capsys.readouterr().err == (
        f"vig: 3 files of '{folder}' not taken: clip.mp4 (a video; name it itself), more (a folder),"
        " paper.pdf (a PDF document)\n"
    )
    with pytest.raises(UserError, match="expected photos in .*more'; got none"):
        photos_of((folder / "more",), tmp_path / "out")
    (folder / "a.jpg").unlink()
    (folder / "b.png").unlink()
    with pytest.raises(UserError, match="got 3 of other kinds, clip.mp4"):
        photos_of((folder,), tmp_path / "out")
