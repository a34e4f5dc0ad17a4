"""Verbs of the command line: their settings, where packages put theirs, and what several of them need."""

from dataclasses import dataclass, fields, is_dataclass
from enum import IntEnum
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import tyro
from docstring_parser import parse_from_object

from vig_app.exports import FORMATS


@dataclass(frozen=True)
class ExportCommand:
    """Write the results of many photos as files in the format of another tool."""

    results: tyro.conf.Positional[Path]
    """Folder of `vig fit` of several photos."""
    to: tuple[Literal[FORMATS], ...]  # type: ignore[valid-type]
    """bop: bop.csv, the poses as BOP's evaluation reads them. coco: coco.json, whole and visible masks as run
    lengths, scores. coco-annotations: two files of polygons and keypoints for CVAT, Label Studio, FiftyOne.
    cvat: its XML, masks and cuboids. labelme: a JSON file for each photo. yolo: segments and boxes.
    Others have files for each photo: vig fit --export."""
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
class ServeCommand:
    """Explain photos over HTTP, and pre-annotate in Label Studio (pip install "vig[serve]")."""

    object_class: Annotated[str, tyro.conf.arg(name="class")] = "teapot"
    """Packaged classes or folders of class packs, the default first, such as mug,teapot."""
    host: str = "127.0.0.1"
    """Address to listen at; beyond this machine, such as 0.0.0.0, a key is needed."""
    port: int = 8000
    """Port to listen at."""
    key: str | None = None
    """Key that requests must have as X-API-Key; by default that of the environment's VIG_KEY."""
    megabytes: float = 25.0
    """Size of a request at most."""
    per_minute: int = 600
    """Requests of one address in a minute at most."""
    label_studio: str | None = None
    """Address of the Label Studio whose photos may be fetched; its token is LABEL_STUDIO_API_KEY of the
    environment."""
    json: bool = False
    """Print one JSON object with the address, instead of a line."""


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

    results: tyro.conf.Positional[Path]
    """Folder of results of `vig fit` or `vig demo`, with report.html for each photo."""
    out: Path = Path("vig-gallery")
    """Folder of the page, index.html."""
    no_open: bool = False
    """Do not open it in a browser, where there is a screen."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True)
class BopCommand:
    """Find the poses of known objects in a data set in BOP's format, as bop_toolkit scores them."""

    dataset: tyro.conf.Positional[Path]
    """Its folder."""
    detections: Path | None = None
    """Where the objects are seen: a JSON list with scene_id, image_id, category_id, score and segmentation,
    as BOP's default detections. Without it the masks mask_visib of the data set, which are the truth."""
    targets: Path | None = None
    """JSON list of scene_id, im_id, obj_id and inst_count; by default its test_targets_bop19.json."""
    meshes: Path | None = None
    """Folder of obj_000001.ply ... with colours or textures, and models_info.json; by default its models."""
    split: str = "test"
    """Folder of its scenes."""
    out: Path = Path("vig-bop")
    """Folder of the results, vig_DATASET-SPLIT.csv."""
    workers: int = 1
    """Processes that share the images out."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Doctor:
    """Versions, a check of the native code, and what is slow here and why: what a bug report needs."""

    clean: bool = False
    """Remove vig's cache, such as the meshes of earlier fits; what is needed again is made anew."""
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


@dataclass(frozen=True)
class Verb:
    """One verb. Its work is imported when it is chosen, so that help is quick.

    name: `fit`, or `dataset make` for a verb of a group. settings: a dataclass, from which the arguments are
    derived; its `work`, where it has one, is done in place of that of the verb. work: `module:function`,
    which takes the settings and returns the exit code.
    """

    name: str
    settings: type
    work: str

    def run(self, settings: Any) -> int:
        """Do the work with these settings; returns the exit code."""
        module, _, function = getattr(settings, "work", self.work).partition(":")
        return int(getattr(import_module(module), function)(settings))


@cache
def format_help(settings: type) -> type:
    """Join the lines of each option's help, and hide empty defaults and flags'; returns the dataclass."""
    settings.__annotations__ = get_type_hints(settings, include_extras=True)
    params = [each for kind in settings.__mro__[-2::-1] for each in parse_from_object(kind).params]
    described = {each.arg_name: each.description or "" for each in params}
    for each in fields(settings):
        kind = settings.__annotations__[each.name]
        if is_dataclass(kind):
            format_help(kind)  # type: ignore[arg-type]
            continue
        empty = each.default in ("", ()) or any(each.default is value for value in (None, False, True))
        words = " ".join(described.get(each.name, "").split()) or None
        options = tyro.conf.arg(help=words, help_behavior_hint="" if empty else None)
        settings.__annotations__[each.name] = Annotated[kind, options]
    return settings


def verbs_of_packages() -> tuple[Verb, ...]:
    """Return the verbs that installed packages bring, in the order of their entry points' names.

    A wheel names those of vig_paper, too, which is only in a clone.
    """
    points = sorted(entry_points(group=GROUP), key=lambda point: point.name)
    points = [point for point in points if find_spec(point.module.partition(".")[0])]
    return tuple(Verb(*verb) for point in points for verb in point.load())
