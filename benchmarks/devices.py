"""The processor and a GPU side by side: `python -m benchmarks.devices [--json FILE] [--rounds N]`.

Of each device that is there, kernels warm: the network in batches, the objective with gradient and normal
matrix in batches, one photograph's whole fit, and a picture of the renderer with its gradient. The processor
computes on one thread. Medians and interquartile ranges; the photos are the eight packaged examples.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.case import STANDARD_SIZE, make_case
from benchmarks.measuring import metric, report, write
from vig.inference import ExplainSettings, explain_one, resolve
from vig.inference.explain import load_fit_kernels
from vig.inference.posterior import objectives_of
from vig.photo.images import read_photo
from vig.recognition import Recognizer
from vig.renderer import MeshObject, Pinhole, Scene, Topology, render
from vig.scene import ObjectClass
from vig_app.examples import example_photos

POINTS = (1, 8, 64, 512)
PHOTOS = (8, 64)


def measure(device: str, rounds: int) -> list[dict[str, Any]]:
    """All metrics of one device, named after it."""
    torch.set_num_threads(1)
    teapot = ObjectClass.load("teapot")
    recognizer = Recognizer.of_class(teapot, device=device)
    settings = resolve(ExplainSettings(), teapot, photo=True)
    photos = torch.stack([torch.from_numpy(read_photo(example.photo)) for example in example_photos()])
    prediction = recognizer(photos)
    started = time.perf_counter()
    load_fit_kernels(teapot.shape_model.modes, device, settings.likelihood.density)
    found = [metric("kernels_s", [time.perf_counter() - started], "s")]
    for count in PHOTOS:
        batch = photos[torch.arange(count) % len(photos)]
        times = _times(lambda: recognizer(batch), device, rounds)  # noqa: B023
        found.append(metric(f"network_{count}_photos", times / count, "ms a photo"))
    objective = objectives_of(photos[0], prediction[:1], teapot, settings, (1.0,), None, device)[1.0]
    point = objective.point(prediction[:1].best())
    for count in POINTS:
        noise = torch.full((count,), settings.likelihood.sigma, device=device)
        photo = torch.zeros(count, dtype=torch.int32, device=device)
        points = point.repeat(count, 1)
        times = _times(lambda: objective(points, photo, noise), device, rounds)  # noqa: B023
        found.append(metric(f"objective_{count}_points", times / count, "ms a point"))
    index = iter(range(1 << 30))

    def fit() -> None:
        number = next(index) % len(photos)
        explain_one(photos[number], prediction[number : number + 1], teapot, settings, device=device)

    found.append(metric("fit", _times(fit, device, max(rounds, len(photos))), "ms"))
    found.append(metric("picture_with_gradient", _times(_picture(device), device, rounds), "ms"))
    return [each | {"name": f"{device}_{each['name']}"} for each in found]


def _picture(device: str) -> Callable[[], None]:
    """A picture of the renderer and the gradient of its squared error by vertices, colours and light."""
    case = make_case(STANDARD_SIZE)
    topology, eye = Topology.of(case.model.faces, case.model.mean, device=device), case.camera
    place = {"dtype": torch.float32, "device": device}
    vertices, albedo, light = (
        torch.as_tensor(each, **place).requires_grad_()
        for each in (case.points()[0], np.full((len(case.model.mean), 3), 0.5), case.truth.light[0].numpy())
    )
    camera = Pinhole(
        eye.width,
        eye.height,
        torch.full((2,), eye.focal, **place),
        torch.tensor([eye.cx, eye.cy], **place),
        torch.eye(3, **place),
        torch.zeros(3, **place),
    )
    photo = torch.as_tensor(case.photo, **place)

    def draw() -> None:
        rgb = render(Scene([MeshObject(vertices, topology, albedo, light=light)], camera)).rgb[0]
        torch.autograd.grad((rgb - photo).square().sum(), (vertices, albedo, light))

    return draw


def _times(call: Callable[[], object], device: str, rounds: int) -> np.ndarray:
    """Milliseconds of each of `rounds` calls, after two that do not count."""
    found = []
    for number in range(-2, rounds):
        started = time.perf_counter()
        call()
        if device != "cpu":
            torch.cuda.synchronize()
        if number >= 0:
            found.append(1000 * (time.perf_counter() - started))
    return np.array(found)


def main() -> None:
    """Measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--rounds", type=int, default=24)
    arguments = parser.parse_args()
    devices = ["cpu"] + ["cuda:0"] * torch.cuda.is_available()
    metrics = []
    for device in devices:
        if device != "cpu":
            print(torch.cuda.get_device_name(device))
        for row in measure(device, arguments.rounds):
            print("{name}: {value} +-{iqr} {unit}".format(**row), flush=True)
            metrics.append(row)
    if arguments.json:
        write(report(metrics, threads=1), arguments.json)


if __name__ == "__main__":
    main()
