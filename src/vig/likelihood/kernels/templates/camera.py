"""The camera: points between its frame and the screen, and how cotangents pull back.

A point on the screen is (x, y, q): its pixel coordinates and one over its depth.
"""

import warp as wp


@wp.struct
class Eye:
    """One image's camera; rotation: camera_from_world; level: to the right of the camera before its
    roll, as a direction in the image."""

    rotation: mat33
    level: vec2
    distance: real
    focal: real
    cx: real
    cy: real
    width: real


@wp.func
def eye_of(image: int, view: View):
    eye = Eye()
    eye.rotation = view.rotation[image]
    eye.level = view.level[image]
    eye.distance = view.distance
    intrinsics = view.intrinsics[image]
    eye.focal = intrinsics[0]
    eye.cx = intrinsics[1]
    eye.cy = intrinsics[2]
    eye.width = real(view.width)
    return eye


@wp.func
def camera_point(eye: Eye, screen: vec3):
    """Where a point on the screen is in the camera's frame, metres."""
    depth = real(1.0) / screen[2]
    scale = depth / eye.focal
    return vec3((screen[0] - eye.cx) * scale, (screen[1] - eye.cy) * scale, depth)


@wp.func
def camera_cotangent(eye: Eye, screen: vec3, on_screen: vec3):
    """Pull a cotangent on (x, y, q) back to the camera's frame."""
    scale = eye.focal * screen[2]
    # x = f X / Z + cx and q = 1 / Z: dx/dZ = -q (x - cx), dq/dZ = -q^2.
    along = on_screen[0] * (screen[0] - eye.cx) + on_screen[1] * (screen[1] - eye.cy)
    return vec3(scale * on_screen[0], scale * on_screen[1], -screen[2] * (along + screen[2] * on_screen[2]))


@wp.func
def turned(eye: Eye, cotangent: vec3, arm: vec3):
    """Pull a cotangent on a vector that rotates with the camera back to azimuth, elevation and roll."""
    up = vec3(eye.rotation[0, 2], eye.rotation[1, 2], eye.rotation[2, 2])
    # A small turn w moves a vector v by w x v: its derivative is w . (v x cotangent).
    torque = wp.cross(arm, cotangent)
    return vec3(-wp.dot(up, torque), eye.level[0] * torque[0] + eye.level[1] * torque[1], torque[2])


@wp.func
def framed(eye: Eye, on_screen: vec3, screen: vec3):
    """Pull a cotangent on pixel coordinates back to shift and magnification."""
    return vec3(
        on_screen[0] * eye.width,
        on_screen[1] * eye.width,
        # exp(log magnification) scales about the principal point.
        on_screen[0] * (screen[0] - eye.cx) + on_screen[1] * (screen[1] - eye.cy),
    )
