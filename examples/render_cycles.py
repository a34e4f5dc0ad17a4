"""Path-traces one exported scene with Cycles: `python render_cycles.py SCENE.npz OUT.npz`.

Runs in an environment of its own (Python 3.11, `pip install bpy "numpy<2"`) and imports nothing of vig.
SCENE.npz and SCENE.json beside it are written by `vig.synthesis.build.export`. OUT.npz holds

    image    (H, W, 3) float32: linear RGB, the panorama at its own scale: neither exposed nor clipped
    probe    (32, 64, 3) float32: linear radiance that arrives at the object's place with the object removed,
             equirectangular as `vig.scene.project_panorama` reads it
    amodal   (H, W) float32: share of each pixel that the object alone covers
    visible  (H, W) float32: share of each pixel that shows the object

The object is a Lambertian surface, as in vig's model; everything else is a little glossy, as its kind and
roughness say. Walls and ceiling are seen by the camera but let the panorama's light through, which stands
for the room; table, floor and props cast shadows and reflect light.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

PROBE_HEIGHT = 32
PROBE_POSITION = (0.0, 0.0, 0.05)
PROBE_SAMPLES = 256
MASK_SAMPLES = 64
LET_LIGHT_THROUGH = ("wall", "ceiling")


def main() -> None:
    parser = argparse.ArgumentParser(description="Path-trace one exported scene with Cycles.")
    parser.add_argument("scene", type=Path, help="SCENE.npz, with SCENE.json beside it")
    parser.add_argument("out", type=Path, help="OUT.npz")
    parser.add_argument("--samples", type=int, default=256, help="paths per pixel")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--alone", action="store_true", help="the object in the panorama, nothing else")
    arguments = parser.parse_args()

    described = json.loads(arguments.scene.with_suffix(".json").read_text())
    with np.load(arguments.scene) as arrays:
        results = trace(described, dict(arrays), arguments.samples, arguments.threads, arguments.alone)
    np.savez_compressed(arguments.out, **results)


def trace(
    described: dict, arrays: dict[str, np.ndarray], samples: int, threads: int, alone: bool
) -> dict[str, np.ndarray]:
    """Build the scene in Blender and render the four arrays of the module's docstring."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    settle(scene, samples, threads)
    light_up(scene, arrays["panorama"], described["spec"]["panorama_angle"])
    shown = described["instances"][:1] if alone else described["instances"]
    objects = [add(scene, number, about, arrays) for number, about in enumerate(shown)]
    target, others = objects[0], objects[1:]

    scene.camera = pinhole(scene, described["camera"])
    results = {"image": render(scene)[..., :3]}

    scene.cycles.use_denoising = False
    scene.render.film_transparent = True
    scene.cycles.samples = MASK_SAMPLES
    for thing in others:
        thing.is_holdout = True
    results["visible"] = render(scene)[..., 3]
    for thing in others:
        thing.hide_render = True
    results["amodal"] = render(scene)[..., 3]

    scene.render.film_transparent = False
    scene.cycles.samples = PROBE_SAMPLES
    target.hide_render = True
    for thing, about in zip(others, shown[1:], strict=True):
        thing.is_holdout = False
        thing.hide_render = about["name"] in LET_LIGHT_THROUGH
    scene.camera = probe(scene)
    results["probe"] = mirrored(render(scene)[..., :3])
    return results


def settle(scene: bpy.types.Scene, samples: int, threads: int) -> None:
    """Settings of the path tracer: unbiased but for the clamp of rare bright samples; seeded."""
    scene.render.engine = "CYCLES"
    scene.render.threads_mode, scene.render.threads = "FIXED", threads
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"
    scene.view_settings.exposure, scene.view_settings.gamma = 0.0, 1.0
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGBA", "32"
    cycles = scene.cycles
    cycles.device, cycles.seed, cycles.samples = "CPU", 0, samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = 6
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.sample_clamp_direct, cycles.sample_clamp_indirect = 0.0, 10.0


def mirrored(image: np.ndarray) -> np.ndarray:
    """An equirectangular image (H, W, C) between vig's columns and Blender's; its own inverse.

    vig's column j of W lies at azimuth 2 pi (j + 0.5) / W; Blender's middle column is +X and azimuth falls
    from left to right.
    """
    width = image.shape[1]
    return image[:, (width // 2 - 1 - np.arange(width)) % width]


def float_image(name: str, pixels: np.ndarray) -> bpy.types.Image:
    """Linear RGB (H, W, 3), row 0 on top, as an image of Blender, used as it is."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pixels[::-1]
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    return image


def light_up(scene: bpy.types.Scene, panorama: np.ndarray, angle: float) -> None:
    """Surround the scene by the panorama (H, W, 3), turned by `angle` radians about +Z."""
    world = bpy.data.worlds.new("panorama")
    scene.world = world
    world.use_nodes = True
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", 512
    nodes, links = world.node_tree.nodes, world.node_tree.links
    environment = nodes.new("ShaderNodeTexEnvironment")
    environment.image = float_image("panorama", mirrored(panorama))
    mapping = nodes.new("ShaderNodeMapping")
    mapping.inputs["Rotation"].default_value[2] = -angle  # turns the direction that is looked up
    coordinates = nodes.new("ShaderNodeTexCoord")
    links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    links.new(mapping.outputs["Vector"], environment.inputs["Vector"])
    links.new(environment.outputs["Color"], nodes["Background"].inputs["Color"])


def add(scene: bpy.types.Scene, number: int, about: dict, arrays: dict[str, np.ndarray]) -> bpy.types.Object:
    """Instance `number` of the export as an object of Blender, with its normals and its material."""
    name = about["name"]
    mesh = bpy.data.meshes.new(name)
    faces = arrays[f"{number}_faces"]
    mesh.from_pydata(arrays[f"{number}_vertices"].tolist(), [], faces.tolist())
    layer = mesh.uv_layers.new(name="uv")
    layer.uv.foreach_set("vector", arrays[f"{number}_uv"][faces.ravel()].astype(np.float32).ravel())
    mesh.normals_split_custom_set_from_vertices(arrays[f"{number}_normals"].tolist())
    mesh.materials.append(material(about, arrays[f"{number}_texture"]))
    thing = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(thing)
    if name in LET_LIGHT_THROUGH:
        thing.visible_diffuse = thing.visible_glossy = thing.visible_shadow = False
        thing.visible_transmission = thing.visible_volume_scatter = False
    return thing


def material(about: dict, texture: np.ndarray) -> bpy.types.Material:
    """The object: Lambertian. The rest: textured, with the gloss of its kind; glass is glazed, not clear."""
    result = bpy.data.materials.new(about["name"])
    result.use_nodes = True
    nodes, links = result.node_tree.nodes, result.node_tree.links
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")
    if about["name"] == "target":
        shader = nodes.new("ShaderNodeBsdfDiffuse")
        shader.inputs["Color"].default_value = (*texture.reshape(-1, 3)[0].tolist(), 1.0)
        shader.inputs["Roughness"].default_value = 0.0
    else:
        shader = nodes.new("ShaderNodeBsdfPrincipled")
        picture = nodes.new("ShaderNodeTexImage")
        picture.image = float_image(about["name"], texture)
        links.new(picture.outputs["Color"], shader.inputs["Base Color"])
        shader.inputs["Roughness"].default_value = about["roughness"]
        shader.inputs["Metallic"].default_value = 0.8 if about["kind"] == "metal" else 0.0
        matt = about["kind"] in ("cloth", "earth", "paper", "paint", "wallpaper", "brick")
        shader.inputs["Specular IOR Level"].default_value = 0.1 if matt else 0.5
    links.new(shader.outputs["BSDF"], output.inputs["Surface"])
    return result


def pinhole(scene: bpy.types.Scene, about: dict) -> bpy.types.Object:
    """The exported OpenCV camera; Blender's looks along -Z with Y up."""
    width, height = about["width"], about["height"]
    (focal, _, cx), (_, _, cy), _ = about["K"]
    scene.render.resolution_x, scene.render.resolution_y = width, height
    data = bpy.data.cameras.new("camera")
    data.sensor_fit, data.sensor_width = "HORIZONTAL", 36.0
    data.lens = 36.0 * focal / width
    data.shift_x, data.shift_y = (width / 2 - cx) / width, (cy - height / 2) / width
    data.clip_start, data.clip_end = 0.01, 100.0
    rotation = np.array(about["rotation"])
    pose = np.eye(4)
    pose[:3, :3] = rotation.T @ np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = -rotation.T @ np.array(about["translation"])
    camera = bpy.data.objects.new("camera", data)
    scene.collection.objects.link(camera)
    camera.matrix_world = pose.T.tolist()  # mathutils reads the columns of this list
    return camera


def probe(scene: bpy.types.Scene) -> bpy.types.Object:
    """A camera that sees all directions from the object's place, +X in the middle."""
    scene.render.resolution_x, scene.render.resolution_y = 2 * PROBE_HEIGHT, PROBE_HEIGHT
    data = bpy.data.cameras.new("probe")
    data.type = "PANO"
    data.panorama_type = "EQUIRECTANGULAR"
    data.clip_start = 0.001
    camera = bpy.data.objects.new("probe", data)
    camera.location = PROBE_POSITION
    camera.rotation_euler = (math.pi / 2, 0.0, -math.pi / 2)
    scene.collection.objects.link(camera)
    return camera


def render(scene: bpy.types.Scene) -> np.ndarray:
    """Render to linear RGBA (H, W, 4) float32, row 0 on top."""
    with tempfile.TemporaryDirectory() as folder, quiet():
        scene.render.filepath = str(Path(folder) / "render.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        width, height = image.size
        pixels = np.empty(height * width * 4, np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)[::-1].copy()


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep Blender's progress, which it writes to the process's standard output, out of the way."""
    kept = os.dup(1)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


if __name__ == "__main__":
    main()
