"""`vig fit`: photos explained, a folder each."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from vig.cli.common import Fit
from vig.errors import UserError
from vig.explainer import Box, Explainer, checked_box
from vig.explanation import Explanation
from vig.inference import ExplainSettings
from vig.likelihood import LIKELIHOODS
from vig.optimizers import OPTIMIZERS

FRAMINGS = {"auto": None, "fixed": False, "free": True}


def fit(settings: Fit) -> int:
    """Explain every photo into a folder of its own; returns the exit code."""
    if not settings.images:
        raise UserError("expected at least one photo, such as `vig fit photo.jpg`; got none.")
    box = None if settings.box is None else parse_box(settings.box)
    folders = result_folders(settings.images, settings.out)
    how = ExplainSettings(
        LIKELIHOODS[settings.likelihood],
        self_shadow=not settings.no_self_shadow,
        free_framing=FRAMINGS[settings.framing],
        optimizer=OPTIMIZERS[settings.optimizer],
    )
    explainer = Explainer(settings.object_class, how)
    results, failures = {}, 0
    for image, folder in zip(settings.images, folders, strict=True):
        try:
            started = time.monotonic()
            explanation = explainer.explain(image, box)
            explanation.save(folder)
        except UserError as error:
            print(f"vig: {error}", file=sys.stderr)
            failures += 1
            continue
        results[str(image)] = explanation.to_dict() | {"folder": str(folder)}
        if not settings.json:
            print(_line(image.name, explanation, time.monotonic() - started))
    if settings.json:
        print(json.dumps({"results": results, "folder": str(settings.out)}, indent=2))
    elif results:
        print(settings.out)
    return 2 if failures else 0


def parse_box(text: str) -> Box:
    """ "x,y,w,h" as four numbers; UserError when it is not."""
    try:
        return checked_box(text.replace(" ", "").split(","))
    except UserError:
        raise UserError(f"expected --box x,y,w,h in pixels, such as 40,30,200,160; got '{text}'") from None


def _line(name: str, explanation: Explanation, seconds: float) -> str:
    hidden = explanation.hidden_fraction
    colour = ", ".join(f"{c:.2f}" for c in explanation.latents.albedo[0].tolist())
    return (
        f"{name}: azimuth {explanation.azimuth_deg:.1f}, elevation {explanation.elevation_deg:.1f} degrees,"
        f" albedo ({colour}), {'nothing seen' if hidden is None else f'{hidden:.0%} hidden'};"
        f" {explanation.verdict.name.lower()}: {explanation.reason} ({seconds:.1f} s)"
    )


def result_folders(images: tuple[Path, ...], out: Path) -> list[Path]:
    """A folder for each photo, named after it; a number is added where two photos share a name."""
    if not images:
        raise UserError("expected at least one photo; got none. Name one: vig fit photo.jpg")
    used: set[str] = set()
    folders = []
    for image in images:
        name, number = image.stem, 2
        while name in used:
            name, number = f"{image.stem}-{number}", number + 1
        used.add(name)
        folders.append(out / name)
    return folders
