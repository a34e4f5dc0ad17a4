"""Props with a battery or a plug: phone, laptop, keyboard, mouse, headphones, cable, camera."""

from __future__ import annotations

import numpy as np

from vig_world.assets.props.families import family
from vig_world.assets.props.material import Material, Prop, dark, material, metal, plain, plastic, prop, steel
from vig_world.assets.props.shapes import blob, box, extrude, moved, relief, revolve, rounded, smooth, tube
from vig_world.assets.textures import neutral, shade, texture
from vig_world.mesh import Mesh


def _screen(rng: np.random.Generator, lit: float) -> Material:
    """A display, dark or showing a page or a picture; it glows a little when it shows something."""
    if rng.uniform() > lit:
        return plain("glass", rng, np.full(3, rng.uniform(0.02, 0.035)))
    image = texture(str(rng.choice(["page", "picture", "print"])), rng, 96)
    return Material(image, "glass", 0.1, emission=float(rng.uniform(0.2, 0.5)))


def _slab(
    rng: np.random.Generator, width: float, depth: float, thick: float, lit: float
) -> list[tuple[Mesh, Material]]:
    """A phone or tablet on its back."""
    shell = steel(rng) if rng.uniform() < 0.4 else dark(rng) if rng.uniform() < 0.6 else plastic(rng)
    edge = 0.035 * width + 0.002
    glass = box((width - edge, depth - 2 * edge, 0.0006))
    return [
        (extrude(rounded(width, depth, 0.11 * width), thick, 0.0018), shell),
        (
            moved(
                extrude(rounded(width - 0.003, depth - 0.003, 0.1 * width), 0.0004), (0, 0, thick - 0.0001)
            ),
            dark(rng),
        ),
        (moved(glass, (0, 0, thick + 0.0001)), _screen(rng, lit)),
    ]


@family("desk", "bedside")
def phone(rng: np.random.Generator) -> Prop:
    """A smartphone on its back."""
    width = rng.uniform(0.066, 0.079)
    return prop("phone", *_slab(rng, width, width * rng.uniform(1.95, 2.15), rng.uniform(0.007, 0.011), 0.35))


@family("desk", "reading")
def tablet(rng: np.random.Generator) -> Prop:
    """A tablet or e-reader, lying or leaning on its stand."""
    width = rng.uniform(0.12, 0.18)
    parts = _slab(rng, width, depth := width * rng.uniform(1.3, 1.45), 0.008, 0.5)
    if rng.uniform() < 0.4:
        tilt = rng.uniform(0.9, 1.2)
        parts = [(moved(mesh, (0, 0, depth / 2 * np.sin(tilt)), tilt=tilt), m) for mesh, m in parts]
        reach = 0.35 * depth / np.tan(tilt) - 0.5 * depth * np.cos(tilt) + 0.4 * depth * np.sin(0.5)
        strut = moved(box((0.4 * width, 0.003, 0.4 * depth)), (0, reach, 0.001), tilt=0.5)
        parts.append((strut, dark(rng)))
    return prop("tablet", *parts)


def _keys(rng: np.random.Generator, rows: int, columns: int, body: np.ndarray, cap: np.ndarray) -> Material:
    """Keys as a picture, (16 rows of texels each): staggered caps on a body."""
    v, u = (np.mgrid[: 12 * rows, : 8 * columns] + 0.5) / [[[12]], [[8]]]
    row = np.floor(v).astype(int)
    shifted = u + 0.37 * (row % 3)
    gap = (v % 1 < 0.12) | (v % 1 > 0.9) | (shifted % 1 < 0.12) | (shifted % 1 > 0.9)
    gap[12 * rows - 12 :] = (
        (v % 1 < 0.12) | (v % 1 > 0.9) | (np.abs(u / columns - 0.45) > 0.2) & (u % 1 < 0.15)
    )[12 * rows - 12 :]
    glyph = (np.abs(v % 1 - 0.42) < 0.14) & (np.abs(shifted % 1 - 0.42) < 0.14) & (row < rows - 1)
    image = np.where(gap[..., None], body * 0.55, cap)
    ink = np.full(3, 0.75 if cap.mean() < 0.3 else 0.08)
    image = np.where(glyph[..., None], 0.5 * ink + 0.5 * cap, image)
    return Material(image.clip(0.02, 0.95).astype(np.float32), "plastic", 0.5)


@family("desk")
def keyboard(rng: np.random.Generator) -> Prop:
    """A keyboard, with or without a block of digits."""
    width, depth = rng.uniform(0.27, 0.38), rng.uniform(0.105, 0.13)
    body = shade(np.full(3, rng.choice([0.03, 0.06, 0.55, 0.75])), rng)
    cap = body if rng.uniform() < 0.6 else shade(np.full(3, rng.choice([0.05, 0.7])), rng)
    slope = 0.3 * depth / 10
    case = extrude(rounded(width, depth, 0.008), 0.013, 0.002)
    field = moved(
        relief(
            *np.meshgrid([-0.48 * width, 0.48 * width], [-0.45 * depth, 0.45 * depth]), np.full((2, 2), 0.005)
        ),
        (0, 0, 0.011),
    )
    points = [
        (mesh, m) for mesh, m in ((case, plain("plastic", rng, body)), (field, _keys(rng, 5, 15, body, cap)))
    ]
    parts = []
    for mesh, m in points:
        lifted = mesh.vertices.copy()
        lifted[:, 2] += np.where(lifted[:, 2] > 0.004, slope * (lifted[:, 1] / depth + 0.5) * 2, 0)
        parts.append((Mesh(lifted.astype(np.float32), mesh.faces, mesh.uv), m))
    return prop("keyboard", *parts)


@family("desk")
def laptop(rng: np.random.Generator) -> Prop:
    """A laptop, open or shut."""
    width = rng.uniform(0.27, 0.31)
    depth = 0.66 * width
    shell = neutral(rng) if rng.uniform() < 0.4 else shade(np.full(3, rng.choice([0.05, 0.3, 0.5])), rng)
    case = plain("metal", rng, shell)
    base = extrude(rounded(width, depth, 0.01), 0.012, 0.003)
    lid = extrude(rounded(width, depth, 0.01), 0.006, 0.0015)
    if rng.uniform() < 0.3:
        return prop("laptop", (base, case), (moved(lid, (0, 0, 0.0125)), case))
    keys = _keys(rng, 5, 14, shell, np.full(3, 0.03) if shell.mean() > 0.08 else shell)
    field = moved(box((0.86 * width, 0.42 * depth, 0.001)), (0, 0.12 * depth, 0.0115))
    pad = moved(box((0.3 * width, 0.24 * depth, 0.0006)), (0, -0.28 * depth, 0.0117))
    tilt = np.pi / 2 - rng.uniform(0.15, 0.45)
    parts = [(base, case), (field, keys), (pad, plain("plastic", rng, 0.85 * shell))]
    screen = box((0.95 * width, 0.9 * depth, 0.0006))
    bezel = box((0.98 * width, 0.96 * depth, 0.0005))
    middle = np.array([0, depth / 2 - 0.004 + 0.5 * depth * np.cos(tilt), 0.012 + 0.5 * depth * np.sin(tilt)])
    # the lid lies face up before it is tilted: its display is what one sees from -Y
    for mesh, m, z in ((lid, case, -0.006), (bezel, dark(rng), 0.0), (screen, _screen(rng, 0.6), 0.0005)):
        parts.append((moved(moved(mesh, (0, 0, z)), middle, tilt=tilt), m))
    return prop("laptop", *parts)


@family("desk")
def mouse(rng: np.random.Generator) -> Prop:
    """A computer mouse, perhaps on its mat."""
    skin = plastic(rng) if rng.uniform() < 0.5 else dark(rng)
    mesh = blob((0.06, 0.105, 0.06), 18, 9, 2.4)
    points = mesh.vertices.copy()
    points[:, 2] = np.maximum(points[:, 2] - 0.024, 0) * (1 - 3 * np.maximum(-points[:, 1], 0))
    wheel = moved(
        revolve([[0, -0.004], [0.01, -0.004], [0.01, -0.004], [0.01, 0.004], [0.01, 0.004], [0, 0.004]], 14),
        tilt=np.pi / 2,
    )
    wheel = moved(wheel, (0, -0.03, 0.0245), np.pi / 2)
    lift = 0.0
    parts: list[tuple[Mesh, Material]] = []
    if rng.uniform() < 0.35:
        lift = 0.003
        parts.append(
            (
                extrude(rounded(0.22, 0.18, 0.012), lift),
                material("cloth", rng, str(rng.choice(["paint", "picture"])), None, 64),
            )
        )
    body = moved(Mesh(points, mesh.faces, mesh.uv), (0, 0, lift))
    return prop("mouse", *parts, (body, skin), (moved(wheel, (0, 0, lift)), dark(rng)))


@family("desk", "floor")
def headphones(rng: np.random.Generator) -> Prop:
    """A pair of headphones, standing on their cups or lying flat."""
    skin, pad = plastic(rng) if rng.uniform() < 0.5 else dark(rng), dark(rng)
    half, high = rng.uniform(0.07, 0.08), rng.uniform(0.15, 0.175)
    t = np.linspace(0, np.pi, 15)
    arc = np.stack([half * np.cos(t), 0 * t, 0.05 + (high - 0.05) * np.sin(t)], 1)
    parts = [(tube(arc, np.full((15, 2), [0.011, 0.0035]), 6, up=(0, 1, 0)), skin)]
    for side in (-1, 1):
        for radius, inner, outer, m in ((0.036, 0.0, 0.012, skin), (0.038, -0.018, 0.0, pad)):
            cup = revolve(
                [
                    [0, inner],
                    [0.9 * radius, inner],
                    [radius, inner + 0.003],
                    [radius, outer - 0.003],
                    [0.9 * radius, outer],
                    [0, outer],
                ],
                18,
            )
            turned = moved(moved(cup, tilt=np.pi / 2), (side * half, 0, 0.042), side * np.pi / 2)
            parts.append((turned, m))
    if rng.uniform() < 0.5:
        parts = [(moved(mesh, tilt=np.pi / 2), m) for mesh, m in parts]
    return prop("headphones", *parts)


@family("desk", "storage", "bedside", "floor")
def cable(rng: np.random.Generator) -> Prop:
    """A cable in loose coils, with its plugs."""
    turns, radius = rng.uniform(2.2, 3.6), rng.uniform(0.035, 0.055)
    t = np.linspace(0, 2 * np.pi * turns, int(16 * turns))
    wide = radius * (1 + 0.1 * np.sin(0.7 * t + rng.uniform(0, 6)) + 0.06 * t / t[-1])
    thick = rng.uniform(0.0018, 0.0032)
    z = thick + 1.2 * thick * np.floor(t / (2 * np.pi)) + thick * 0.8 * np.abs(np.sin(2.5 * t))
    coil = np.stack([wide * np.cos(t), 0.85 * wide * np.sin(t), z], 1)
    way = np.array([-np.sin(t[-1]), np.cos(t[-1]), 0])
    tail = [
        coil[-1] + way * d + [0.2 * d, 0, (thick - coil[-1, 2]) * min(1, d / 0.06)]
        for d in (0.03, 0.06, 0.08)
    ]
    path = np.concatenate([coil, tail])
    skin = dark(rng) if rng.uniform() < 0.5 else plain("plastic", rng, shade([0.75, 0.74, 0.72], rng))
    plug = tube([tail[-1], tail[-1] + 0.03 * way + [0, 0, 0.002]], np.full((2, 2), [0.006, 0.004]), 8)
    pin = tube([tail[-1] + 0.03 * way, tail[-1] + 0.042 * way], 0.003, 6)
    low = np.array([0, 0, max(0.0, 0.004 - thick)], np.float32)
    parts = [(tube(path, thick, 5), skin), (moved(plug, low), skin), (moved(pin, low), metal(rng))]
    if rng.uniform() < 0.4:
        charger = box((0.05, 0.05, 0.028), 0.005)
        parts.append((moved(charger, (*(0.9 * radius * np.array([np.cos(t[0]), np.sin(t[0])])), 0)), skin))
    return prop("cable", *parts)


@family("reading", "bedside")
def remote_control(rng: np.random.Generator) -> Prop:
    """A remote control."""
    width, depth, thick = rng.uniform(0.036, 0.052), rng.uniform(0.13, 0.2), rng.uniform(0.014, 0.022)
    body = dark(rng) if rng.uniform() < 0.75 else plastic(rng)
    parts = [(extrude(rounded(width, depth, 0.3 * width), thick, 0.004), body)]
    keys = [plain("plastic", rng, tint) for tint in ([0.3, 0.3, 0.3], [0.55, 0.55, 0.53], [0.5, 0.05, 0.04])]
    rows = int(depth / 0.018) - 1
    for row in range(rows):
        for column in range(3):
            if rng.uniform() < 0.85:
                at = ((column - 1) * 0.3 * width, (row - (rows - 1) / 2) * 0.017, thick - 0.0005)
                key = keys[2 if row == rows - 1 and column == 0 else row % 2]
                parts.append((moved(box((0.19 * width, 0.008, 0.002)), at), key))
    return prop("remote_control", *parts)


@family("desk", "display", "storage")
def camera(rng: np.random.Generator) -> Prop:
    """A photographic camera, its lens to the front."""
    width, height, depth = rng.uniform([0.11, 0.07, 0.038], [0.14, 0.09, 0.055])
    black, silver = dark(rng), steel(rng)
    two_tone = rng.uniform() < 0.5
    skin = material("plastic", rng, "leather", [0.04, 0.038, 0.036], 32)
    parts = [(moved(box((width, depth, 0.8 * height), 0.006)), skin if two_tone else black)]
    parts.append(
        (
            moved(box((width, depth, 0.24 * height), 0.005), (0, 0, 0.76 * height)),
            silver if two_tone else black,
        )
    )
    parts.append(
        (
            moved(box((0.35 * width, 0.9 * depth, 0.2 * height), 0.006), (0, 0, 0.98 * height)),
            silver if two_tone else black,
        )
    )
    radius, reach = rng.uniform(0.026, 0.034), rng.uniform(0.02, 0.045)
    radius = min(radius, 0.42 * height)
    barrel = [
        [0, -0.002],
        [radius, -0.002],
        [radius, 0.4 * reach],
        [radius, 0.4 * reach],
        [0.92 * radius, 0.42 * reach],
        [0.92 * radius, reach],
        [0.92 * radius, reach],
        [0.8 * radius, reach],
        [0.7 * radius, reach - 0.006],
        [0.7 * radius, reach - 0.006],
        [0, reach - 0.003],
    ]
    glass = [
        [0, reach - 0.006],
        [0.68 * radius, reach - 0.006],
        [0.4 * radius, reach - 0.002],
        [0, reach - 0.0012],
    ]
    front = (0.08 * width, -depth / 2, 0.46 * height)
    parts.append((moved(revolve(barrel, 22), front, tilt=np.pi / 2), black))
    parts.append((moved(revolve(glass, 16), front, tilt=np.pi / 2), plain("glass", rng, [0.03, 0.03, 0.06])))
    for x, r in ((0.36, 0.008), (-0.36, 0.01)):
        knob = revolve([[0, 0], [r, 0], [r, 0], [r, 0.008], [r, 0.008], [0, 0.008]], 14)
        parts.append((moved(knob, (x * width, 0, height - 0.001)), silver))
    return prop("camera", *parts)


@family("desk")
def calculator(rng: np.random.Generator) -> Prop:
    """A pocket calculator."""
    width, depth = rng.uniform(0.065, 0.09), rng.uniform(0.11, 0.15)
    body = neutral(rng)
    case = extrude(rounded(width, depth, 0.006), 0.012, 0.002)
    keys = moved(box((0.86 * width, 0.62 * depth, 0.002)), (0, -0.13 * depth, 0.0115))
    display = moved(box((0.84 * width, 0.17 * depth, 0.001)), (0, 0.34 * depth, 0.0115))
    lcd = plain("glass", rng, shade([0.33, 0.37, 0.28], rng))
    return prop(
        "calculator",
        (case, plain("plastic", rng, body)),
        (keys, _keys(rng, 6, 5, body, neutral(rng))),
        (display, lcd),
    )


@family("desk", "storage")
def torch(rng: np.random.Generator) -> Prop:
    """A pocket torch, standing on its lens."""
    length, radius = rng.uniform(0.1, 0.18), rng.uniform(0.013, 0.019)
    wide = 1.45 * radius
    body = [
        [0, 0],
        [wide, 0],
        [wide, 0],
        [wide, 0.025],
        [radius, 0.04],
        [radius, length],
        [radius, length],
        [0.8 * radius, length + 0.004],
        [0, length + 0.004],
    ]
    button = moved(
        extrude(rounded(0.008, 0.018, 0.003), 0.004), (0, -radius + 0.001, 0.55 * length), tilt=np.pi / 2
    )
    path = smooth(
        [[radius, 0, length - 0.005], [radius + 0.02, 0, length - 0.03], [radius, 0, length - 0.06]], 6
    )
    return prop(
        "torch",
        (revolve(body, 20), metal(rng) if rng.uniform() < 0.5 else dark(rng)),
        (button, plastic(rng)),
        (tube(path, 0.0014, 4, up=(0, 1, 0)), dark(rng)),
    )
