"""Runs over many photos: rates, memory, bytes, kills and broken files, as `vig fit` does them.

`python -m benchmarks.many --photos 100` fits photos of generated scenes with one worker (with boxes and
without), two workers, and on two Ray nodes of one processor each on this machine. Steady rates are those of
the last three quarters of a run, start left out; processor time is all that a run took less that of the same
command again, which finds everything done. `--kills 20` kills a whole run so many times and compares its
rows with those of a run that was left alone, or, with `--nodes`, of one on two Ray nodes of which one is
killed on the way; `--broken` adds 50 files of all kinds that are no photos. Both exit with 1 where something
is missing.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from benchmarks.inputs import made
from benchmarks.measuring import metric, report, write
from vig.photo.masks import box_of
from vig.scene import Latents, ObjectClass
from vig_train.evaluation.protocol import silhouettes

BROKEN = 50
COMMAND = [sys.executable, "-m", "vig", "fit"]
LOOK_SECONDS = 0.2
LATE = 0.7
"""Share of the photos that are done when a node is killed."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photos", type=int, default=40)
    parser.add_argument("--side", type=int, default=640, help="pixels of the photos")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2, help="of the runs of --kills and --broken")
    parser.add_argument("--kills", type=int, default=0, help="instead: kill a run so many times")
    parser.add_argument("--nodes", action="store_true", help="with --kills: compare with a run on two nodes")
    parser.add_argument(
        "--broken", action="store_true", help=f"instead: add {BROKEN} files that are no photos"
    )
    parser.add_argument("--json", type=Path, help="where to write the figures")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        photos = Photos.made(Path(folder), arguments.photos, arguments.side, arguments.seed)
        if arguments.kills or arguments.broken:
            kills, workers = arguments.kills, arguments.workers
            good = not kills or killed(photos, kills, workers, arguments.seed, arguments.nodes)
            good &= not arguments.broken or broken(photos, arguments.workers)
            sys.exit(0 if good else 1)
        metrics = rates(photos)
    for each in metrics:
        print(f"{each['name']:36} {each['value']:10} {each['unit']}")
    if arguments.json:
        write(report(metrics, 1, ["ray"]), arguments.json)
        print(arguments.json)


@dataclass(frozen=True)
class Photos:
    """`count` photos in a folder, their boxes in a file, and where results go."""

    folder: Path
    boxes: Path
    count: int

    @staticmethod
    def made(root: Path, count: int, side: int, seed: int) -> Photos:
        """Photos of the test split's scenes, JPEG, enlarged to `side` pixels."""
        object_class = ObjectClass.load("teapot")
        images, truth = made(object_class, count, seed)
        whole = silhouettes(Latents.from_vector(truth), object_class)
        folder, boxes = root / "photos", {}
        folder.mkdir()
        for number, (image, mask) in enumerate(zip(images, whole, strict=True)):
            name = f"{number:06d}.jpg"
            picture = Image.fromarray(image).resize((side, side), Image.Resampling.BICUBIC)
            picture.save(folder / name, quality=92)
            boxes[name] = [side / len(image) * each for each in box_of(mask)]
        (root / "boxes.json").write_text(json.dumps(boxes))
        return Photos(folder, root / "boxes.json", count)

    def out(self, name: str) -> Path:
        return self.folder.parent / name


@dataclass(frozen=True)
class Look:
    """A process at one time: photos that are done, its own processor seconds, the peak memory in MiB of it
    and of its children."""

    done: int
    own: float
    peak: float


@dataclass
class Run:
    """A run of `vig fit` that has ended.

    Attributes:
        code: Its exit code.
        errors: What it wrote to standard error.
        processor: Seconds of it and of the processes that it waited for.
        peak: MiB of resident memory of the largest of its processes: VmHWM.
        own: Seconds of processor time that the process which was started spent on each photo of the last
            three quarters, its children's not counted.
        out: Its results.
    """

    code: int
    errors: str
    processor: float
    peak: float
    own: float
    out: Path

    @staticmethod
    def of(photos: Photos, out: Path, *arguments: str) -> Run:
        command = [*COMMAND, str(photos.folder), "--out", str(out), "--quiet", *arguments]
        before = os.times()
        with subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        ) as process:
            looks: list[Look] = []
            ended = threading.Event()
            watch = threading.Thread(target=_watch, args=(process.pid, out, looks, ended))
            watch.start()
            errors = process.communicate()[1]
            ended.set()
            watch.join()
        after = os.times()
        spent = after.children_user + after.children_system - before.children_user - before.children_system
        peak, done = max(look.peak for look in looks), looks[-1].done
        first = next(look for look in looks if look.done >= done / 4)
        last = next(look for look in looks if look.done == done)
        own = (last.own - first.own) / max(last.done - first.done, 1)
        return Run(process.returncode, errors, spent, peak, own, out)

    def rows(self) -> list[dict[str, str]]:
        """Of results.csv, without what differs from run to run."""
        with open(self.out / "results.csv", encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        return [{name: cell for name, cell in row.items() if name != "seconds"} for row in rows]

    def steady(self) -> float:
        """Photos per second of the last three quarters."""
        done = sorted(path.stat().st_mtime for path in self.out.glob("*/explanation.json"))
        late = done[len(done) // 4 :]
        return (len(late) - 1) / (late[-1] - late[0])


def rates(photos: Photos) -> list[dict[str, Any]]:
    """Rates, processor time, memory and bytes of runs that are left alone."""
    boxes = ["--boxes", str(photos.boxes)]
    one = [*COMMAND, str(next(photos.folder.iterdir())), "--out", str(photos.out("first")), "--quiet"]
    subprocess.run(one, check=True, stdout=subprocess.DEVNULL)  # compiles what is not compiled yet
    metrics: list[dict[str, Any]] = []

    def measured(name: str, *arguments: str) -> Run:
        found = Run.of(photos, photos.out(name), *arguments)
        again = Run.of(photos, photos.out(name), *arguments)
        if found.code or again.code:
            sys.exit(f"{name}: exit code {found.code}: {found.errors}")
        spent = (found.processor - again.processor) / photos.count
        metrics.append(metric(f"{name}_photos_per_s", [found.steady()], "1/s", "higher"))
        metrics.append(metric(f"{name}_processor_s_per_photo", [spent], "s"))
        metrics.append(metric(f"{name}_peak_mib", [found.peak], "MiB"))
        return found

    out = measured("one_worker", *boxes).out
    measured("one_worker_without_boxes")
    measured("two_workers", *boxes, "--workers", "2")
    folders = [folder for folder in out.iterdir() if folder.is_dir()]
    sizes = [sum(path.stat().st_size for path in folder.iterdir()) for folder in folders]
    metrics.append(metric("bytes_per_photo", sizes, "bytes"))
    ledger = (out / "results.jsonl").stat().st_size / photos.count
    metrics.append(metric("ledger_bytes_per_photo", [ledger], "bytes"))
    if find_spec("ray") is None:
        print("ray is not installed: no rows of two nodes")
        return metrics
    with two_nodes(photos.out("two_nodes")) as address:
        on_nodes = Run.of(photos, photos.out("two_nodes"), *boxes, "--cluster", address)
        if on_nodes.code:
            sys.exit(f"two nodes: exit code {on_nodes.code}: {on_nodes.errors}")
    metrics.append(metric("two_nodes_photos_per_s", [on_nodes.steady()], "1/s", "higher"))
    metrics.append(metric("driver_processor_s_per_photo", [on_nodes.own], "s"))
    metrics.append(metric("driver_peak_mib", [on_nodes.peak], "MiB"))
    return metrics


def killed(photos: Photos, kills: int, workers: int, seed: int, nodes: bool) -> bool:
    """Kill a whole run `kills` times at random moments; whether its rows are those of one left alone, or of
    one on two nodes of which one was killed.
    """
    boxes = ["--boxes", str(photos.boxes)]
    arguments = [*boxes, "--workers", str(workers)]
    began = time.monotonic()
    if nodes:
        with two_nodes(photos.out("alone"), int(LATE * photos.count)) as address:
            alone = Run.of(photos, photos.out("alone"), *boxes, "--cluster", address)
    else:
        alone = Run.of(photos, photos.out("alone"), *arguments)
    took = time.monotonic() - began
    print(f"{len(alone.rows())} rows in {took:.0f} s, exit code {alone.code}", flush=True)
    rng, out = np.random.default_rng(np.random.SeedSequence(seed)), photos.out("killed")
    ended = 0
    for _ in range(kills):
        command = [*COMMAND, str(photos.folder), "--out", str(out), "--quiet", *arguments]
        with subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL) as process:
            try:
                process.wait(rng.uniform(0, 2 * took / kills))
                ended += 1
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
        print(f"{len(list(out.glob('*/explanation.json')))} of {photos.count} are there", flush=True)
    last = Run.of(photos, out, *arguments)
    same = last.rows() == alone.rows()
    words = "the same" if same else "OTHERS"
    print(f"{kills - ended} kills, {ended} runs that ended before theirs; the rows are {words}")
    return same and last.code == 0


def broken(photos: Photos, workers: int) -> bool:
    """Fit good and bad files of one folder; whether all good ones are explained, all others have a reason."""
    names = add_broken(photos.folder)
    boxes = ["--boxes", str(photos.boxes)]  # of the good ones
    run = Run.of(photos, photos.out("broken"), *boxes, "--workers", str(workers))
    rows = run.rows()
    reasons = {os.path.basename(row["photo"]): row["error"] for row in rows if row["error"]}
    for name, reason in reasons.items():
        print(f"{name!r}: {reason!r}")
    explained = len(rows) - len(reasons)
    refused = f"{len(reasons)} of {len(names)} refused"
    print(f"{explained} of {photos.count} explained, {refused}, exit code {run.code}")
    lines = run.errors.splitlines()
    told = len(lines) == len(names) and all(line.startswith("vig: ") for line in lines)
    return explained == photos.count and reasons.keys() == set(names) and run.code == 1 and told


def add_broken(folder: Path) -> list[str]:
    """Add `BROKEN` files that are no photos, of all kinds in turn; returns their names."""
    photo = next(folder.glob("*.jpg")).read_bytes()
    kinds: list[tuple[str, Callable[[Path], object]]] = [
        ("fifo", os.mkfifo),
        ("dead link", lambda path: path.symlink_to(folder / "nowhere")),
        ("link to itself", lambda path: path.symlink_to(path)),
        ("new\nline\n", lambda path: path.write_text("no photo")),
        ("empty", Path.touch),
        ("half", lambda path: path.write_bytes(photo[: len(photo) // 3])),
        ("head alone", lambda path: path.write_bytes(photo[:20])),
        ("text", lambda path: path.write_text("no photo")),
        ("folder", Path.mkdir),
        ("bomb", lambda path: path.write_bytes(png_of(60_000, 60_000))),
        ("tiny", lambda path: Image.new("RGB", (3, 3)).save(path, "PNG")),
        ("socket", _bind),
        ("<b>&amp;", lambda path: path.write_bytes(os.urandom(2000))),
    ]
    if os.geteuid() != 0:  # who may read everything
        kinds.append(("forbidden", lambda path: (path.write_bytes(photo), path.chmod(0))))
    names = []
    for number in range(BROKEN):
        name, make = kinds[number % len(kinds)]
        path = folder / f"{name} {number}.{('jpg', 'png')[number % 2]}"
        make(path)
        names.append(path.name)
    return names


def png_of(width: int, height: int) -> bytes:
    """A few bytes that promise a large picture."""

    def part(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + part(b"IHDR", head) + part(b"IDAT", zlib.compress(b"")) + part(b"IEND", b"")


def _bind(path: Path) -> None:
    before = os.getcwd()
    os.chdir(path.parent)  # a socket's path may have 107 bytes
    try:
        with socket.socket(socket.AF_UNIX) as end:
            end.bind(path.name)
    finally:
        os.chdir(before)


@contextmanager
def two_nodes(out: Path, killed_at: int | None = None) -> Iterator[str]:
    """A Ray cluster of two nodes of one processor each; its address. The second is killed once so many photos
    of `out` are there.
    """
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    over = threading.Event()

    def kill() -> None:
        while killed_at is not None and not over.wait(LOOK_SECONDS):
            if (done := len(list(out.glob("*/explanation.json")))) >= killed_at:
                cluster.remove_node(second, allow_graceful=False)
                print(f"one node killed at {done} photos", flush=True)
                return

    try:
        second = cluster.add_node(num_cpus=1)
        thread = threading.Thread(target=kill)
        thread.start()
        yield cluster.address
        over.set()
        thread.join()
    finally:
        over.set()
        cluster.shutdown()


def _watch(root: int, out: Path, looks: list[Look], ended: threading.Event) -> None:
    """Look at a process until it ends (Linux)."""
    tick = os.sysconf("SC_CLK_TCK")
    while not looks or not ended.wait(LOOK_SECONDS):
        try:
            pids = [root, *map(int, Path(f"/proc/{root}/task/{root}/children").read_text().split())]
            user, system = Path(f"/proc/{root}/stat").read_text().rpartition(")")[2].split()[11:13]
        except OSError:
            user = system = "0"
            pids = []
        peaks = [0.0]
        for pid in pids:
            with suppress(OSError, IndexError):  # it has just ended
                status = Path(f"/proc/{pid}/status").read_text()
                peaks.append(int(status.partition("VmHWM:")[2].split()[0]) / 1024)
        done = len(list(out.glob("*/explanation.json")))
        looks.append(Look(done, (int(user) + int(system)) / tick, max(peaks)))


if __name__ == "__main__":
    main()
