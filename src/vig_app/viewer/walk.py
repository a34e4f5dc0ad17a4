"""The items of `vig view`: one photo, a result, or a run's photos in review order."""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from vig.explainer import Box, Explainer
from vig.io.checks import read_json, reading
from vig.io.errors import UserError
from vig.photo.decoding import open_picture
from vig.record import read_explanation
from vig_app.corrections import CORRECTIONS, State, read_corrections
from vig_app.exports import export_explanation, export_run, formats_in
from vig_app.report.folder import FILES, OPTIONAL_FILES
from vig_app.report.folder_page import review_order, write_run_page
from vig_app.report.sheet import write_sheets
from vig_app.results import TABLES, name_of, read_results, without_dismissed, write_table
from vig_app.runs import Task, ledger_of
from vig_app.runs.work import row_of
from vig_app.viewer.session import Session

BOX = ("box_x", "box_y", "box_width", "box_height")


@dataclass
class Item:
    """A photo's object.

    Attributes:
        name: Name of the item.
        folder: Folder of its results.
        found: `verdict` and `confidence`, and further columns of the run's table; empty for a new photo.
        photo: Its file, class and prior knowledge, where no file in the folder has them.
        corrected: Whether it was corrected by hand, and saved.
        box: Box in place of the known one.
        formats: Formats of exports that its folder has, or had before it was marked as not there.
    """

    name: str
    folder: Path
    found: dict[str, Any] = field(default_factory=dict)
    photo: tuple[Path, str, State] | None = None
    corrected: bool = False
    box: Box | None = None
    formats: set[str] = field(default_factory=set)

    def read(self) -> tuple[Path, str, State]:
        """Return the photo, class and state; UserError where they cannot be read."""
        photo, object_class, state = self.photo if self.photo is not None else State.read(self.folder)
        photo = photo.resolve()  # without the way round by the folder
        photo = photo.relative_to(Path.cwd()) if photo.is_relative_to(Path.cwd()) else photo
        return photo, object_class, state if self.box is None else replace(state, box=self.box, found=None)

    def others(self) -> np.ndarray | None:
        """Return pixels (H, W) bool in which a run of several objects in a photo saw the others."""
        if not (self.folder.parent / "scene.json").exists():
            return None
        path = self.folder.parent / "mask.png"
        with (
            reading(path, "the mask of several objects", "Run `vig fit` again."),
            open_picture(path) as image,
        ):
            numbers = np.asarray(image)
        own = [self.folder.name.split("-")[0]]
        for about in self.folder.parent.glob("*-*/explanation.json"):
            own += [about.parent.name.split("-")[0]] * (read_json(about)["verdict"] == "absent")
        return ~np.isin(numbers, [0, *map(int, own)])


class Walk:
    """Some items, of which one is open."""

    def __init__(self, items: list[Item], run: Path | None = None):
        """Begin before the first item; `run` is the folder of the items' run, if any."""
        self.items, self.run = items, run
        self.place = -1
        self.session: Session
        self.saved = False
        self._explainer = cache(Explainer)
        self._ahead: tuple[int, Session] | None = None

    @staticmethod
    def of_photo(photo: Path, object_class: str, out: Path) -> "Walk":
        """Walk a photo, whose results will be in a folder."""
        return Walk([Item(photo.name, out, photo=(photo, object_class, State()))])

    @staticmethod
    def of_folder(folder: Path) -> "Walk":
        """Walk results: those of a photo or an object, of several objects in a photo, or of a run.

        Raises:
            UserError: It holds none, or they cannot be read.
        """
        if (folder / CORRECTIONS).exists():
            return Walk([Item(folder.name, folder)])
        if (folder / TABLES[0]).exists():
            rows = read_results(folder)
            items = [_of_row(folder, row) for row in sorted(rows, key=review_order) if row["error"] is None]
            if not items:
                raise UserError(
                    f"expected a run with explained photos; '{folder}' has {len(rows)} that were not."
                    " See errors in its results.csv."
                )
            return Walk(items, folder)
        paths = [*folder.glob(f"*/{CORRECTIONS}"), *folder.glob(f"*/*/{CORRECTIONS}")]
        if not paths:
            raise UserError(
                f"expected a photo, a result or a run of `vig fit`; '{folder}' holds no {CORRECTIONS} or"
                f" {TABLES[0]}. Name a photo, or run `vig fit` on it first."
            )
        return Walk(sorted(map(_of_result, sorted(paths)), key=lambda item: review_order(item.found)))

    def open(self, place: int) -> None:
        """Open an item; UserError where it cannot be, and the one before stays open."""
        self.session = self._session(place)
        self.place = place

    def prepare(self) -> None:
        """Fit the next item in advance."""
        following = self.place + 1
        if following < len(self.items):
            with suppress(UserError):  # which is reported when it is opened
                self._ahead = following, self._session(following)

    def _session(self, place: int) -> Session:
        if self._ahead is not None and self._ahead[0] == place:
            return self._ahead[1]
        item = self.items[place]
        photo, object_class, state = item.read()
        return Session(self._explainer(object_class), photo, state, item.others())

    def step(self, by: int) -> str:
        """Open the next item in a direction, +1 or -1, that can be; returns why others could not be, and
        which of its hints are left out.

        Raises:
            UserError: There is none.
        """
        failures: list[str] = []
        place = self.place + by
        while 0 <= place < len(self.items):
            try:
                self.open(place)
                if self.run is not None and self.items[place].photo is not None:
                    failures.append("It was fitted with a mask, marks or a pose, which are left out here.")
                return " ".join(failures)
            except UserError as error:
                if self.place < 0 and place == len(self.items) - 1:  # the last one of several is enough
                    raise
                failures.append(f"{self.items[place].name} is left out: {error}")
                place += by
        raise UserError(" ".join([*failures, f"That was the {'last' if by > 0 else 'first'} one."]))

    def save(self) -> Path:
        """Write the open result into its folder, the files and exports that are there, and into the table of
        its run, whose exports are written anew, too.

        Raises:
            UserError: Something cannot be written; exports are written last.
        """
        item, explanation = self.items[self.place], self.session.explanation
        files = [name for name in (*FILES, *OPTIONAL_FILES) if (item.folder / name).exists()]
        item.formats |= set(formats_in(item.folder))
        if self.run is None:
            self.session.save(item.folder, files or None)
        else:
            with ledger_of(self.run):  # while no run writes there
                rows = read_results(self.run)  # others may have written since it was opened
                self.session.save(item.folder, files or None)
                row = row_of(Task(self.session.path, item.folder), explanation)
                stay = ("photo", "folder", "object", "seconds")
                item.found.update({name: value for name, value in row.items() if name not in stay})
                by_folder = {row["folder"]: row for row in rows} | {item.found["folder"]: item.found}
                write_table(self.run, without_dismissed(by_folder.values()))
        item.photo = item.box = None  # which are in its corrections.json now
        item.corrected = self.saved = True
        export_explanation(explanation, item.folder, sorted(item.formats), self.session.path.name)
        if self.run is not None:
            export_run(self.run, formats_in(self.run, of_run=True))
        return item.folder

    def close(self) -> None:
        """Write the pages of a run of which something was saved."""
        if self.run is not None and self.saved:
            with ledger_of(self.run):
                rows = read_results(self.run)
                write_run_page(self.run, rows)
                write_sheets(self.run, rows)

    def objects(self) -> list[dict[str, Any]]:
        """Return the box, name and number of the other items that are of the photo that is open."""
        here = self.items[self.place].folder
        if not (here.parent / "scene.json").exists():
            return []
        return [
            {"box": box, "name": item.folder.name, "item": number}
            for number, item in enumerate(self.items)
            if item.folder != here and item.folder.parent == here.parent
            if None not in (box := [item.found.get(name) for name in BOX])
        ]


def _of_row(run: Path, row: dict[str, Any]) -> Item:
    """Return the item of a row of a run's table."""
    folder = run / row["folder"]
    photo = None
    if not (folder / CORRECTIONS).exists():  # it was given a mask, marks or a pose
        photo = Path(row["photo"]), row["class"], State()
    return Item(name_of(row), folder, row, photo, _is_corrected(folder))


def _of_result(path: Path) -> Item:
    """Return the item of a folder of results, by its corrections.json."""
    folder = path.parent
    described = read_explanation(folder)
    described |= dict(zip(BOX, described["box"] or [], strict=False))
    return Item(folder.name, folder, described, corrected=_is_corrected(folder))


def _is_corrected(folder: Path) -> bool:
    return any(not correction.name for correction in read_corrections(folder))
