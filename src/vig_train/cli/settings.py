"""Settings of the verbs of classes and networks: a dataclass each, from which the command line is derived."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vig_train import METHODS, Method
from vig_world import Split


@dataclass(frozen=True)
class Build:
    """Make a class pack from meshes of one kind of thing; can be interrupted and run again.

    These findings can be overruled: --turn and --drop take the numbers of build/2-upright.png.
    """

    meshes: tyro.conf.Positional[Path]
    """A folder of meshes (.glb, .gltf, .obj, .ply, .off, .stl) in any pose, unit and topology; or one such
    file, whose shape is then exact; or a furniture catalogue of Sweet Home 3D, or a folder of such, with
    words that pick models: catalogue.sh3f:car."""
    out: Path
    """Folder of the pack."""
    name: str | None = None
    """Of the class; by default the pack's folder's."""
    up: str | None = None
    """The axis that points up in most of the files, such as y or z; by default it is found."""
    front: str | None = None
    """The axis that the front faces in most of the files, such as +x (-z is written --front=-z); by default
    the side that reaches out farther."""
    shows: str = ""
    """Name of the part in front, such as "the handle": for messages."""
    symmetry: Literal["none", "half-turn", "any-turn"] | None = None
    """The turn about the vertical under which such things look the same; by default it is found."""
    length: float | None = None
    """Longest side of the mean shape, metres; 0.2 by default, as the files' units are not trusted, but of a
    single glTF file its own."""
    turn: tuple[str, ...] = ()
    """NUMBER:DEGREES, such as 7:90: turn a mesh by so much about the vertical, counter-clockwise."""
    drop: tuple[int, ...] = ()
    """Numbers of meshes to leave out."""
    vertices: int = 2600
    """Of the shapes, about: fits take time in proportion."""
    places: tuple[str, ...] = ()
    """Zones of the generator's rooms where such things stand, such as floor for chairs; by default where
    tableware does."""
    materials: bool = True
    """Leave out the colours and textures of the files, which training otherwise shows: they tell front from
    back."""
    recognizer: bool = True
    """Train no quick recognizer, which otherwise takes two minutes of two idle cores and lets
    `vig fit --class PACK` find the object and its view by itself."""
    workers: int | None = None
    """Processes that draw images for it; one per CPU by default."""
    json: bool = False
    """Print one JSON object at the end."""


@dataclass(frozen=True)
class Train:
    """Train a recognition network on datasets; continues where it was stopped."""

    dataset: tuple[Path, ...]
    """Folders of datasets with a train split."""
    out: Path = Path("vig-train")
    """Folder for weights and checkpoint."""
    object_class: Annotated[str, tyro.conf.arg(name="class")] = "teapot"
    """A packaged class or the folder of a class pack: the datasets'."""
    start: Path | None = None
    """Weights to begin with, of an earlier training; by default only the packaged teapot's trunk."""
    studio: int = 24
    """Images of the studio in each step, beside --batch of the datasets; 0: these as they are."""
    distinct: int = 0
    """Draw so many before the training, in OUT, from which each step takes its own; 0: fresh ones for
    each step. Drawing takes most of the time, on a GPU nearly all."""
    batch: int = 40
    """Images of the datasets in each step."""
    level: float = 0.6
    """Share of the images drawn that are seen from about the horizon."""
    occluded: float = 0.6
    """Share that have things before the object, which hide up to 0.8 of it."""
    absent: float = 0.15
    """Share that show something else."""
    props: Path | None = None
    """Models to put before and behind their objects: a folder of meshes, or furniture catalogues."""
    frozen: int = 3
    """Stages of the trunk, of five, that stay as they are: with 5 heads and mask are trained alone."""
    mask_alone: bool = False
    """Train a mask's decoder that sees the whole image, and it alone: all else stays as it is in --start."""
    map_alone: bool = False
    """Train the map by which objects are found in photos, and fit the presence head to its images: all else
    stays as in --start. Without a map, which a training of other parts does not make, weights need a box or a
    mask of each object. It goes without --epochs, --rate, --batch and --frozen."""
    others: tuple[str, ...] = ()
    """With --map-alone, other classes, packaged or folders of packs, that must not be taken for this one."""
    rate: float = 2e-3
    """The highest learning rate; less to go on with weights that are good."""
    workers: int = 1
    """Processes that draw."""
    epochs: int = 18
    """Passes over the data."""
    seed: int = 0
    """Seed of initial weights, order and augmentation."""
    json: bool = False
    """Print one JSON object at the end."""


@dataclass(frozen=True)
class TrainClass:
    """Give a class pack its recognition weights in a quarter of an hour: images of the studio, training,
    calibration, errors on images that none of it saw, the card. Continues where it was stopped; run again
    with more minutes it begins with the images that are there. What it makes on the way lies in
    PACK/training, which can be removed when it is done."""

    pack: tyro.conf.Positional[Path]
    """Folder of the class pack."""
    minutes: float = 15.0
    """How long it may take, about."""
    props: Path | None = None
    """Models of other things to put before and behind yours: a folder of meshes, or furniture catalogues as
    `vig class build` takes them, such as /usr/share/sweethome3d/furniture."""
    seed: int = 0
    """Of the images and the training."""
    workers: int | None = None
    """Processes and threads; one per CPU by default."""
    json: bool = False
    """Print one JSON object at the end."""


@dataclass(frozen=True)
class CheckClass:
    """Measure a class on your own labelled photos, and put the table on the pack's card.

    labels.json is a list of objects: {"photo": "a.jpg", "box": [x, y, w, h], "azimuth_deg": 30,
    "elevation_deg": 10, "silhouette": "a_outline.png", "visible": "a_seen.png", "shape": "estate"}. Of these
    silhouette, visible (where something is before it), shape, which groups photos, and box may be left out.
    Azimuth 0 shows the front to the right, 90 to the eye.
    """

    pack: tyro.conf.Positional[str]
    """A class pack's folder, or a packaged class."""
    photos: tyro.conf.Positional[Path]
    """Folder of the photos."""
    labels: tyro.conf.Positional[Path | None] = None
    """labels.json; by default that in the folder."""
    find: bool = False
    """Leave the boxes out: the object is to be found."""
    tolerance: float = 15.0
    """Error of azimuth, degrees, up to which a trusted view counts as right."""
    calibrate: bool = False
    """Also set temperature and threshold of the confidence in views, in the pack, by 30 photos or more."""
    workers: int | None = None
    """Processes; one by default."""
    json: bool = False
    """Print one JSON object in place of the table."""


@dataclass(frozen=True)
class Calibrate:
    """Calibrate confidences and deviations (no camera) of a network and of fits on photos that training never
    saw. Writes into the weights, and calibration.json and reliability.png beside them; a class pack's
    calibration.json is used by every fit."""

    datasets: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of datasets, or none; for the fits each has the same weight, whatever its size."""
    weights: Path
    """The weights to calibrate; of a class pack, or a training run."""
    split: Literal["train", "validation"] = "validation"
    """Which split of them; test photos are not for calibration."""
    studio: int = 300
    """Photos that are drawn in the studio, of the split's designs, some without the object; 0: none."""
    seed: int = 1
    """Seed of the studio's photos."""
    props: Path | None = None
    """Models to put before and behind their objects: a folder of meshes, or furniture catalogues."""
    object_class: Annotated[str, tyro.conf.arg(name="class")] = "teapot"
    """A packaged class or the folder of a class pack."""
    workers: int | None = None
    """Fits at a time; one per CPU by default."""
    json: bool = False
    """Print one JSON object at the end."""


@dataclass(frozen=True)
class Evaluate:
    """Measure methods on a dataset: errors.csv per image, the paper's Table 1 as table.json and table.md.

    Safe to kill and run again: fits are kept in OUT/fits, 50 at a time. Those of other photos, weights or
    settings are made again; remove the folder after a change of the code.
    """

    dataset: Path
    """Folder of the dataset."""
    out: Path = Path("vig-evaluate")
    """Folder for the results."""
    split: Split = "test"
    """Which split."""
    methods: tuple[Method, ...] = METHODS
    """baseline: the training mean; rm: the recognition model; gaussian, robust, spatial: fits from it."""
    max_occlusion: float = 0.75
    """Only images with at most this share of the object hidden enter the table."""
    min_occlusion: float = 0.0
    """Only images with more than this share of the object hidden enter the table."""
    limit: int | None = None
    """Only the first so many images of the split."""
    object_class: Annotated[str, tyro.conf.arg(name="class")] = "teapot"
    """A packaged class or the folder of a class pack."""
    weights: Path | None = None
    """Recognition weights other than those of the class."""
    workers: int | None = None
    """Fits at a time; one per CPU by default."""
    cluster: str | None = None
    """Address of a Ray cluster that does the fits, in place of workers; auto: that of this machine."""
    json: bool = False
    """Print table.json instead of a table."""
