"""Props that adorn: lantern, figurine, bell, boxes, flowers, succulent, hourglass, globe, toy car."""

from __future__ import annotations

import numpy as np

from vig_world.assets.props.families import family
from vig_world.assets.props.material import (
    Material,
    Prop,
    ceramic,
    dark,
    label,
    material,
    metal,
    plain,
    plastic,
    prop,
    timber,
)
from vig_world.assets.props.shapes import (
    blob,
    box,
    extrude,
    hoop,
    moved,
    revolve,
    rounded,
    scaled,
    smooth,
    tube,
)
from vig_world.assets.textures import accent, near, shade
from vig_world.mesh import Mesh


@family("display", "floor")
def lantern(rng: np.random.Generator) -> Prop:
    """A candle lantern: four posts, a roof, a ring, a candle within."""
    side, height = rng.uniform(0.08, 0.12), rng.uniform(0.13, 0.19)
    iron = dark(rng) if rng.uniform() < 0.5 else metal(rng) if rng.uniform() < 0.5 else plain("wood", rng)
    parts = [
        (box((side, side, 0.012), 0.002), iron),
        (moved(box((side, side, 0.008), 0.002), (0, 0, height)), iron),
    ]
    for x in (-1, 1):
        for y in (-1, 1):
            at = (x * (side / 2 - 0.006), y * (side / 2 - 0.006), 0.01)
            parts.append((moved(box((0.009, 0.009, height - 0.008)), at), iron))
    roof = revolve(
        [
            [0, 0],
            [0.72 * side, 0],
            [0.72 * side, 0],
            [0.2 * side, 0.4 * side],
            [0.2 * side, 0.4 * side],
            [0.1 * side, 0.5 * side],
            [0, 0.5 * side],
        ],
        4,
    )
    parts.append((moved(roof, (0, 0, height + 0.006), np.pi / 4), iron))
    t = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.stack([0.018 * np.cos(t), 0 * t, height + 0.5 * side + 0.02 + 0.018 * np.sin(t)], 1)
    parts.append((hoop(ring, 0.002, 5, up=(0, 1, 0)), iron))
    wax = plain("wax", rng, shade([0.80, 0.74, 0.60], rng, 0.1) if rng.uniform() < 0.7 else None)
    pillar = revolve([[0, 0], [0.025, 0], [0.025, 0], [0.025, 0.07], [0.022, 0.072], [0, 0.068]], 16)
    parts.append((moved(pillar, (0, 0, 0.012)), wax))
    return prop("lantern", *parts)


@family("display")
def figurine(rng: np.random.Generator) -> Prop:
    """A figurine: a bird, a cat or a standing person, of china, wood or brass."""
    stuff = (ceramic(rng, shade([0.78, 0.76, 0.72], rng)), timber(rng), metal(rng), ceramic(rng), dark(rng))[
        rng.integers(5)
    ]
    size = rng.uniform(0.8, 1.5)
    kind = int(rng.integers(3))
    black = dark(rng)
    parts: list[tuple[Mesh, Material]] = []
    if kind == 0:  # a bird
        body = smooth(
            [
                [-0.065, 0, 0.038, 0.004, 0.002],
                [-0.03, 0, 0.034, 0.018, 0.014],
                [0.005, 0, 0.034, 0.026, 0.026],
                [0.03, 0, 0.05, 0.017, 0.019],
                [0.043, 0, 0.062, 0.015, 0.014],
                [0.057, 0, 0.064, 0.004, 0.004],
            ],
            14,
        )
        parts = [
            (tube(body[:, :3], body[:, 3:], 12), stuff),
            (
                revolve([[0, 0], [0.02, 0], [0.018, 0.006], [0.008, 0.012], [0.006, 0.02], [0, 0.02]], 14),
                stuff,
            ),
        ]
        parts += [
            (moved(blob((0.004, 0.004, 0.004), 6, 4), (0.046, y, 0.066)), black) for y in (-0.0135, 0.0135)
        ]
    elif kind == 1:  # a sitting cat
        for where, dims in (((0, 0, 0), (0.05, 0.06, 0.075)), ((0, -0.014, 0.062), (0.04, 0.036, 0.036)),
                            ((0, -0.03, 0), (0.042, 0.03, 0.03))):  # fmt: skip
            parts.append((moved(blob(dims, 14, 8), where), stuff))
        for side in (-1, 1):
            ear = revolve([[0, 0], [0.009, 0], [0.0, 0.018]], 6)
            parts.append((moved(ear, (side * 0.012, -0.01, 0.089)), stuff))
            parts.append((moved(blob((0.004, 0.003, 0.005), 6, 4), (side * 0.008, -0.0315, 0.081)), black))
        tail = smooth(
            [[0.0, 0.028, 0.006], [0.028, 0.03, 0.007], [0.036, 0.0, 0.007], [0.028, -0.025, 0.006]], 9
        )
        parts.append((tube(tail, 0.006, 6), stuff))
    else:  # a person in a long dress
        dress = smooth(
            [[0.026, 0], [0.024, 0.012], [0.013, 0.06], [0.016, 0.085], [0.006, 0.098], [0.006, 0.102]], 14
        )
        profile = np.concatenate([[[0, 0], dress[0]], dress, [[0, 0.103]]])
        parts = [
            (revolve(profile, 16), stuff),
            (moved(blob((0.022, 0.024, 0.028), 12, 7), (0, 0, 0.1)), stuff),
        ]
        for x in (-1, 1):
            arm = smooth([[x * 0.013, 0, 0.088], [x * 0.024, -0.004, 0.072], [x * 0.006, -0.02, 0.064]], 6)
            parts.append((tube(arm, 0.0045, 6, up=(0, 1, 0.3)), stuff))
    return prop("figurine", *[(scaled(mesh, size), m) for mesh, m in parts])


@family("display", "bedside")
def bell(rng: np.random.Generator) -> Prop:
    """A hand bell, or a bell to strike on a counter."""
    stuff = metal(rng)
    if rng.uniform() < 0.4:
        radius = rng.uniform(0.035, 0.045)
        t = np.linspace(0, np.pi / 2, 7)
        dome = np.stack([radius * np.cos(t), 0.018 + 0.8 * radius * np.sin(t)], 1)
        dome[-1, 0] = 0
        base = [[0, 0], [radius, 0], [radius, 0], [radius * 0.95, 0.01], [0.5 * radius, 0.02], [0, 0.02]]
        top = 0.018 + 0.8 * radius
        knob = revolve(
            [[0, -0.004], [0.004, -0.004], [0.004, 0.006], [0.007, 0.008], [0.005, 0.012], [0, 0.013]], 12
        )
        return prop(
            "bell",
            (revolve(base, 24), dark(rng)),
            (revolve(np.concatenate([[[0, 0.018], dome[0]], dome]), 24), stuff),
            (moved(knob, (0, 0, top)), stuff),
        )
    radius, height = rng.uniform(0.026, 0.04), rng.uniform(0.04, 0.06)
    side = smooth(
        [
            [radius, 0],
            [0.86 * radius, 0.15 * height],
            [0.6 * radius, 0.6 * height],
            [0.4 * radius, 0.95 * height],
            [0.1 * radius, height],
        ],
        10,
    )
    body = np.concatenate([[[0, 0.1 * height], [0.9 * radius, 0.0], side[0]], side, [[0, height]]])
    grip = np.array(
        [
            [0, 0],
            [0.005, 0],
            [0.005, 0.01],
            [0.009, 0.025],
            [0.006, 0.045],
            [0.009, 0.055],
            [0.005, 0.064],
            [0, 0.066],
        ]
    )
    handle = stuff if rng.uniform() < 0.4 else timber(rng, 32)
    return prop(
        "bell", (revolve(body, 24), stuff), (moved(revolve(grip, 14), (0, 0, height - 0.001)), handle)
    )


@family("display", "storage", "floor")
def wooden_box(rng: np.random.Generator) -> Prop:
    """A wooden box or crate with a lid and a clasp."""
    width, depth, height = rng.uniform([0.1, 0.07, 0.05], [0.22, 0.15, 0.11])
    wood, share = timber(rng, 96), rng.uniform(0.6, 0.75)
    brass = metal(rng)
    parts = [
        (box((width, depth, share * height), 0.0015), wood),
        (
            moved(
                box((width + 0.002, depth + 0.002, (1 - share) * height - 0.0015), 0.002),
                (0, 0, share * height + 0.0015),
            ),
            wood,
        ),
        (moved(box((0.014, 0.003, 0.022), 0.001), (0, -depth / 2 - 0.001, share * height - 0.012)), brass),
    ]
    for x in (-0.3, 0.3):
        parts.append(
            (
                moved(box((0.018, 0.002, 0.014)), (x * width, depth / 2 + 0.0005, share * height - 0.008)),
                brass,
            )
        )
    return prop("wooden_box", *parts)


@family("display", "bedside")
def jewellery_box(rng: np.random.Generator) -> Prop:
    """A small casket on feet with a domed lid, perhaps open on its velvet."""
    width, depth, height = rng.uniform([0.09, 0.065, 0.04], [0.15, 0.1, 0.06])
    shell = (timber(rng), metal(rng), material("cloth", rng, "leather", None, 48), ceramic(rng))[
        rng.integers(4)
    ]
    brass, velvet = metal(rng), plain("cloth", rng, accent(rng))
    parts = [(moved(box((width, depth, height), 0.002), (0, 0, 0.008)), shell)]
    for x in (-0.42, 0.42):
        for y in (-0.4, 0.4):
            parts.append((moved(blob((0.014, 0.014, 0.014), 8, 5), (x * width, y * depth, 0)), brass))
    t = np.linspace(0, np.pi, 9)
    dome = np.stack([depth / 2 * np.cos(t), 0.022 * np.sin(t)], 1)
    lid = extrude(np.concatenate([dome[:1], dome, dome[-1:]]), width, 0.0)
    lid = moved(moved(moved(lid, (0, 0, -width / 2)), tilt=np.pi / 2), turn=np.pi / 2)
    if rng.uniform() < 0.5:
        parts.append((moved(lid, (0, 0, height + 0.0085)), shell))
        parts.append((moved(box((0.012, 0.003, 0.014), 0.001), (0, -depth / 2, height - 0.002)), brass))
    else:
        parts.append((moved(box((0.92 * width, 0.9 * depth, 0.003)), (0, 0, height + 0.006)), velvet))
        opened = moved(lid, (0, -depth / 2, 0))
        opened = moved(opened, tilt=-1.9)
        opened = moved(opened, (0, depth / 2 - 0.004, height + 0.01))
        parts.append((opened, shell))
        pearl = blob((0.008, 0.008, 0.008), 6, 4)
        for k in range(9):
            at = (0.3 * width * np.cos(0.6 * k), 0.25 * depth * np.sin(0.6 * k), height + 0.009)
            parts.append((moved(pearl, at), brass))
    return prop("jewellery_box", *parts)


@family("desk", "display")
def hourglass(rng: np.random.Generator) -> Prop:
    """An hourglass or egg timer of painted glass in a frame."""
    height, radius = rng.uniform(0.09, 0.16), rng.uniform(0.022, 0.034)
    frame = timber(rng, 32) if rng.uniform() < 0.6 else metal(rng)
    sand = plain(
        "glass", rng, shade([[0.66, 0.50, 0.30], [0.7, 0.7, 0.68], [0.2, 0.32, 0.4]][rng.integers(3)], rng)
    )
    disc = revolve(
        [
            [0, 0],
            [radius + 0.008, 0],
            [radius + 0.008, 0],
            [radius + 0.008, 0.008],
            [radius + 0.008, 0.008],
            [0, 0.008],
        ],
        20,
    )
    half = height / 2 - 0.008
    side = smooth(
        [
            [0.8 * radius, 0],
            [0.9 * radius, 0.5 * half],
            [0.004, half],
            [0.9 * radius, 1.5 * half],
            [0.8 * radius, 2 * half],
        ],
        17,
    )
    bulb = np.concatenate([[[0, 0], side[0]], side, [[0, 2 * half]]])
    parts = [
        (disc, frame),
        (moved(disc, (0, 0, height - 0.008)), frame),
        (moved(revolve(bulb, 18), (0, 0, 0.008)), sand),
    ]
    for turn in 2 * np.pi * np.arange(3) / 3:
        at = (radius + 0.002) * np.array([np.cos(turn), np.sin(turn)])
        parts.append((tube([[*at, 0.006], [*at, height - 0.006]], 0.003, 6, up=(0, 1, 0)), frame))
    return prop("hourglass", *parts)


@family("desk", "display")
def globe(rng: np.random.Generator) -> Prop:
    """A globe on its stand."""
    radius = rng.uniform(0.05, 0.085)
    size = rng.uniform(1.05, 1.12) * radius
    sea = near([0.16, 0.30, 0.42], rng) if rng.uniform() < 0.6 else shade([0.58, 0.46, 0.28], rng)
    image = np.empty((64, 64, 3), np.float32)
    image[:] = sea
    from_noise = material("paper", rng, "marble", sea, 64).texture.mean(-1)
    image[from_noise > np.quantile(from_noise, 0.68)] = near([0.36, 0.38, 0.16], rng)
    ball = Material(image.clip(0.02, 0.95), "paper", 0.3)
    centre = size + 0.03
    stand = metal(rng) if rng.uniform() < 0.5 else timber(rng, 32)
    t = np.linspace(-1.9, 1.2, 15)
    arc = np.stack([size * np.cos(t), 0 * t, centre + size * np.sin(t)], 1)
    foot = [[0, 0], [0.6 * radius, 0], [0.6 * radius, 0.006], [0.012, 0.016], [0.007, 0.034], [0, 0.034]]
    sphere = moved(blob((2 * radius,) * 3, 24, 13), (0, 0, -radius), tilt=0.0)
    return prop(
        "globe",
        (moved(sphere, (0, 0, centre)), ball),
        (tube(arc, np.full((15, 2), [0.002, 0.004]), 6, up=(0, 1, 0)), stand),
        (revolve(foot, 22), stand),
    )


@family("display", "floor")
def toy_car(rng: np.random.Generator) -> Prop:
    """A toy car of wood or metal."""
    length, width, height = rng.uniform([0.07, 0.032, 0.018], [0.14, 0.055, 0.03])
    paint = plain("wood", rng, accent(rng)) if rng.uniform() < 0.8 else timber(rng)
    glass, tyre = plain("glass", rng, [0.05, 0.06, 0.07]), dark(rng)
    wheel = 0.42 * height + 0.003
    body = [[-0.5, 0], [-0.5, 0], [0.5, 0], [0.5, 0], [0.5, 0.75], [0.44, 1.0], [-0.46, 1.0], [-0.5, 0.8]]
    roof = np.array(
        [[-0.36, 0], [-0.36, 0], [0.24, 0], [0.24, 0], [0.08, 0.8], [0.06, 0.85], [-0.26, 0.85], [-0.28, 0.8]]
    ) * [length, height]
    parts = [(_sideways(np.array(body) * [length, height], width, 0.003, wheel * 0.8), paint)]
    top = wheel * 0.8 + height
    parts.append((_sideways(roof, 0.84 * width, 0.003, top - 0.0005), glass))
    parts.append(
        (
            moved(box((0.34 * length, 0.86 * width, 0.003), 0.001), (-0.1 * length, 0, top + 0.83 * height)),
            paint,
        )
    )
    disc = revolve([[0, 0], [wheel, 0], [wheel, 0.001], [wheel, 0.007], [0.6 * wheel, 0.009], [0, 0.008]], 14)
    for x in (-0.31, 0.31):
        parts.append((moved(disc, (x * length, -width / 2 + 0.003, wheel), 0, np.pi / 2), tyre))
        parts.append((moved(disc, (x * length, width / 2 - 0.003, wheel), np.pi, np.pi / 2), tyre))
        parts.append(
            (
                moved(box((0.004, 0.7 * width, 0.2 * height)), (1.62 * x * length, 0, top - 0.5 * height)),
                plastic(rng),
            )
        )
    return prop("toy_car", *parts)


def _sideways(outline: np.ndarray, width: float, bevel: float, lift: float) -> Mesh:
    """A body whose side view (x, z) is `outline`, `width` across y, raised by `lift`."""
    return moved(extrude(outline, width, bevel), (0, width / 2, lift), tilt=np.pi / 2)


@family("storage", "floor")
def gift_box(rng: np.random.Generator) -> Prop:
    """A present in paper with a ribbon, or a box of chocolates."""
    width, depth, height = rng.uniform([0.09, 0.08, 0.03], [0.2, 0.16, 0.11])
    paper = material(
        "paper", rng, str(rng.choice(["floral", "stripes", "paint", "wallpaper", "checker"])), None, 96
    )
    ribbon = plain("cloth", rng, accent(rng))
    parts = [(box((width, depth, height), 0.002), label(rng) if rng.uniform() < 0.2 else paper)]
    parts.append((box((0.018, depth + 0.0015, height + 0.0008), 0.002), ribbon))
    parts.append((box((width + 0.0015, 0.018, height + 0.0008), 0.002), ribbon))
    t = np.linspace(0, 2 * np.pi, 14, endpoint=False)
    for turn in (0.5, 0.5 + np.pi, 2.2, 2.2 + np.pi):
        loop = np.stack([0.022 - 0.022 * np.cos(t), 0 * t, height + 0.012 + 0.011 * np.sin(t)], 1)
        parts.append((moved(hoop(loop, (0.0008, 0.006), 4, up=(0, 1, 0)), turn=turn), ribbon))
    return prop("gift_box", *parts)


@family("cooking", "display")
def radio(rng: np.random.Generator) -> Prop:
    """A small radio with a grille, a dial and knobs."""
    width, depth, height = rng.uniform([0.13, 0.05, 0.08], [0.22, 0.09, 0.13])
    case = timber(rng) if rng.uniform() < 0.4 else plastic(rng)
    grille = material("cloth", rng, "weave", shade([0.4, 0.36, 0.3], rng), 64)
    body = moved(
        extrude(rounded(width, height, 0.015), depth, 0.004), (0, depth / 2, height / 2), tilt=np.pi / 2
    )
    front = -depth / 2 - 0.0005
    parts = [
        (body, case),
        (
            moved(box((0.5 * width, 0.002, 0.7 * height), 0.0005), (-0.2 * width, front, 0.15 * height)),
            grille,
        ),
    ]
    scale = material("paper", rng, "page", shade([0.75, 0.70, 0.55], rng), 64)
    parts.append(
        (moved(box((0.34 * width, 0.002, 0.3 * height)), (0.27 * width, front, 0.5 * height)), scale)
    )
    knob = revolve([[0, 0], [0.1 * height, 0], [0.1 * height, 0], [0.09 * height, 0.01], [0, 0.01]], 14)
    stuff = metal(rng)
    for x in (0.17, 0.36):
        parts.append((moved(knob, (x * width, front, 0.27 * height), tilt=np.pi / 2), stuff))
    return prop("radio", *parts)
