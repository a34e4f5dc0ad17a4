"""Results that a change of the code's structure must not change: explanations and samples of the worlds.

    python -m tests.golden.results          # says which differ from those on disk, to the last digit
    python -m tests.golden.results --write  # writes them anew, where a change of results is meant

Explanations are those of the packaged examples and of four photos of this folder, drawn by the generator
(`benchmarks.groups`, seeds 314 to 316 of the test split), each explained in another way. Of the worlds the
pixels, labels, scenes and latents of 20 samples are held by their SHA-256.
"""

import argparse
import hashlib
import json
import math
import platform
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from vig import Explainer, Hints, explain_together
from vig.inference import ExplainSettings
from vig.parallel import set_thread_count
from vig.photo import Window
from vig.scene import IMAGE_SIZE
from vig_app.examples import example_photos
from vig_world.dataset import read_dataset
from vig_world.generation.write import make_dataset

FOLDER = Path(__file__).parent
PHOTOS = FOLDER / "photos"
EXPLANATIONS, WORLDS = FOLDER / "explanations.json", FOLDER / "worlds.json"
WORLD_OPTIONS: dict[str, dict[str, Any]] = {
    "photo": {"world": "photo"},
    "photo through a camera": {"world": "photo", "photo": True},
    "paper": {"world": "paper"},
}
"""Arguments of `make_dataset` by the name of the world."""
SAMPLES, SEED = 20, 31
DEVIATIONS, MIN_TOLERANCE_DEG, SHARE_TOLERANCE = 4.0, 5.0, 0.1
"""By how much explanations may differ between kinds of processor, whose sums round otherwise, which fits
amplify: angles by so many of their stated deviations, or degrees where that is less; shares and confidences.
Between AVX512, AVX2 and plain arithmetic azimuths of trusted views differ by 2.7 deviations at the most."""


def machine() -> str:
    """The kind of processor and the numpy on which rounding depends."""
    found = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    kind = [platform.machine(), *found[-1:]]
    return f"{' '.join(kind)}, numpy {np.__version__}"


def explanations() -> dict[str, Any]:
    """The kind of machine, and what explanation.json holds of each photo."""
    teapot, mug = Explainer("teapot"), Explainer("mug")
    demo = Explainer("teapot", ExplainSettings(free_framing=False), recognizer=teapot.recognizer)
    results = {
        example.name: demo.explain(example.photo, window=Window(0, 0, IMAGE_SIZE))
        for example in example_photos()
    }
    results["pots"] = teapot.explain(PHOTOS / "pots.png")
    results["mug_behind_car"] = mug.explain(PHOTOS / "mug_behind_car.png", box=(119, 81, 93, 81))
    camera = {"fx": 500, "fy": 500, "cx": 170, "cy": 110}
    hints = Hints(elevation_deg=20, points={"handle": (186, 131)})
    results["brown_mug"] = mug.explain(PHOTOS / "brown_mug.png", (119, 81, 74, 72), hints=hints, K=camera)
    boxes = [(151, 110, 109, 107), (80, 151, 91, 104)]
    scene = explain_together(PHOTOS / "teapot_and_mug.png", [teapot, mug], boxes)
    results |= dict(zip(scene.names, scene.objects, strict=True))
    described = {name: explanation.to_dict() for name, explanation in results.items()}
    for explanation in described.values():
        explanation.pop("vig", None)
    return json.loads(json.dumps({"machine": machine(), **described, "scene": scene.to_dict()}))


def view_differences(expected: dict[str, Any], actual: dict[str, Any]) -> Iterator[str]:
    """Lines that say where two `explanations` contradict each other, on any processor.

    Views that are not trusted may be any of those that were returned.
    """
    if expected.keys() != actual.keys():
        yield f"expected the photos {sorted(expected)}; got {sorted(actual)}"
    for name in (expected.keys() & actual.keys()) - {"machine", "scene"}:
        one, other = expected[name], actual[name]
        views = [one] if one["verdict"] == "trusted" else [one, *one["alternatives"]]
        turn = min(abs(math.remainder(view["azimuth_deg"] - other["azimuth_deg"], 360.0)) for view in views)
        for key, difference in {
            "azimuth_deg": turn,
            "elevation_deg": abs(one["elevation_deg"] - other["elevation_deg"]),
            "hidden_fraction": abs(one["hidden_fraction"] - other["hidden_fraction"]),
            "confidence": abs(one["confidence"] - other["confidence"]),
        }.items():
            bound = SHARE_TOLERANCE
            if key in one["deviation"]:
                bound = max(DEVIATIONS * one["deviation"][key], MIN_TOLERANCE_DEG)
            if not difference <= bound:
                yield f"{name}/{key}: expected {one[key]}; got {other[key]}"


def worlds() -> dict[str, Any]:
    """Of each world the SHA-256 of what it shows on this kind of machine, and what depends little on it."""
    return {"machine": machine()} | {name: _world(options) for name, options in WORLD_OPTIONS.items()}


def _world(options: dict[str, Any]) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        make_dataset(folder, SAMPLES, SEED, split="test", workers=1, progress=False, **options)
        info = json.loads((Path(folder) / "info.json").read_text())["splits"]["test"]
        dataset = read_dataset(folder, "test")
        shown = [dataset.read(kind).tobytes() for kind in ("rgb", "depth", "mask", "mask_visib")]
        manifest = (Path(folder) / "test" / "files.sha256").read_text().splitlines()
        others = [line.encode() for line in manifest if not line.endswith(".png")]
        return {
            "shown_sha256": hashlib.sha256(b"".join([*shown, *others])).hexdigest(),
            "rejections": info["rejections"],
            "mean_image": dataset.images.mean((1, 2, 3)).round(2).tolist(),
            "azimuth_deg": np.rad2deg([spec.azimuth for spec in dataset.specs()]).round(6).tolist(),
        }


def differences(expected: Any, actual: Any, tolerance: float, path: str = "") -> Iterator[str]:
    """Lines that say where two trees of plain values differ: numbers by more than a share of their size."""
    if isinstance(expected, dict) and isinstance(actual, dict):
        for key in sorted({*expected, *actual}):
            if key in expected and key in actual:
                yield from differences(expected[key], actual[key], tolerance, f"{path}/{key}")
            else:
                yield f"{path}/{key} is {'missing' if key in expected else 'new'}"
    elif isinstance(expected, list) and isinstance(actual, list) and len(expected) == len(actual):
        for place, (one, other) in enumerate(zip(expected, actual, strict=True)):
            yield from differences(one, other, tolerance, f"{path}/{place}")
    elif isinstance(expected, float) and isinstance(actual, float) and tolerance:
        if not math.isclose(expected, actual, rel_tol=tolerance, abs_tol=tolerance):
            yield f"{path}: expected {expected}; got {actual}"
    elif expected != actual:
        yield f"{path}: expected {expected}; got {actual}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--write", action="store_true", help="write the results of this code as the golden ones"
    )
    write = parser.parse_args().write
    set_thread_count(1)
    found = []
    for path, compute in ((EXPLANATIONS, explanations), (WORLDS, worlds)):
        actual = compute()
        if write:
            path.write_text(json.dumps(actual, indent=1) + "\n")
        else:
            found += differences(json.loads(path.read_text()), actual, 0.0, path.name)
    print("\n".join(found) or ("written" if write else "the same to the last digit"))
    raise SystemExit(bool(found))


if __name__ == "__main__":
    main()
