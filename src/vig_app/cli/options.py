"""The options of `vig fit`, in groups."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from vig_app.exports import FORMATS
from vig_native import engine

_MODELS = "robust", "gaussian", "spatial"
LIKELIHOODS = (*_MODELS, *(name for name in engine.DENSITIES if name not in _MODELS))
"""The names of `vig.likelihood.LIKELIHOODS`, which loads the likelihood."""


@dataclass(frozen=True)
class CameraOptions:
    """The camera of the photos."""

    focal: float | None = None
    """Focal length in pixels of the photos; by default that of each one's EXIF data."""
    intrinsics: Annotated[str | None, tyro.conf.arg(name="K")] = None
    """fx,fy,cx,cy in pixels, the intrinsics of undistorted photos, in place of --focal."""
    cameras: Path | None = None
    """A JSON file with such a camera, or K, for each photo: {"photo.jpg": [fx, fy, cx, cy], ...}; or with one
    for all; or BOP's scene_camera.json."""


@dataclass(frozen=True)
class ModelOptions:
    """How to fit."""

    likelihood: Literal[LIKELIHOODS] = "spatial"  # type: ignore[valid-type]
    """The pixel model: robust allows for occluders, pixel by pixel; in spatial's mask neighbouring pixels are
    hidden or visible together; gaussian takes all of the object as visible. The name of a density that was
    added: spatial with it, without a calibration unless the class has one of such fits."""
    no_self_shadow: bool = False
    """Shade without self-shadowing and interreflection; docs/objective.md."""
    framing: Literal["auto", "fixed", "free"] = "auto"
    """Fit the image's shift and magnification too? auto: yes."""


@dataclass(frozen=True)
class VideoOptions:
    """Frames of one object."""

    track: bool = False
    """The photos are one folder or video of one object: follow it from frame to frame and smooth its views;
    --box is that of the first frame. docs/many.md."""
    live: str | None = None
    """With --track, in place of photos: a camera by its number, the address of a stream, a file played at its
    own speed, or - for standard input, until its end or Ctrl-C; writes track.csv, overlay.mp4, track.png."""
    timeout: float = 10.0
    """With --live: seconds without a frame after which the source is given up."""


@dataclass(frozen=True)
class PlaceOptions:
    """Places and classes of the objects."""

    box: str | None = None
    """x,y,w,h in pixels: a box round the whole object, hidden parts included; with several photos, the same
    for each. Without it the object is sought in the photo."""
    boxes: Path | None = None
    """A JSON file with a box for each photo: {"photo.jpg": [x, y, w, h], ...}, by the photos' file names; for
    several objects in one photo, a list of boxes, or of {"box": [x, y, w, h], "class": "mug"}."""
    labels: Path | None = None
    """Labels of the photos from an annotation tool, a file or folder of COCO, labelme or CVAT (XML 1.1 for
    images): masks, boxes and named points of the class, by the photos' file names; of several objects in a
    photo, with --objects, the boxes."""
    objects: int | None = None
    """Find up to so many objects in each photo, of any of the classes named, and explain them together."""
    object_class: Annotated[str, tyro.conf.arg(name="class")] = "teapot"
    """A packaged class or the folder of a class pack; with --objects several, such as teapot,mug."""
    mesh: Path | None = None
    """In place of a class, a mesh of this exact object, at --box or --mask, in any rotation; upright with
    --roll, or if of one colour without --mask. With print it is found without either (vig[match]).
    explanation.json then has camera_from_mesh, its pose."""
    meshes: tuple[Path, ...] = ()
    """In place of a class, meshes with colours of exact objects, or folders of them: each object is found in
    the photos (pip install "vig[match]"), or at --boxes that name its file as their class, such as cup."""
    length: float | None = None
    """With --mesh: its longest side, metres, where the file is in other units (only glTF is in metres)."""
    up: str | None = None
    """With --mesh: the axis of the file that points up in the photos, x -x y -y z or -z: of things that lie,
    too. By default it is estimated, which is printed."""


@dataclass(frozen=True)
class HintOptions:
    """Knowledge about one object."""

    mask: Path | None = None
    """A mask of where the object is seen, of the photo's size: white there, black elsewhere; or a folder with
    one for each photo, by its name with .png."""
    marks: Path | None = None
    """Scribbles on one photo, a PNG of its size: green where the object is seen, red where something else is,
    blue where the object is not even hidden."""
    visible: bool = False
    """Nothing hides any of the object."""
    points: tuple[str, ...] = ()
    """Where in one photo points are that the class names, hidden ones too: spout=120,80 handle=300,95."""
    azimuth: float | None = None
    """The eye's azimuth in degrees, to some 8 degrees: one of explanation.json's alternatives, say."""
    elevation: float | None = None
    """The eye's elevation in degrees, which is then held."""
    roll: float | None = None
    """By how far the photos are turned clockwise, degrees, which is then held."""
    pose: Path | None = None
    """Another tool's pose of the object in one photo: a JSON file with a 4 x 4 camera_from_object."""


@dataclass(frozen=True)
class RunOptions:
    """Output files, printed lines and number of processes."""

    out: Path = Path("vig-fit")
    """Folder for the results, one folder per photo."""
    export: tuple[Literal[FORMATS], ...] = ()  # type: ignore[valid-type]
    """Write these formats into each photo's folder, too; docs/explanation.md. With several photos also
    those of `vig export` for all."""
    files: tuple[str, ...] | None = None
    """Write these files of each photo alone, beside explanation.json and corrections.json, in place of those
    of an earlier result: overlay.png thumbnail.jpg mask.png render.png object.glb report.html. By default
    all; mask.png with --export, too, which names it. Not by default: texture_seen.png, what of object.glb's
    texture is from the photo."""
    full_size: bool = False
    """Write overlay.png as large as the photo; else its longer side has 2,048 pixels at most."""
    workers: int = 1
    """Processes that share the photos out."""
    cluster: str | None = None
    """Address of a Ray cluster that does the work, in place of workers; auto: that of this machine."""
    quiet: bool = False
    """Print the folder alone, and what went wrong."""
    log: Path | None = None
    """Also add the line of each photo, with the time, to this file."""
    json: bool = False
    """Print one JSON object instead of lines."""


@dataclass(frozen=True)
class FitCommand:
    """Explain photos of one object each, or of several. Writes numbers, pictures and the object in 3-D."""

    images: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Photos, folders of them, or patterns such as 'photos/*.jpg': any size, JPEG, PNG, TIFF, WebP, AVIF ...;
    videos, taken as their frames."""
    camera: CameraOptions = field(default_factory=CameraOptions)
    model: ModelOptions = field(default_factory=ModelOptions)
    video: VideoOptions = field(default_factory=VideoOptions)
    place: PlaceOptions = field(default_factory=PlaceOptions)
    hints: HintOptions = field(default_factory=HintOptions)
    run: RunOptions = field(default_factory=RunOptions)

    @property
    def work(self) -> str:
        """Return the function that does the work, see `Verb`."""
        tracked = self.video.track or self.video.live is not None
        return "vig_app.cli.track:track" if tracked else "vig_app.cli.fit:fit"

    @property
    def groups(self) -> tuple[Any, ...]:
        """Return all groups."""
        return self.camera, self.model, self.video, self.place, self.hints, self.run


def changed_options(*groups: Any) -> list[str]:
    """Return the names of options that do not have their default."""
    return [
        each.name for group in groups for each in fields(group) if getattr(group, each.name) != each.default
    ]
