"""A split's finite catalogues of rooms, props, finishes and lights: packaged ones, or a user's own.

An asset is a pure function of (split, catalogue, number), not of the dataset's seed, so that no asset of
one split ever occurs in another, and assets can be kept: in memory, and for the rasteriser on disk.
"""

import cmath
from collections.abc import Callable
from dataclasses import astuple, dataclass
from functools import lru_cache

import numpy as np

from vig.scene import EXPOSURE_L00
from vig_world.asset_cache import Arrays, asset_cache, packed_text, unpacked_text
from vig_world.assets.fixtures import HOLDERS
from vig_world.assets.footprint import extreme_points
from vig_world.assets.models import packaged_furniture, packaged_props, vary, vary_furniture
from vig_world.assets.own.catalogue import Source, mesh_folder, read_sources
from vig_world.assets.own.envmaps import OwnPanorama, read_envmaps
from vig_world.assets.own.furniture import read_furniture
from vig_world.assets.own.props import read_props
from vig_world.assets.panoramas.light import grey, light_parts, local_light, project_panorama
from vig_world.assets.panoramas.painting import panorama
from vig_world.assets.shapes import scale_mesh
from vig_world.assets.textures import FINISHES, KINDS, texture
from vig_world.assets.things import (
    ZONE_NAMES,
    Furniture,
    FurnitureModel,
    Prop,
    PropModel,
    Support,
    is_of_class,
)
from vig_world.dataset.spec import Room, Split, Surface
from vig_world.raster.packed import PackedAsset, pack
from vig_world.raster.pyramid import TextureLevels
from vig_world.rooms.draw import draw_layout
from vig_world.rooms.layout import Layout, material_under
from vig_world.rooms.unfurnished import draw_hall, draw_sweep
from vig_world.streams import asset_rng

VARIANTS = {"train": 16, "test": 8, "validation": 8}
"""Number of variants of each packaged prop, and of each thing that carries or reaches."""
SURFACES_PER_KIND = {"train": 40, "test": 16, "validation": 16}
PANORAMAS = {"train": 200, "test": 70, "validation": 70}
LAYOUTS = {"train": 96, "test": 32, "validation": 32}
SWEEPS = {"train": 64, "test": 24, "validation": 24}
"""Seamless grounds, whose numbers follow those of the rooms."""
HALLS, HALL_SIZES = 8, 8
"""Empty halls of a size, whose numbers follow those of the seamless grounds; and sizes, each twice the last:
for cameras up to 280 m away."""
TEXTURE_SIZE = 128
SLOTS = tuple(FINISHES)
ALL_ZONES = tuple(sorted(ZONE_NAMES))


@dataclass(frozen=True)
class OwnFolders:
    """Folders of custom assets, or furniture catalogues (`mesh_folder`); None: the packaged ones."""

    panoramas: str | None = None
    props: str | None = None
    furniture: str | None = None


@dataclass(frozen=True)
class OwnAssets:
    """A user's custom assets: each kind present replaces the packaged one, furniture family by family.

    `sources` are the origins of those that come from furniture catalogues.
    """

    props: tuple[PropModel, ...] = ()
    furniture: tuple[FurnitureModel, ...] = ()
    panoramas: tuple[OwnPanorama, ...] = ()
    sources: tuple[Source, ...] = ()

    @staticmethod
    def read(folders: OwnFolders) -> "tuple[OwnAssets, list[str]]":
        """Read folders; also one sentence for each skipped file and each guess. Raises UserError."""
        notes: list[str] = []

        def read(reader: Callable[[str], tuple[list, list[str]]], folder: str | None) -> tuple:
            if folder is None:
                return ()
            assets, problems = reader(folder)
            notes.extend(problems)
            return tuple(assets)

        props, furniture = read(read_props, folders.props), read(read_furniture, folders.furniture)
        panoramas = read(read_envmaps, folders.panoramas)
        sources = _sources(folders.props, props) | _sources(folders.furniture, furniture)
        return OwnAssets(props, furniture, panoramas, tuple(sources)), notes

    def fingerprints(self) -> dict[str, str]:
        """Return hashes of the assets by kind and name."""
        fingerprints_by_name = {f"panorama/{own.name}": own.fingerprint for own in self.panoramas}
        fingerprints_by_name |= {f"prop/{own.name}": own.fingerprint for own in self.props}
        return fingerprints_by_name | {f"furniture/{own.name}": own.fingerprint for own in self.furniture}


def _sources(folder: str | None, assets: tuple[PropModel | FurnitureModel, ...]) -> dict[Source, None]:
    """Return the origins of assets that were read from a folder or catalogue, in the order of their names."""
    if folder is None:
        return {}
    return dict.fromkeys(read_sources(mesh_folder(folder)).of({asset.name for asset in assets}))


@dataclass(frozen=True, eq=False)
class PreparedRoom:
    """Parts of a room that the rasteriser and the search need.

    Attributes:
        layout: The room without its parts.
        packed: The parts.
        grounds: Slot and own mean albedo of each support's material.
    """

    layout: Layout
    packed: PackedAsset
    grounds: tuple[tuple[str, float], ...]


class Library:
    """The assets of a split's scenes, made on demand and cached up to a bound."""

    def __init__(self, split: Split, own: OwnAssets | None = None) -> None:
        self.split = split
        self.own = own or OwnAssets()
        self._props: dict[str, tuple[PropModel, ...]] = {f"own/{m.name}": (m,) for m in self.own.props}
        self._props = self._props or packaged_props(split)
        self.families = lru_cache(maxsize=256)(self._families)
        self.prop = lru_cache(maxsize=2048)(self._prop)  # 0.1 MB each, used long before they are packed
        self.shape = lru_cache(maxsize=4096)(self._shape)
        self.sizes = lru_cache(maxsize=4096)(self._sizes)
        self.layout = lru_cache(maxsize=256)(self._layout)  # all of a split, as the next two
        self.plan = lru_cache(maxsize=256)(self._plan)
        self.finish = lru_cache(maxsize=128)(self._finish)
        self.surface = lru_cache(maxsize=1024)(self._surface)
        self.radiance = lru_cache(maxsize=256)(self._radiance)
        self.light_parts = lru_cache(maxsize=4096)(self._light_parts)

    # Props

    def _families(self, zone: str, unlike: str = "") -> tuple[str, ...]:
        """Return the families of props that belong in a zone and are not like a class; any, where none is."""
        fits = [
            (family, is_of_class(models[0].family, unlike) or is_of_class(family, unlike))
            for family, models in self._props.items()
            if not models[0].zones or zone in models[0].zones
        ] or [(family, False) for family in self._props]
        return tuple(family for family, like in fits if not like) or tuple(family for family, _ in fits)

    def members(self, family: str) -> int:
        """Count the members of a family; as many numbers more are the same at half the size, and so on."""
        models = self._props.get(family, ())
        return len(models) if models and not models[0].varies else max(len(models), 1) * VARIANTS[self.split]

    def _prop(self, family: str, number: int) -> Prop:
        halvings, number = divmod(number, self.members(family))
        rng = asset_rng(self.split, f"prop/{family}", number)
        if family in HOLDERS:
            parts = HOLDERS[family](rng).parts
        else:
            model = self._props[family][number % len(self._props[family])]
            parts = vary(model.read(), rng) if model.varies else model.read()
        return Prop(family, tuple((scale_mesh(mesh, 0.5**halvings), stuff) for mesh, stuff in parts))

    def pack_prop(self, family: str, number: int) -> PackedAsset:
        """Return a prop for the rasteriser."""
        return self.shape(family, number)[0]

    def extremes(self, family: str, number: int) -> np.ndarray:
        """Return farthest points (N, 3) of a prop in its own frame, see `footprint.extreme_points`."""
        return self.shape(family, number)[1]

    def _shape(self, family: str, number: int) -> tuple[PackedAsset, np.ndarray]:
        def made() -> Arrays:
            parts = self.prop(family, number).parts
            extremes = extreme_points(np.concatenate([mesh.vertices for mesh, _ in parts]))
            return {"extremes": extremes, **pack(parts)}

        held = self._cached(bool(self.own.props), f"prop/{family}/{number}", made)
        return PackedAsset.from_arrays(held), held["extremes"]

    def _cached(self, own: bool, name: str, make: Callable[[], Arrays]) -> Arrays:
        """Return the arrays of an asset of the split, kept on disk but for a user's own."""
        return make() if own else asset_cache().arrays(f"{self.split}/{name}", make)

    def _sizes(self, family: str, number: int) -> np.ndarray:
        """Return extents (3,) in metres of a prop in its own frame."""
        return np.ptp(self.extremes(family, number), axis=0)

    # Rooms

    @property
    def layouts(self) -> int:
        """Count the furnished rooms."""
        return LAYOUTS[self.split]

    @property
    def sweeps(self) -> range:
        """Return numbers of the layouts that are seamless grounds."""
        return range(self.layouts, self.layouts + SWEEPS[self.split])

    def halls(self, size: int) -> range:
        """Return numbers of layouts that are empty halls, 2 to the `size` times as large as the smallest."""
        first = self.sweeps.stop + HALLS * size
        return range(first, first + HALLS)

    def _layout(self, number: int) -> Layout:
        """Return furnished room `number`, a seamless ground or an empty hall."""
        if number >= self.sweeps.stop:
            size = (number - self.sweeps.stop) // HALLS
            return draw_hall(asset_rng(self.split, "hall", number), 2.0**size)
        if number >= self.layouts:
            return draw_sweep(asset_rng(self.split, "sweep", number))
        return draw_layout(asset_rng(self.split, "layout", number), self._furniture)

    def _furniture(self, family: str, rng: np.random.Generator) -> Furniture:
        own = [model for model in self.own.furniture if _stands_for(model.family, family)]
        models = own or packaged_furniture(self.split)[family]
        model = models[int(rng.integers(len(models)))]
        return vary_furniture(model.read(), rng) if model.varies else model.read()

    def _plan(self, number: int) -> PreparedRoom:
        def made() -> Arrays:
            layout = self.layout(number)
            under = [material_under(layout, support) for support in layout.supports]
            # Black for a table top without a surface below.
            grounds = [
                ("top", 0.0) if each is None else (each.slot, float(each.texture.mean())) for each in under
            ]
            supports = [astuple(support) for support in layout.supports]
            return {
                "text": packed_text([layout.kind, layout.height, supports, grounds]),
                "outline": layout.outline,
                "solids": layout.solids,
                **pack(layout.parts),
            }

        held = self._cached(bool(self.own.furniture), f"layout/{number}", made)
        kind, height, supports, grounds = unpacked_text(held["text"])
        return PreparedRoom(
            Layout(
                kind=kind,
                parts=(),
                supports=tuple(
                    Support(zone, tuple(centre), tuple(half), *rest) for zone, centre, half, *rest in supports
                ),
                outline=held["outline"],
                height=height,
                solids=held["solids"],
            ),
            PackedAsset.from_arrays(held),
            tuple((slot, albedo) for slot, albedo in grounds),
        )

    def ground_albedo(self, room: Room) -> float:
        """Return the mean grey albedo of the object's support: of its finish, or of its own texture."""
        slot, own = self.plan(room.layout).grounds[room.support]
        finish = dict(room.finishes).get(slot)
        return own if finish is None else self.albedo(finish.kind, finish.asset)

    # Finishes

    def draw_finish(self, slot: str, rng: np.random.Generator) -> Surface:
        """Return a random finish that suits a slot."""
        kind = FINISHES[slot][int(rng.integers(len(FINISHES[slot])))]
        return Surface(
            kind, int(rng.integers(SURFACES_PER_KIND[self.split])), rng.uniform(*KINDS[kind].metres)
        )

    def _finish(self, kind: str, number: int) -> np.ndarray:
        """Return the texture (TEXTURE_SIZE, TEXTURE_SIZE, 3), linear RGB, of a finish, less saturated."""
        rng = asset_rng(self.split, f"surface/{kind}", number)
        image = texture(kind, rng, TEXTURE_SIZE)
        luminance = image.mean(axis=2, keepdims=True)
        # .85: lit rooms are seldom overexposed
        return 0.85 * (luminance + rng.uniform(0.1, 1.0) * (image - luminance))

    def pyramid(self, kind: str, number: int) -> TextureLevels:
        """Return a finish for the rasteriser."""
        return self.surface(kind, number)[0]

    def albedo(self, kind: str, number: int) -> float:
        """Return the mean grey albedo of a finish."""
        return self.surface(kind, number)[1]

    def _surface(self, kind: str, number: int) -> tuple[TextureLevels, float]:
        def made() -> Arrays:
            finish = self.finish(kind, number)
            pyramid, mean = TextureLevels.of(finish), float(finish.mean())
            return {"texels": pyramid.texels, "numbers": packed_text([pyramid.log_size, mean])}

        held = self._cached(False, f"surface/{kind}/{number}", made)
        (width, height), mean = unpacked_text(held["numbers"])
        return TextureLevels(held["texels"], (width, height)), mean

    # Light

    @property
    def panoramas(self) -> int:
        """Count the panoramas."""
        return len(self.own.panoramas) or PANORAMAS[self.split]

    def _radiance(self, number: int) -> np.ndarray:
        """Return panorama `number`: (H, 2H, 3) radiance at the paper's exposure; custom ones: their size."""
        own = self.own.panoramas
        if own:
            return _expose(own[number].radiance)
        rng = asset_rng(self.split, "panorama", number)
        held = self._cached(False, f"panorama/{number}", lambda: {"radiance": _expose(panorama(rng))})
        return held["radiance"]

    def surroundings(self, number: int) -> np.ndarray:
        """Return panorama `number` for a path tracer: that of `radiance`, or a custom one at full size."""
        own = self.own.panoramas
        return _expose(own[number].sharp()) if own else self.radiance(number)

    def _light_parts(self, number: int) -> np.ndarray:
        own, name = bool(self.own.panoramas), f"light/{number}"
        return self._cached(own, name, lambda: {"light": light_parts(self.radiance(number))})["light"]

    def light(self, number: int, angle: float, ground_albedo: float) -> np.ndarray:
        """Return SH light (9,) above a level support in a panorama turned by `angle` radians about +Z.

        At the paper's exposure. Light from below is the support's grey albedo times the light that the
        support gets from above.
        """
        light = local_light(self.light_parts(number), ground_albedo)
        # Same as `rotate_z`: each pair of harmonics cos(m phi), sin(m phi) is a complex number.
        for cosine, sine, m in ((3, 1, 1), (7, 5, 1), (8, 4, 2)):
            turned = complex(light[cosine], light[sine]) * cmath.exp(1j * m * angle)
            light[cosine], light[sine] = turned.real, turned.imag
        return light


def _expose(radiance: np.ndarray) -> np.ndarray:
    """Return a panorama (H, 2H, 3) at the paper's exposure."""
    return radiance * (EXPOSURE_L00 / grey(project_panorama(radiance))[0])


STANDS_FOR = {
    "table": ("dining_table", "cafe_table", "kitchen_island", "side_table"),
    "coffee_table": ("coffee_table", "side_table"),
    "desk": ("desk",),
    "counter": ("kitchen_counter", "kitchen_island"),
    "shelf": ("bookshelf", "wall_shelf"),
    "cabinet": ("sideboard", "media_bench", "wardrobe"),
    "nightstand": ("bedside_table",),
    "sofa": ("sofa",),
    "armchair": ("armchair",),
    "chair": ("chair",),
    "stool": ("stool", "side_table", "bar_stool"),
    "bench": ("bench",),
    "bed": ("bed",),
}
"""The families of the packaged catalogue that a custom piece of furniture replaces."""


def _stands_for(own: str, family: str) -> bool:
    return family == own or family in STANDS_FOR.get(own, ("side_table", "sideboard"))
