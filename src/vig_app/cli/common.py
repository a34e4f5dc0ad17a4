"""Verbs of the command line: their settings, where packages put theirs, and what several of them need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from vig.io.errors import UserError
from vig_app.exports import FORMATS, RUN_FORMATS
from vig_native import engine

_MODELS = "robust", "gaussian", "spatial"
LIKELIHOODS = (*_MODELS, *(name for name in engine.DENSITIES if name not in _MODELS))
"""The names of `vig.likelihood.LIKELIHOODS`, which loads the likelihood."""


@dataclass(frozen=True)
class FitCommand:
    """Explain photos of one object each, or of several: a folder of numbers, pictures and the object."""

    images: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Photos, folders of them, or patterns such as 'photos/*.jpg': any size, JPEG, PNG, TIFF, WebP, AVIF ...;
    videos, taken as their frames."""
    track: bool = False
    """The photos are one folder or video of one object: follow it from frame to frame and smooth its views;
    --box is that of the first frame. docs/many.md."""
    live: str | None = None
    """With --track, in place of photos: a camera by its number, the address of a stream, a file played at its
    own speed, or - for standard input, until its end or Ctrl-C; writes track.csv, overlay.mp4, track.png."""
    timeout: float = 10.0
    """With --live: seconds without a frame after which the source is given up."""
    box: str | None = None
    """x,y,w,h in pixels: a box round the whole object, hidden parts included; with several photos, the same
    for each. Without it the object is sought in the photo."""
    boxes: Path | None = None
    """A JSON file with a box for each photo: {"photo.jpg": [x, y, w, h], ...}, by the photos' file names; for
    several objects in one photo, a list of boxes, or of {"box": [x, y, w, h], "class": "mug"}."""
    objects: int | None = None
    """Find up to so many objects in each photo, of any of the classes named, and explain them together."""
    object_class: Annotated[str, tyro.conf.arg(name="class")] = "teapot"
    """A packaged class or the folder of a class pack; with --objects several, such as teapot,mug."""
    mesh: Path | None = None
    """In place of a class, a mesh file of the very object: its views are tried all round, so that a --box or
    --mask must tell where it is. explanation.json then has its pose in the file's frame, camera_from_mesh."""
    length: float | None = None
    """With --mesh: its longest side, metres, where the file is in other units (only glTF is in metres)."""
    up: str | None = None
    """With --mesh: the axis of the file that points up in the photos, x -x y -y z or -z: of things that lie,
    too. By default it is estimated, which is printed."""
    focal: float | None = None
    """Focal length in pixels of the photos; by default that of each one's EXIF data."""
    intrinsics: Annotated[str | None, tyro.conf.arg(name="K")] = None
    """fx,fy,cx,cy in pixels, the intrinsics of undistorted photos, in place of --focal."""
    cameras: Path | None = None
    """A JSON file with such a camera, or K, for each photo: {"photo.jpg": [fx, fy, cx, cy], ...}; or with one
    for all; or BOP's scene_camera.json."""
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
    likelihood: Literal[LIKELIHOODS] = "spatial"  # type: ignore[valid-type]
    """The pixel model: robust allows for occluders, pixel by pixel; in spatial's mask neighbouring pixels are
    hidden or visible together; gaussian takes all of the object as visible. The name of a density that was
    added: spatial with it, without a calibration unless the class has one of such fits."""
    no_self_shadow: bool = False
    """Shade without self-shadowing and interreflection; docs/objective.md."""
    framing: Literal["auto", "fixed", "free"] = "auto"
    """Fit the image's shift and magnification too? auto: yes."""
    workers: int = 1
    """Processes that share the photos out."""
    cluster: str | None = None
    """Address of a Ray cluster that does the work, in place of workers; auto: that of this machine."""
    out: Path = Path("vig-fit")
    """Folder for the results, one folder per photo."""
    export: tuple[Literal[FORMATS], ...] = ()  # type: ignore[valid-type]
    """Write these formats into each photo's folder, too; docs/explanation.md. Of several photos with bop or
    coco also one file for all, as `vig export` does."""
    files: tuple[str, ...] | None = None
    """Write these files of each photo alone, beside explanation.json and corrections.json, in place of those
    of an earlier result: overlay.png thumbnail.jpg mask.png render.png object.glb report.html. By default
    all; mask.png with --export, too, which names it. Not by default: texture_seen.png, what of object.glb's
    texture is from the photo."""
    full_size: bool = False
    """Write overlay.png as large as the photo; else its longer side has 2,048 pixels at most."""
    quiet: bool = False
    """Print the folder alone, and what went wrong."""
    log: Path | None = None
    """Also add the line of each photo, with the time, to this file."""
    json: bool = False
    """Print one JSON object instead of lines."""


@dataclass(frozen=True)
class ExportCommand:
    """Write the results of many photos as one file in the format of another tool."""

    results: tyro.conf.Positional[Path]
    """Folder of `vig fit` of several photos."""
    to: tuple[Literal[RUN_FORMATS], ...]  # type: ignore[valid-type]
    """bop: bop.csv, the poses as BOP's evaluation reads them. coco: coco.json, images, categories and
    annotations with whole and visible masks."""
    out: Path | None = None
    """Folder for the files; by default that of the results."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True)
class ViewCommand:
    """Open a photo, or those of a run, on a page: draw a box, paint what is in front, choose a view, save."""

    photo: tyro.conf.Positional[Path]
    """A photo; or a folder of its results, to resume work on it; or that of a run, whose photos come in
    review order, the least sure first."""
    box: str | None = None
    """x,y,w,h in pixels: a box round the whole object; without it the object is sought in the photo."""
    object_class: Annotated[str | None, tyro.conf.arg(name="class")] = None
    """A packaged class or the folder of a class pack; by default teapot, or that of the results."""
    port: int = 8080
    """The next free one where it is taken."""
    host: Literal["127.0.0.1", "0.0.0.0"] = "127.0.0.1"
    """Where it is served: to this machine alone, or, 0.0.0.0, to all that reach it, as a container needs it
    (docker run --publish 127.0.0.1:8080:8080); whoever reaches it can write results."""
    no_open: bool = False
    """Do not open a browser."""
    out: Path | None = None
    """Folder of what is saved, in one of the photo's name; by default vig-fit, or that of the results."""
    json: bool = False
    """Print one JSON object with the page's address once it is served, instead of lines."""


@dataclass(frozen=True)
class Demo:
    """Explain the packaged example photos and print truth beside estimate."""

    out: Path = Path("vig-demo")
    """Folder for the results."""
    no_open: bool = False
    """Do not open the page of results in a browser, where there is a screen."""
    json: bool = False
    """Print one JSON object instead of a table."""


@dataclass(frozen=True)
class Gallery:
    """Make a page of photos and what vig explains in them, to slide and to turn: one file, offline."""

    results: tyro.conf.Positional[Path | None] = None
    """Folder of results of `vig fit` or `vig demo`, with report.html for each photo; without it, the packaged
    photos are explained."""
    out: Path = Path("vig-gallery")
    """Folder of the page, index.html."""
    no_open: bool = False
    """Do not open it in a browser, where there is a screen."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Doctor:
    """Versions, a check of the native code, and what is slow here and why: what a bug report needs."""

    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True)
class SchemaCommand:
    """Print the JSON schema of a file that vig writes."""

    file: tyro.conf.Positional[Literal["explanation"]]
    """explanation: explanation.json."""
    json: bool = False
    """It is one JSON object without this, too."""


class ExitCode(IntEnum):
    """How a command ended; docs/api.md has the table."""

    DONE = 0
    INCOMPLETE = 1
    """It ran, and something is not as it should be: some of the photos failed, a check found problems."""
    MISTAKE = 2
    """The user's, which one line on standard error names; nothing was done."""
    FAULT = 3
    """Vig's own, with a traceback."""
    INTERRUPTED = 130
    TERMINATED = 143
    """By SIGTERM, as by Ctrl-C (130)."""


GROUP = "vig.verbs"
"""Entry points under which a package adds its verbs, a tuple of (name, settings, work) of `Verb`."""


MESH_GROUP = "vig.meshes"
"""Entry points of functions that make a class pack of a mesh file: path, length, `say`, up in, folder out."""


def pack_of_mesh(mesh: Path, length: float | None, say: Callable[[str], None], up: str | None) -> Path:
    """The class pack of a mesh file; UserError where it is no mesh, or what makes packs is missing."""
    for point in entry_points(group=MESH_GROUP):
        folder: Path = point.load()(mesh, length, say, up)
        return folder
    raise UserError("expected the package vig_train, to read --mesh; it is not installed. Install vig anew.")


@dataclass(frozen=True)
class Verb:
    """One verb. Its work is imported when it is chosen, so that help is quick.

    name: `fit`, or `dataset make` for a verb of a group. settings: a dataclass, from which the arguments are
    derived. work: `module:function`, which takes the settings and returns the exit code.
    """

    name: str
    settings: type
    work: str

    def run(self, settings: Any) -> int:
        """Do the work with these settings; returns the exit code."""
        module, _, function = self.work.partition(":")
        return int(getattr(import_module(module), function)(settings))


def verbs_of_packages() -> tuple[Verb, ...]:
    """The verbs that installed packages bring, in the order of their entry points' names.

    A wheel names those of vig_paper, too, which is only in a clone.
    """
    points = sorted(entry_points(group=GROUP), key=lambda point: point.name)
    points = [point for point in points if find_spec(point.module.partition(".")[0])]
    return tuple(Verb(*verb) for point in points for verb in point.load())
