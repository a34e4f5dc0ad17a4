"""One scene of a `wire` message, built in Blender and path traced with Cycles."""

from __future__ import annotations

import math
import os
import time
from pathlib import Path
from typing import Any

import bpy
import materials
import numpy as np


def version() -> str:
    """Return Blender's version."""
    return bpy.app.version_string


def trace(
    header: dict[str, Any], arrays: dict[str, np.ndarray], threads: int, folder: Path
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Render a scene's `image` (H, W, 3) and `probe` (h, 2h, 4), linear; the header holds timings in seconds.

    The scene is built from nothing, so that it does not depend on earlier ones, and turned by minus
    `angle` about +Z instead of turning the panorama, which is looked up at every path's end. The probe's
    columns are the panorama's; its colours lack the panorama itself, seen where the fourth channel, coverage,
    is less than 1: the bright specks of a panorama would need many more samples than all the rest.
    """
    began = (time.perf_counter(), os.times())
    clear()
    scene = bpy.context.scene
    settle(scene, header, threads)
    surround(scene, arrays["panorama"])
    turn = np.eye(4)
    c, s = math.cos(header["angle"]), math.sin(header["angle"])
    turn[:2, :2] = [[c, s], [-s, c]]
    pictures = materials.pictures(arrays)
    for number, about in enumerate(header["things"]):
        add(scene, number, about, arrays, pictures).matrix_world = turn.T.tolist()
    built = time.perf_counter()

    scene.camera = pinhole(scene, header["camera"], turn)
    results = {"image": render(scene, folder)[..., :3]}
    drawn = time.perf_counter()

    probe_settings(scene, header)
    scene.camera = probe(scene, header["probe"])
    results["probe"] = mirror_columns(render(scene, folder))
    ended, times = time.perf_counter(), os.times()
    return {
        "build_s": built - began[0],
        "image_s": drawn - built,
        "probe_s": ended - drawn,
        "cpu_s": times.user + times.system - began[1].user - began[1].system,
    }, results


def clear() -> None:
    """Remove everything of the previous scene."""
    for kind in ("objects", "meshes", "cameras", "materials", "images", "worlds"):
        bpy.data.batch_remove(list(getattr(bpy.data, kind)))


def settle(scene: bpy.types.Scene, header: dict[str, Any], threads: int) -> None:
    """Set up the path tracer; docs/world.md describes the rendering."""
    scene.render.engine = "CYCLES"
    scene.render.threads_mode, scene.render.threads = "FIXED", threads
    scene.render.resolution_percentage = 100
    scene.render.use_compositing = scene.render.use_sequencer = False
    scene.render.use_file_extension = False
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGBA", "32"
    image.exr_codec = "NONE"
    scene.render.film_transparent = False
    cycles = scene.cycles
    cycles.device, cycles.seed, cycles.samples = "CPU", header["seed"], header["samples"]
    cycles.sampling_pattern = "TABULATED_SOBOL"
    cycles.use_adaptive_sampling = False
    cycles.use_light_tree = False
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 4, 4, 2
    cycles.caustics_reflective = cycles.caustics_refractive = False
    # at most 10 times the radiance of white paper in the exposed picture by one indirect path
    cycles.sample_clamp_direct, cycles.sample_clamp_indirect = 0.0, 10.0
    cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
    cycles.denoising_input_passes, cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "NONE"
    cycles.denoising_quality, cycles.denoising_use_gpu = "HIGH", False


def surround(scene: bpy.types.Scene, panorama: np.ndarray) -> None:
    """Surround the scene by the panorama (H, W, 3), linear radiance."""
    world = bpy.data.worlds.new("panorama")
    scene.world = world
    world.use_nodes = True
    width = panorama.shape[1]
    # columns of the map by which Cycles aims at the bright parts of the panorama
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", max(512, width)
    nodes, links = world.node_tree.nodes, world.node_tree.links
    environment = nodes.new("ShaderNodeTexEnvironment")
    environment.image = materials.float_image("panorama", mirror_columns(panorama))
    links.new(environment.outputs["Color"], nodes["Background"].inputs["Color"])


def mirror_columns(image: np.ndarray) -> np.ndarray:
    """Return an equirectangular image (H, W, C) between vig's columns and Blender's; its own inverse.

    vig's column j of W lies at azimuth 2 pi (j + 0.5) / W; Blender's middle column is +X and azimuth falls
    from left to right.
    """
    width = image.shape[1]
    return image[:, (width // 2 - 1 - np.arange(width)) % width]


def add(
    scene: bpy.types.Scene,
    number: int,
    about: dict[str, Any],
    arrays: dict[str, np.ndarray],
    pictures: dict[str, bpy.types.Image],
) -> bpy.types.Object:
    """Add thing `number` to the scene, with its normals and material and its ray-visibility flags set."""
    name = f"{number:04d}"
    vertices, faces = arrays[f"{number}_vertices"], arrays[f"{number}_faces"]
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.ravel())
    mesh.loops.add(faces.size)
    mesh.loops.foreach_set("vertex_index", faces.ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    normals = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "POINT")
    normals.data.foreach_set("vector", arrays[f"{number}_normals"].ravel())
    if f"{number}_uv" in arrays:
        mesh.uv_layers.new(name="uv").uv.foreach_set("vector", arrays[f"{number}_uv"].ravel())
    mesh.materials.append(materials.make(name, about["material"], pictures, about["shell"]))
    thing = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(thing)
    if about["shell"]:
        thing.visible_diffuse = thing.visible_glossy = thing.visible_shadow = False
        thing.visible_transmission = thing.visible_volume_scatter = False
    thing["in_probe"] = not (about["shell"] or about["target"])
    return thing


def pinhole(scene: bpy.types.Scene, about: dict[str, Any], turn: np.ndarray) -> bpy.types.Object:
    """Return Blender's camera for an OpenCV one (`camera_from_world`); it looks along -Z with Y up."""
    width, height, focal = about["width"], about["height"], about["focal"]
    scene.render.resolution_x, scene.render.resolution_y = width, height
    data = bpy.data.cameras.new("camera")
    data.sensor_fit, data.sensor_width = "HORIZONTAL", 36.0
    data.lens = 36.0 * focal / width
    data.shift_x, data.shift_y = (width / 2 - about["cx"]) / width, (about["cy"] - height / 2) / width
    data.clip_start, data.clip_end = about["near"], 100.0
    rotation = np.array(about["rotation"])
    pose = np.eye(4)
    pose[:3, :3] = rotation.T @ np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = -rotation.T @ np.array(about["translation"])
    return _place_object(scene, data, turn @ pose)


def probe(scene: bpy.types.Scene, about: dict[str, Any]) -> bpy.types.Object:
    """Add a camera at (0, 0, `z`) that sees all directions, the panorama's +X in the middle."""
    scene.render.resolution_x, scene.render.resolution_y = 2 * about["height"], about["height"]
    data = bpy.data.cameras.new("probe")
    data.type, data.panorama_type = "PANO", "EQUIRECTANGULAR"
    data.clip_start = 0.001
    pose = np.eye(4)
    pose[:3, :3] = [[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]  # columns: right, up, backwards
    pose[2, 3] = about["z"]
    return _place_object(scene, data, pose)


def probe_settings(scene: bpy.types.Scene, header: dict[str, Any]) -> None:
    """Hide the object and the walls, which let light through; no denoising, as only sums matter."""
    for thing in scene.objects:
        thing.hide_render = not thing.get("in_probe", True)
    scene.cycles.samples = header["probe"]["samples"]
    scene.cycles.use_denoising = False
    scene.render.film_transparent = True


def _place_object(scene: bpy.types.Scene, data: bpy.types.Camera, pose: np.ndarray) -> bpy.types.Object:
    camera = bpy.data.objects.new(data.name, data)
    scene.collection.objects.link(camera)
    camera.matrix_world = pose.T.tolist()  # mathutils reads the columns of this list
    return camera


def render(scene: bpy.types.Scene, folder: Path) -> np.ndarray:
    """Render to linear RGBA (H, W, 4) float32, row 0 on top."""
    scene.render.filepath = str(folder / "render.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    width, height = image.size
    pixels = np.empty(height * width * 4, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)[::-1].copy()
