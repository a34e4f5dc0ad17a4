"""`vig fit`: photos explained, a folder each."""

from __future__ import annotations

import json
import sys
import time
from typing import Any

from vig.cli.settings import Fit
from vig.errors import UserError


def fit(settings: Fit) -> int:
    """`vig fit`."""
    from vig.cli.explaining import Explainer, parse_box, result_folders

    box = None if settings.box is None else parse_box(settings.box)
    folders = result_folders(settings.images, settings.out)
    explainer = Explainer(
        settings.object_class, settings.likelihood, settings.optimizer, not settings.no_self_shadow
    )
    results, failures = {}, 0
    for image, folder in zip(settings.images, folders, strict=True):
        try:
            started = time.monotonic()
            described, _ = explainer(image, folder, box, settings.framing)
        except UserError as error:
            print(f"vig: {error}", file=sys.stderr)
            failures += 1
            continue
        results[str(image)] = described | {"folder": str(folder)}
        if not settings.json:
            print(_line(image.name, described, time.monotonic() - started))
    if settings.json:
        print(json.dumps({"results": results, "folder": str(settings.out)}, indent=2))
    elif results:
        print(settings.out)
    return 2 if failures else 0


def _line(name: str, described: dict[str, Any], seconds: float) -> str:
    hidden = described["hidden_fraction"]
    colour = ", ".join(f"{c:.2f}" for c in described["albedo"])
    return (
        f"{name}: azimuth {described['azimuth_deg']:.1f}, elevation {described['elevation_deg']:.1f} degrees,"
        f" albedo ({colour}), {'nothing seen' if hidden is None else f'{hidden:.0%} hidden'};"
        f" {described['verdict']}: {described['reason']} ({seconds:.1f} s)"
    )
