"""Our renderer and our objective beside others: `python -m benchmarks.renderer [--json FILE]`.

The same teapot, camera and image size for all, in one process, on one thread and then on two, two meshes and
three image sizes, the measurements interleaved. What is compared and what is not: docs/results.md.
"""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import measuring
from benchmarks.case import SIZES, STANDARD_SIZE, Case, Ours, Rendered, make_case, set_threads
from benchmarks.measuring import interleaved
from benchmarks.peers import DEODR, MITSUBA, Peer

SUBDIVISIONS = (0, 1)
SECOND_THREADS = 2
FULL = "full_evaluation"

TITLES = {
    "render_forward": "vig: renderer, forward",
    "render_gradient": "vig: renderer, forward + gradient",
    "forward": "vig: objective",
    "gradient": "vig: objective and gradient",
    FULL: "vig: objective, gradient, normal matrix",
    "deodr_forward": "DEODR: forward",
    "deodr_gradient": "DEODR: forward + gradient",
    "deodr_rasterizer": "DEODR: compiled rasteriser alone, both ways",
    "mitsuba_forward": "Mitsuba: forward",
    "mitsuba_gradient": "Mitsuba: forward + gradient",
}
RATIOS = {
    "render_gradient_vs_deodr": ("deodr_gradient", "render_gradient"),
    "render_gradient_vs_mitsuba": ("mitsuba_gradient", "render_gradient"),
    "full_evaluation_vs_deodr": ("deodr_gradient", FULL),
    "full_evaluation_vs_deodr_rasterizer": ("deodr_rasterizer", FULL),
    "full_evaluation_vs_mitsuba": ("mitsuba_gradient", FULL),
    "gradient_vs_deodr": ("deodr_gradient", "gradient"),
    "forward_vs_deodr": ("deodr_forward", "forward"),
    "forward_vs_mitsuba": ("mitsuba_forward", "forward"),
}
"""Their time over ours: above 1 we are faster."""

BARS = {
    "render_gradient_vs_deodr": 3.0,
    "render_gradient_vs_mitsuba": 40.0,
    "full_evaluation_vs_deodr": 12.0,
    "full_evaluation_vs_mitsuba": 150.0,
}
"""The project's bars for the standard case."""

Calls = dict[str, Callable[[int], object]]
Metric = dict[str, Any]


def contenders(case: Case, peers: tuple[Peer, ...], threads: int) -> Calls:
    """The timed functions, checked: all cover the same pixels and have a gradient that is not zero."""
    set_threads(threads)
    drawn, mine = Rendered(case), Ours(case)
    calls: Calls = {"render_forward": drawn.forward, "render_gradient": drawn.gradient}
    calls |= {"forward": mine.forward, "gradient": mine.gradient, FULL: mine.full}
    gradients: dict[str, Any] = {"render_gradient": drawn.gradient(0), FULL: mine.full(0).gradient}
    pixels = {"render_gradient": drawn.covered(), FULL: mine.covered()}
    if DEODR in peers and threads == 1:  # it has no threads
        adapter = DEODR.load()
        whole, core = adapter.Deodr(case), adapter.DeodrRasterizer(case)
        calls |= {
            "deodr_forward": whole.forward,
            "deodr_gradient": whole.gradient,
            "deodr_rasterizer": core.gradient,
        }
        gradients |= {"deodr_gradient": whole.gradient(0), "deodr_rasterizer": core.gradient(0)}
        pixels["deodr_gradient"] = whole.covered()
    if MITSUBA in peers:
        adapter = MITSUBA.load()
        adapter.set_threads(threads)
        peer = adapter.Mitsuba(case)
        calls |= {"mitsuba_forward": peer.forward, "mitsuba_gradient": peer.gradient}
        gradients["mitsuba_gradient"] = peer.gradient(0)
        pixels["mitsuba_gradient"] = peer.covered()
    check(case.covered(), pixels, gradients)
    return calls


def check(expected: int, pixels: Mapping[str, int], gradients: Mapping[str, Any]) -> None:
    """RuntimeError unless all cover the expected pixels within 1 % and every gradient is finite, not zero."""
    for name, count in pixels.items():
        if abs(count - expected) > 0.01 * expected:
            raise RuntimeError(f"{name} covers {count} pixels where {expected} are expected: unfair")
    for name, found in gradients.items():
        for part, values in found.items() if isinstance(found, dict) else [("all", found)]:
            array = np.asarray(values)
            if not np.isfinite(array).all() or not array.any():
                raise RuntimeError(f"{name}: the gradient of {part} is zero or not finite")


def suffix(case: Case, threads: int) -> str:
    """Suffix of a metric's name; empty for the standard case on one thread."""
    standard = case.camera.width == STANDARD_SIZE and len(case.model.faces) == standard_faces()
    place = "" if standard else f"_{len(case.model.faces)}_faces_{case.camera.width}_px"
    return place + ("" if threads == 1 else f"_{threads}_threads")


def standard_faces() -> int:
    """Number of faces of the packaged teapot."""
    return len(make_case(STANDARD_SIZE).model.faces)


def metrics_of(times: Mapping[str, np.ndarray], ending: str) -> list[Metric]:
    """Times, and ratios of the rounds' pairs, of one case; `ending` is appended to the names."""
    found = [measuring.metric(f"{name}_ms{ending}", values, "ms") for name, values in times.items()]
    for name, (theirs, mine) in RATIOS.items():
        if theirs in times and mine in times:
            found.append(measuring.metric(name + ending, times[theirs] / times[mine], "x", "higher"))
    return found


def losses(metrics: list[Metric]) -> list[str]:
    """One line for each ratio below 1, each bar of the standard case missed, and threads that do not help."""
    ratios = [row for row in metrics if row["unit"] == "x"]
    lines = [f"slower than the peer: {row['name']} = {row['value']}" for row in ratios if row["value"] < 1]
    for row in ratios:
        bar = BARS.get(row["name"], 0.0)
        if row["value"] < bar:
            lines.append(f"below the bar of {bar:g} x: {row['name']} = {row['value']}")
    times = {row["name"]: row["value"] for row in metrics if row["name"].startswith(f"{FULL}_ms")}
    for name, value in times.items():
        alone = times.get(name.removesuffix(f"_{SECOND_THREADS}_threads"), value)
        if value > alone:
            lines.append(f"slower on {SECOND_THREADS} threads than on one: {name} = {value} against {alone}")
    return lines


def table(case: Case, threads: int, metrics: list[Metric], ending: str) -> str:
    """The metrics of one case for people."""
    found = {row["name"]: row for row in metrics}
    lines = [f"{case.label}, {case.covered()} object pixels, {threads} thread{'s'[: threads - 1]}"]
    for name, title in TITLES.items():
        row = found.get(f"{name}_ms{ending}")
        if row:
            lines.append(f"  {title:<45} {row['value']:>9.3f} ms   interquartile range {row['iqr']:.3f}")
    for name in RATIOS:
        row = found.get(name + ending)
        if row:
            lines.append(f"  {name:<45} {row['value']:>9.2f} x    interquartile range {row['iqr']:.2f}")
    return "\n".join(lines)


def measure(peers: tuple[Peer, ...], rounds: int) -> list[Metric]:
    """Time every case, printing each when it is done; on two threads the packaged mesh only."""
    everything: list[Metric] = []
    for threads in (1, SECOND_THREADS):
        for subdivisions in SUBDIVISIONS if threads == 1 else (0,):
            for size in SIZES:
                case = make_case(size, subdivisions)
                times = interleaved(contenders(case, peers, threads), rounds)
                ending = suffix(case, threads)
                found = metrics_of(times, ending)
                print(table(case, threads, found, ending), end="\n\n", flush=True)
                everything += found
                if not ending:
                    everything.append(measuring.metric("object_pixels", [case.covered()], "pixels", "higher"))
    return everything


def main() -> None:
    """Measure, print, list where we are slower, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--repeats", type=int, default=15)
    arguments = parser.parse_args()
    reasons = {peer: peer.available() for peer in (DEODR, MITSUBA)}
    for reason in filter(None, reasons.values()):
        print(reason)
    peers = tuple(peer for peer, reason in reasons.items() if reason is None)
    metrics = measure(peers, arguments.repeats)
    found = measuring.report(metrics, 1, [peer.package for peer in peers])
    if MITSUBA in peers:
        found["versions"]["llvm"] = MITSUBA.load().compiler()
    print("where we lose:")
    lost = losses(metrics) if peers else ["no peer to compare with", *losses(metrics)]
    for line in lost or ["nowhere in these measurements"]:
        print(f"  {line}")
    print(", ".join(f"{name} {version}" for name, version in found["versions"].items()))
    if arguments.json:
        measuring.write(found, arguments.json)


if __name__ == "__main__":
    main()
