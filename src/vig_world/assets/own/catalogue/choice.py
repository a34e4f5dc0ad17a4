"""The models of catalogues that an argument such as `catalogue.sh3f:car,truck` names."""

import difflib
import os
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from vig.io.errors import UserError
from vig.known_object.packs import SUFFIXES as MESH_SUFFIXES
from vig_world.assets.own.catalogue.reading import SUFFIX, CatalogueModel, read_catalogue


@dataclass(frozen=True)
class Choice:
    """Catalogues, and the words by which models of theirs are picked; no words: all models."""

    catalogues: tuple[Path, ...]
    words: tuple[str, ...] = ()

    def models(self) -> list[CatalogueModel]:
        """Return the models, in the order of the catalogues.

        Raises:
            UserError: A catalogue cannot be read or lists nothing, or a word picks nothing.
        """
        listed = [model for path in self.catalogues for model in read_catalogue(path)]
        if not listed:
            raise UserError(f"expected models in '{self.catalogues[0]}'; its list is empty. Take another.")
        if not self.words:
            return listed
        texts = [[_words(text) for text in (model.name, *model.tags, model.category)] for model in listed]
        picked: set[int] = set()
        for word in self.words:
            phrase = _words(word)
            fits = {n for n, of_model in enumerate(texts) if any(_holds(text, phrase) for text in of_model)}
            if not fits:
                raise UserError(_nothing_picked(word, listed))
            picked |= fits
        return [listed[number] for number in sorted(picked)]


def choice_of(source: str | Path) -> Choice | None:
    """Return the choice an argument names; None when it names a folder of meshes, or nothing that exists.

    Args:
        source: `catalogue.sh3f`, a folder of catalogues, or either with `:word,word`.

    Raises:
        UserError: A catalogue is missing, a folder with words has none, or words are missing.
    """
    path, words = split_words(str(source))
    if os.path.exists(source):
        path, words = str(source), None
    place = Path(path)
    if os.path.isdir(path):
        try:
            catalogues = tuple(sorted(each for each in place.iterdir() if _is_catalogue(each)))
            if words is None and (not catalogues or _has_meshes(place)):
                return None
        except OSError as error:
            raise UserError(f"{path}: cannot be listed ({error.strerror}). Check its permissions.") from error
        if not catalogues:
            raise UserError(
                f"expected catalogues ({SUFFIX}) in '{path}', from which ':{words}' picks; got none."
                " Leave the words out to take its meshes."
            )
    elif _is_catalogue(place):
        if not os.path.isfile(path):
            raise UserError(f"expected a furniture catalogue at '{path}'; got no such file. Check the path.")
        catalogues = (place,)
    else:
        return None
    if words is None:
        return Choice(catalogues)
    listed = tuple(sorted({" ".join(_words(word)) for word in words.split(",")} - {""}))
    if not listed:
        raise UserError(f"expected words after the colon of '{source}', such as :chair,table; got none.")
    return Choice(catalogues, listed)


def split_words(source: str) -> tuple[str, str | None]:
    """Split `PATH:words` at its last colon; the colon of a drive (`C:\\x.sh3f`) separates nothing."""
    path, colon, words = source.rpartition(":")
    is_drive = len(path) == 1 and path.isalpha()
    if not colon or not path or is_drive or "/" in words or "\\" in words:
        return source, None
    return path, words


def _is_catalogue(path: Path) -> bool:
    return path.suffix.lower() == SUFFIX


def _has_meshes(folder: Path) -> bool:
    return any(path.suffix.lower() in MESH_SUFFIXES for path in folder.rglob("*"))


def _words(text: str) -> list[str]:
    return re.findall(r"\w+", text.casefold())


def _holds(text: list[str], phrase: list[str]) -> bool:
    """Return whether words stand one after another in a text; a plural s or es counts for nothing."""
    starts = range(len(text) - len(phrase) + 1)
    return any(all(map(_same, text[start:], phrase)) for start in starts)


def _same(word: str, other: str) -> bool:
    short, long = sorted((word, other), key=len)
    return long in (short, f"{short}s", f"{short}es")


def _nothing_picked(word: str, listed: list[CatalogueModel]) -> str:
    counts = Counter(model.category for model in listed if model.category)
    shown = ", ".join(f"{category} ({count})" for category, count in counts.most_common(12))
    known = {each for model in listed for text in (model.name, *model.tags) for each in _words(text)}
    close = difflib.get_close_matches(word, sorted(known), 3, cutoff=0.7)
    return (
        f"expected a word of the names, tags or categories of {len(listed)} models; '{word}' picks none."
        + (f" Near to it: {', '.join(close)}." if close else "")
        + (f" Categories: {shown}." if shown else "")
    )
