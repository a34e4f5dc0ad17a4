"""The lens of a photo: what is given, what EXIF data state, and windows that are looked at through it."""

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageOps
from PIL.ExifTags import IFD, Base
from scipy.spatial.transform import Rotation

from vig.io.errors import UserError
from vig.photo import Intrinsics, Window, focal_of
from vig.photo.lens import camera_as_shown
from vig.photo.pinhole import fit_pose, outline_weights, turned_pose
from vig.scene import Camera

K = [[900.0, 0.0, 310.0], [0.0, 880.0, 250.0], [0.0, 0.0, 1.0]]
FOUR = (900.0, 880.0, 310.0, 250.0)


@pytest.mark.parametrize(
    "camera",
    [
        FOUR,
        np.array(FOUR, np.float32),
        K,
        np.ravel(K),
        {"cam_K": list(np.ravel(K)), "depth_scale": 1.0},
        {"K": K},
        {"k": list(np.ravel(K)), "d": [0.0] * 5, "width": 640, "height": 480},
        dict(zip(("fx", "fy", "cx", "cy"), FOUR, strict=True)),
        {"fl_x": 900.0, "fl_y": 880.0, "cx": 310.0, "cy": 250.0, "w": 640, "h": 480, "k1": 0.0},
        {
            "camera_matrix": {"rows": 3, "cols": 3, "data": list(np.ravel(K))},
            "image_width": 640,
            "distortion_model": "plumb_bob",
            "distortion_coefficients": {"rows": 1, "cols": 2, "data": [0, 0]},
        },
        {
            "intrinsics": FOUR,
            "resolution": [640, 480],
            "distortion_model": "radtan",
            "distortion_coeffs": [0.0],
        },
        {"model": "OPENCV", "params": [*FOUR, 0, 0, 0, 0], "undistorted": True, "distance": 2.0},
        {
            "fx": 900,
            "fy": 880,
            "ppx": 310,
            "ppy": 250,
            "model": "distortion.brown_conrady",
            "coeffs": [0] * 5,
        },
        {"intrinsics": {**dict(zip(("fx", "fy", "cx", "cy"), FOUR, strict=True)), "width": 640}},
    ],  # fmt: skip
)
def test_a_camera_is_taken_in_any_usual_form(camera: object) -> None:
    lens = Intrinsics.of(camera, 640, 480)
    assert (lens.fx, lens.fy, lens.cx, lens.cy) == FOUR
    np.testing.assert_array_equal(lens.K, K)


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        ((900.0, 880.0, 310.0), "fx, fy, cx, cy or K"),
        ("900,880,310,250", "fx, fy, cx, cy or K"),
        ((900.0, True, 310.0, 250.0), "fx, fy, cx, cy or K"),
        ((-900.0, 880.0, 310.0, 250.0), "above 0"),
        ((math.nan, 880.0, 310.0, 250.0), "finite"),
        ((1.4, 1.4, 0.5, 0.5), "focal lengths that suit"),
        ((900.0, 150.0, 310.0, 250.0), "nearly equal"),
        ((900.0, 880.0, 9000.0, 250.0), "principal point"),
        (np.transpose(K), "transposed"),
        ([[900.0, 40.0, 310.0], *K[1:]], "skewed"),
        ({"K": K, "d": [0.1, 0, 0, 0, 0]}, "distortion"),
        ({"fl_x": 900.0, "fl_y": 880.0, "cx": 310.0, "cy": 250.0, "k1": -0.02}, "distortion"),
        ({"K": K, "width": 1280, "height": 960}, "1280 x 960"),
        ({"fl_x": 900.0, "fl_y": 880.0, "cx": 310.0, "cy": 250.0, "w": 1280, "h": 960}, "1280 x 960"),
        ({"fx": 900.0, "fy": 880.0}, "fx, fy, cx, cy or K"),
        *[
            ({"K": K, name: [-0.3, 0.1, 0, 0]}, "distortion")
            for name in (
                "D",
                "dist_coeffs",
                "distCoeffs",
                "distortion",
                "distortion_coefficients",
                "coeffs",
                "kc",
                "RadialDistortion",
            )
        ],
        (
            {"K": K, "distortion_coefficients": {"rows": 1, "cols": 5, "data": [-0.3, 0, 0, 0, 0]}},
            "distortion",
        ),
        ({"K": K, "distortion": {"model": "radtan", "k1": 0.2}}, "distortion"),
        ({"K": K, "distortion": "-0.3 0.1"}, "distortion"),
        ({"K": K, "K3": 0.1}, "distortion"),
        (
            {"fx": 9e2, "fy": 9e2, "cx": 3e2, "cy": 2e2, "model": "OPENCV", "params": [*FOUR, 0.1]},
            "distortion",
        ),
        ({"model": "SIMPLE_RADIAL", "params": [900, 310, 250, 0.1]}, "distortion"),
        ({"K": K, "camera_model": "OPENCV_FISHEYE", "k1": 0}, "pinhole camera; got 'OPENCV_FISHEYE'"),
        ({"K": K, "distortion_model": "equidistant", "D": []}, "pinhole camera"),
        *[
            ({"K": K, **size}, "1280 x 960|1280 x None")
            for size in (
                {"image_width": 1280, "image_height": 960},
                {"resolution": [1280, 960]},
                {"imageWidth": 1280},
                {"image_size": {"width": 1280, "height": 960}},
            )
        ],
    ],
)
def test_what_cannot_be_the_photos_camera_is_refused(camera: object, words: str) -> None:
    with pytest.raises(UserError, match=words):
        Intrinsics.of(camera, 640, 480)


def photo_turned(path: Path, orientation: int) -> Path:
    exif = Image.Exif()
    exif[Base.Orientation] = orientation
    Image.new("RGB", (400, 300)).save(path, exif=exif)
    return path


@pytest.mark.parametrize("orientation", [5, 6, 7, 8])
def test_a_camera_of_the_stored_picture_is_turned_with_it(
    orientation: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Pillow turns a picture whose one bright pixel is where the principal point is."""
    path = photo_turned(tmp_path / "a.png", orientation)
    with Image.open(path) as image:
        image.putpixel((210, 145), (255, 255, 255))
        y, x = np.argwhere(np.asarray(ImageOps.exif_transpose(image))[..., 0])[0]
    shown = (560.0, 550.0, x + 0.5, y + 0.5)
    for stored in ((550.0, 560.0, 210.5, 145.5), {"K": [[550, 0, 210.5], [0, 560, 145.5], [0, 0, 1]]}):
        assert camera_as_shown(path, stored) == Intrinsics(*shown)
    assert "a.png' is that of the stored 400 x 300" in capsys.readouterr().err
    assert camera_as_shown(path, shown) is shown, "as it is shown"
    either = dict(zip(("fx", "fy", "cx", "cy"), (550, 560, 172, 178), strict=True))
    with pytest.raises(
        UserError, match="as it is shown, 300 x 400; got cx 172, cy 178, which may be of one of 400 x 300"
    ):
        camera_as_shown(path, either)
    sized = either | {"width": 300, "height": 400}
    assert camera_as_shown(path, sized) is sized
    assert isinstance(camera_as_shown(path, either | {"w": 400, "h": 300}), Intrinsics)
    assert camera_as_shown(photo_turned(path, 1), either) is either
    with pytest.raises(UserError, match="as it is shown, 400 x 300; got cx 151, cy 199"):
        camera_as_shown(path, (550, 560, 151, 199))


def seen(pose: np.ndarray, points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    pixels = (points @ pose[:3, :3].T + pose[:3, 3]) @ matrix.T
    return pixels[:, :2] / pixels[:, 2:]


@pytest.mark.parametrize("roll", [0.0, 0.4])
def test_a_window_through_a_lens_is_what_a_camera_turned_to_it_shows(roll: float) -> None:
    """Points before the photo's camera, and before one at its place that looks at the window's middle."""
    lens = Intrinsics(500.0, 540.0, 300.0, 250.0)
    window = Window(420.0, 60.0, 120.0, roll, lens)
    ray = np.linalg.inv(lens.K) @ [*window.centre, 1.0]
    points = 2 * ray + 0.2 * np.random.default_rng(0).standard_normal((40, 3))
    turned = points @ window.turn.T
    assert window.turn @ window.turn.T == pytest.approx(np.eye(3), abs=1e-12)
    assert turned[:, 2].min() > 1 and (window.turn @ ray)[:2] == pytest.approx([0, 0], abs=1e-12)
    offsets = window.focal * turned[:, :2] / turned[:, 2:]
    there = seen(np.eye(4), points, lens.K)
    np.testing.assert_allclose(np.stack(window.to_photo(*offsets.T), 1), there, atol=1e-9)
    np.testing.assert_allclose(np.stack(window.to_window(*there.T), 1), offsets, atol=1e-9)
    # About the middle areas are kept.
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    (x, y) = np.stack(window.to_photo(*corners.T))
    area = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert area == pytest.approx(4, rel=1e-3)


def test_what_a_lens_shows_of_a_photo_goes_back_to_where_it_was() -> None:
    lens = Intrinsics(400.0, 430.0, 320.0, 240.0)
    window = Window(450.0, 300.0, 100.0, 0.2, lens)
    rows, columns = np.mgrid[:480, :640] + 0.5
    photo = np.stack([columns / 640, rows / 480, np.zeros((480, 640))], 2).astype(np.float32)
    cut, inside = window.crop(photo)
    assert inside.all()
    middles = (np.arange(150) + 0.5 - 75) / 150 * 100
    x, y = window.to_photo(*np.meshgrid(middles, middles))
    np.testing.assert_allclose(cut[..., 0] * 640, x, atol=0.3)
    np.testing.assert_allclose(cut[..., 1] * 480, y, atol=0.3)
    (left, right, top, bottom), back = (450, 560, 300, 400), np.zeros((480, 640))
    for tile in window.tiles(640, 480):
        back[tile] = window.paste(cut[..., 0], *tile, outside=-1.0)
    known = back[top:bottom, left:right] > 0
    assert known.mean() > 0.7
    np.testing.assert_allclose(
        back[top:bottom, left:right][known] * 640, columns[top:bottom, left:right][known], atol=1.0
    )
    assert not known[0, 0] and (back[:250] <= 0).all()


def test_a_window_that_a_lens_cannot_look_at_is_refused() -> None:
    lens = Intrinsics(120.0, 120.0, 320.0, 240.0)
    with pytest.raises(UserError, match="80 degrees"):
        Window(900.0, 300.0, 500.0, 0.0, lens).to_photo(0.0, 0.0)


def test_a_pose_is_found_by_where_its_points_are_seen() -> None:
    """The exact pose, from one of another camera that is some degrees and millimetres off."""
    rng = np.random.default_rng(1)
    points, matrix = 0.1 * rng.standard_normal((200, 3)), np.array(K)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec([0.3, -0.8, 0.2]).as_matrix(), (0.2, -0.1, 0.9)
    start = pose.copy()
    start[:3, :3] = Rotation.from_rotvec([0.04, 0.03, -0.05]).as_matrix() @ start[:3, :3]
    start[:3, 3] += 0.02, -0.01, 0.06
    found = fit_pose(matrix, seen(pose, points, matrix), points, np.ones(200), start)
    np.testing.assert_allclose(found, pose, atol=1e-7)


def test_outlines_count_more_than_what_is_within_them() -> None:
    """Of a cube the corner nearest to the eye bounds faces that are seen alone, the farthest unseen ones."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1.0)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)])
    weights = outline_weights(corners, faces, np.array([5.0, 6.0, 7.0]))
    assert weights[7] < 1 and weights[0] < 1 and (np.delete(weights, [0, 7]) == 1).all()


def test_a_turned_pose_sees_a_small_thing_where_the_fit_does() -> None:
    cut = Camera(1000, 800, 2000.0, 900.0, 100.0, distance=2.0)
    pose, matrix = cut.camera_from_world(0.3, 0.2), np.array([[1600.0, 0, 500], [0, 1600, 400], [0, 0, 1]])
    points = 0.01 * np.random.default_rng(0).standard_normal((50, 3))
    here, there = seen(pose, points, cut.K), seen(turned_pose(cut, pose, matrix), points, matrix)
    np.testing.assert_allclose(there.mean(0), here.mean(0), atol=0.3)
    assert np.ptp(there, 0) == pytest.approx(np.ptp(here, 0), rel=0.15)


def written(path: Path, size: tuple[int, int], tags: dict[int, object]) -> Path:
    image, exif = Image.new("RGB", size, (90, 90, 90)), Image.Exif()
    exif.get_ifd(IFD.Exif).update(tags)
    image.save(path, exif=exif)
    return path


FILM = {Base.FocalLengthIn35mmFilm: 26}
PLANE = {
    Base.FocalLength: 5.0,
    Base.FocalPlaneXResolution: 1000.0,
    Base.FocalPlaneYResolution: 1000.0,
    Base.FocalPlaneResolutionUnit: 3,  # 100 pixels a millimetre
}
OF_FILM = 26 / math.hypot(36, 24) * 500  # of 400 x 300 pixels


@pytest.mark.parametrize(
    ("tags", "focal"),
    [
        (FILM, OF_FILM),
        (FILM | {Base.ExifImageWidth: 400, Base.ExifImageHeight: 300}, OF_FILM),
        (FILM | {Base.ExifImageWidth: 300, Base.ExifImageHeight: 400}, OF_FILM),  # turned upright since
        (FILM | {Base.ExifImageWidth: 416, Base.ExifImageHeight: 304}, OF_FILM),  # JPEG's blocks
        (FILM | {Base.ExifImageWidth: 4032, Base.ExifImageHeight: 3024}, None),  # resized or cropped
        (FILM | {Base.ExifImageWidth: 800, Base.ExifImageHeight: 300}, None),  # cropped
        (PLANE, 500.0),
        (PLANE | {Base.FocalPlaneResolutionUnit: 2}, 5.0 * 1000 / 25.4),
        (PLANE | {Base.FocalPlaneResolutionUnit: 4, Base.FocalPlaneXResolution: 100.0}, 500.0),
        (PLANE | {Base.ExifImageWidth: 4032, Base.ExifImageHeight: 3024}, None),
        (PLANE | {Base.FocalLengthIn35mmFilm: 43}, 500.0),  # 496.9: they agree, and this one is exact
        (PLANE | FILM, OF_FILM),  # they do not
        (PLANE | {Base.FocalLengthIn35mmFilm: 0}, 500.0),  # 0 stands for unknown
        ({Base.FocalLength: 5.0}, None),
        ({Base.FocalLengthIn35mmFilm: 0}, None),
        (PLANE | {Base.FocalPlaneXResolution: 0.0}, None),
    ],
)
def test_a_focal_length_is_that_of_the_picture_as_it_is(
    tags: dict[int, object], focal: float | None, tmp_path: Path
) -> None:
    found = focal_of(written(tmp_path / "photo.jpg", (400, 300), tags))
    assert found == (None if focal is None else pytest.approx(focal, rel=1e-4))
