"""Random use of the page of `vig view`: `python -m benchmarks.viewer [--minutes 60] [--json FILE]`.

A server explains an example photo; a browser (chromium on the path, by playwright) clicks, drags, scribbles,
chooses and types on its page at random. Printed: how many of these, by how much the server's resident memory
grew after the first tenth of the time, errors of the page and of the server, and whether it still refits.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from benchmarks.measuring import metric, report, write
from vig_app.examples import example_photos

FLAGS = (
    "--no-sandbox",
    "--disable-background-networking",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
SCREEN = 1300, 800
SCENE = 420, 940, 130, 670
"""Left, right, top and bottom of the photo on such a screen, roughly."""
PAUSE = 0.2
BUTTONS = "say it there", "undo", "undo", "take all back", "look straight", "save"
"""Undo comes twice, so that what was said stays little."""


def resident(process: int) -> float:
    """Megabytes of a process that are in memory now."""
    line = next(
        line for line in Path(f"/proc/{process}/status").read_text().splitlines() if line.startswith("VmRSS")
    )
    return int(line.split()[1]) / 1000


def act(page: Any, rng: np.random.Generator) -> str:
    """One thing that a user may do; returns what."""
    left, right, top, bottom = SCENE
    x, y, to_x, to_y = (float(rng.uniform(*pair)) for pair in ((left, right), (top, bottom)) * 2)
    kind = str(rng.choice(["click", "click", "drag", "choose", "button", "check", "slide", "type"]))
    if kind == "click":
        page.mouse.click(x, y)
    elif kind == "drag":
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(to_x, to_y, steps=4)
        page.mouse.up()
    elif kind == "choose":
        fields = page.get_by_role("combobox").filter(visible=True)
        field = fields.nth(int(rng.integers(fields.count())))
        field.focus()
        for _ in range(int(rng.integers(1, 6))):
            field.press("ArrowDown")
        field.press("Enter")
    elif kind == "button":
        page.get_by_role("button", name=str(rng.choice(BUTTONS))).first.click()
    elif kind == "check":
        boxes = page.get_by_role("checkbox").filter(visible=True)
        boxes.nth(int(rng.integers(boxes.count()))).click()
    elif kind == "slide":
        sliders = page.get_by_role("slider").filter(visible=True)
        sliders.nth(int(rng.integers(sliders.count()))).press(str(rng.choice(["ArrowLeft", "ArrowRight"])))
    else:
        numbers = rng.integers(-50, 450, size=int(rng.integers(1, 6)))
        page.locator(".mantine-TextInput-input").filter(visible=True).first.fill(
            " ".join(map(str, numbers.tolist()))
        )
    return kind


def refits(page: Any) -> bool:
    """Whether a correction that is made now is fitted within a minute."""
    page.keyboard.press("Escape")
    for button in ("take all back", "save"):
        page.get_by_role("button", name=button).click()
    page.get_by_text("Saved in").wait_for(timeout=60000)  # what waited is done
    page.get_by_role("checkbox").filter(visible=True).first.click()  # nothing hides it
    page.get_by_text("fitted in").wait_for(timeout=60000)
    return True


def soak(minutes: float, seed: int, folder: Path) -> list[dict[str, Any]]:
    """Random use for so long; the metrics."""
    from playwright.sync_api import Error, sync_playwright

    large = Image.new("RGB", (400, 300), (120, 120, 120))
    with Image.open(example_photos()[3].photo) as small:
        large.paste(small, (120, 70))
    large.save(folder / "photo.png")
    command = [
        sys.executable,
        "-c",
        "from vig_app.cli.main import main; main()",
        "view",
        "photo.png",
        "--no-open",
    ]
    rng, errors, done, missed = np.random.default_rng(seed), [], 0, 0
    with (
        open(folder / "errors.txt", "w") as said,
        subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=said, text=True) as server,
    ):
        try:
            assert server.stdout is not None
            address = next(line for line in server.stdout if line.startswith("http")).strip()
            with sync_playwright() as play:
                browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
                page = browser.new_page(viewport={"width": SCREEN[0], "height": SCREEN[1]})
                page.set_default_timeout(5000)
                page.on("pageerror", lambda error: errors.append(str(error)))
                page.goto(address)
                page.get_by_text("azimuth").first.wait_for(timeout=60000)
                began, early, told = time.monotonic(), 0.0, 0.0
                while (spent := (time.monotonic() - began) / 60) < minutes:
                    try:
                        act(page, rng)
                        done += 1
                    except Error:  # hidden by an open list, say
                        page.keyboard.press("Escape")
                        missed += 1
                    time.sleep(PAUSE)
                    if not early and spent >= minutes / 10:
                        early = resident(server.pid)
                    if spent >= told:
                        told += minutes / 10
                        print(f"{spent:.0f} min, {done} actions: {resident(server.pid):.0f} MB", flush=True)
                answers = refits(page)
                browser.close()
            grown = resident(server.pid) - early
            faults = (folder / "errors.txt").read_text().count("Traceback")
        finally:
            server.kill()
    return [
        metric("viewer_actions", [done], "", "higher"),
        metric("viewer_actions_missed", [missed], ""),
        metric("viewer_memory_added_mb", [grown], "MB"),
        metric("viewer_page_errors", [len(errors)], ""),
        metric("viewer_faults_of_the_server", [faults], ""),
        metric("viewer_refits_at_the_end", [float(answers)], "", "higher"),
    ]


def main() -> None:
    """Measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    if not arguments.minutes > 0 or shutil.which("chromium") is None:
        parser.error("expected a time above 0, and chromium installed")
    with tempfile.TemporaryDirectory() as folder:
        metrics = soak(arguments.minutes, arguments.seed, Path(folder))
    for row in metrics:
        print(f"{row['name']}: {row['value']} {row['unit']}")
    if arguments.json:
        write(report(metrics, threads=2, packages=["viser", "playwright"]), arguments.json)


if __name__ == "__main__":
    main()
