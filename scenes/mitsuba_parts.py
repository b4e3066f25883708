"""Pieces of Mitsuba scene dictionaries and G-buffers that several scenes share."""

from __future__ import annotations

import hashlib
import math
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import AreaLight, Camera, Chart, Surface

SUN_DISTANCE = 1e5  # m: parallax across a scene of a few metres stays under 1e-4 rad
SMALL_SUN = 0.02  # rad


def direction(elevation_deg: float, azimuth_deg: float = 0.0) -> list[float]:
    """Unit vector at an elevation above the xy plane and an azimuth from +x towards +y."""
    e, a = math.radians(elevation_deg), math.radians(azimuth_deg)
    return [math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)]


def film(size: int) -> dict:
    """A square film with the box filter, so that pixels are independent."""
    return {
        "type": "hdrfilm",
        "width": size,
        "height": size,
        "pixel_format": "rgb",
        "rfilter": {"type": "box"},
    }


def perspective(origin: list[float], target: list[float], fov: float, size: int, **more: Any) -> dict:
    """A pinhole camera with z up; fov in degrees across the image."""
    up = [0, 0, 1] if abs(origin[0] - target[0]) + abs(origin[1] - target[1]) > 1e-6 else [0, 1, 0]
    return {
        "type": "perspective",
        "fov": fov,
        "near_clip": 0.01,
        "far_clip": 1e4,
        "to_world": mi.ScalarTransform4f().look_at(origin, target, up),
        "film": film(size),
        **more,
    }


def orthographic(origin: list[float], target: list[float], half_width: float, size: int) -> dict:
    """A parallel camera with z up that sees half_width to each side of the target."""
    return {
        "type": "orthographic",
        "near_clip": 0.01,
        "far_clip": 1e4,
        "to_world": mi.ScalarTransform4f()
        .look_at(origin, target, [0, 0, 1])
        .scale([half_width, half_width, 1]),
        "film": film(size),
    }


def round_sun(toward: list[float], angular_radius: float, irradiance: float) -> dict:
    """A far round light that subtends angular_radius (rad) and gives `irradiance` to a surface that faces it.

    A sphere, whose solid angle Mitsuba samples evenly; a disk below SMALL_SUN, where that sampling runs out
    of float32 digits and gives 0.14 % too much light at 5 mrad and 7 % at 1 mrad.
    """
    centre = [SUN_DISTANCE * x for x in toward]
    if angular_radius < SMALL_SUN:
        up = [0, 0, 1] if abs(toward[2]) < 0.9 else [0, 1, 0]
        facing = mi.ScalarTransform4f().look_at(centre, [0, 0, 0], up)
        shape = {"type": "disk", "to_world": facing.scale(SUN_DISTANCE * math.tan(angular_radius))}
    else:
        shape = {"type": "sphere", "center": centre, "radius": SUN_DISTANCE * math.sin(angular_radius)}
    radiance = irradiance / (math.pi * math.sin(angular_radius) ** 2)
    return {
        **shape,
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}},
    }


def point_sun(toward: list[float], irradiance: float) -> dict:
    """A directional light."""
    return {
        "type": "directional",
        "direction": [-x for x in toward],
        "irradiance": {"type": "rgb", "value": irradiance},
    }


def uniform_sky(radiance: float) -> dict:
    """The same radiance from every direction."""
    return {"type": "constant", "radiance": {"type": "rgb", "value": radiance}}


def diffuse(albedo: float | list[float]) -> dict:
    """A Lambertian surface."""
    return {"type": "diffuse", "reflectance": rgb(albedo)}


NARROWEST = 1e-3
"""GGX width that stands for a mirror beside a diffuse part."""


def glossy(albedo: Any, specular: Any, alpha: float) -> dict:
    """Lambertian reflection of `albedo` plus `specular` times a single-scattering GGX lobe of width `alpha`
    with Smith's masking and no Fresnel rise; at most 1/2 each.

    A mirror below NARROWEST, unless there is a diffuse part too: Mitsuba 3.9.1's `blendbsdf` adds the density
    of a smooth part to the probability of a mirror (diffuse 0.4 and mirror 0.2 under a uniform sky give 0.318
    instead of 0.300).
    """
    if not np.any(albedo) and alpha < NARROWEST:
        return {"type": "conductor", "material": "none", "specular_reflectance": rgb(specular)}
    lobe = {"type": "roughconductor", "material": "none", "distribution": "ggx"}
    lobe |= {"alpha": max(alpha, NARROWEST)}
    if not np.any(albedo):
        return lobe | {"specular_reflectance": rgb(specular)}
    return {
        "type": "blendbsdf",
        "weight": 0.5,
        "base": {"type": "diffuse", "reflectance": rgb(2 * np.asarray(albedo))},
        "lobe": lobe | {"specular_reflectance": rgb(2 * np.asarray(specular))},
    }


def environment_light(radiance: Callable[[mi.Vector3f], mi.Color3f], rows: int) -> dict:
    """Light from far away, z up, given by unit direction: an image of 2 rows x rows, looked up bilinearly.

    Mitsuba's columns stand at the middles of 2 rows equal angles and its rows at rows - 1 equal steps from
    pole to pole.
    """
    i = dr.arange(mi.UInt32, 2 * rows * rows)
    azimuth = (mi.Float(i % (2 * rows)) + 0.5) * (dr.pi / rows)
    polar = mi.Float(i // (2 * rows)) * (dr.pi / (rows - 1))
    s = dr.sin(polar)
    values = radiance(mi.Vector3f(s * dr.sin(azimuth), s * dr.cos(azimuth), dr.cos(polar)))
    image = np.array(values, np.float32).T.reshape(rows, 2 * rows, 3)
    upright = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    return {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(image)), "to_world": upright}


def mesh(positions: np.ndarray, faces: np.ndarray, uv: np.ndarray, normals: np.ndarray | None = None) -> dict:
    """Triangles as a Mitsuba dictionary: (n, 3) vertices in m, (m, 3) indices, (n, 2) texture coordinates,
    (n, 3) unit normals or the faces' own. The file lies with the temporary ones, named after its content."""
    parts = [positions, uv] if normals is None else [positions, uv, normals]
    content = np.round(np.hstack(parts) * 2**16).astype(np.int64).tobytes() + faces.tobytes()
    path = Path(tempfile.gettempdir()) / f"lightproof-{hashlib.sha256(content).hexdigest()[:24]}.ply"
    if not path.exists():
        flags = {"has_vertex_normals": normals is not None, "has_vertex_texcoords": True}
        made = mi.Mesh("mesh", len(positions), len(faces), **flags)
        values = mi.traverse(made)
        values["vertex_positions"] = np.ravel(positions).astype(np.float32)
        values["faces"] = np.ravel(faces).astype(np.uint32)
        values["vertex_texcoords"] = np.ravel(uv).astype(np.float32)
        if normals is not None:
            values["vertex_normals"] = np.ravel(normals).astype(np.float32)
        values.update()
        unfinished = path.with_suffix(f".{os.getpid()}")
        made.write_ply(str(unfinished))
        unfinished.replace(path)
    return {"type": "ply", "filename": str(path), "face_normals": normals is None}


def rgb(value: Any) -> dict:
    """A number or three as a Mitsuba colour."""
    grey = np.ndim(value) == 0
    return {"type": "rgb", "value": float(value) if grey else [float(x) for x in value]}


def area_light(light: AreaLight, texture: np.ndarray | None = None) -> dict:
    """A glowing shape as a Mitsuba dictionary; its fields must be numbers.

    texture: (rows, columns, 3) factors on the radiance of a rectangle, row 0 at t = 1, looked up bilinearly
    with clamping."""
    c, u, v = (np.asarray(x, float) for x in (light.centre, light.u, light.v))
    radiance = rgb(light.radiance)
    if texture is not None:
        bitmap = mi.Bitmap(np.ascontiguousarray(texture[::-1] * np.asarray(light.radiance), np.float32))
        radiance = {"type": "bitmap", "bitmap": bitmap, "raw": True, "wrap_mode": "clamp"}
    glow = {"bsdf": diffuse(0.0), "emitter": {"type": "area", "radiance": radiance}}
    if light.shape == "sphere":
        return {"type": "sphere", "center": list(c), "radius": float(np.linalg.norm(u)), **glow}
    if light.shape == "tube":
        ends = {"p0": list(c - u), "p1": list(c + u)}
        return {"type": "cylinder", **ends, "radius": float(np.linalg.norm(v)), **glow}
    n = np.cross(u, v)
    columns = np.column_stack([u, v, n / np.linalg.norm(n), c])
    to_world = mi.ScalarTransform4f(np.vstack([columns, [0, 0, 0, 1]]))
    return {"type": light.shape, "to_world": to_world, **glow}


def flat(chart: Chart, bsdf: dict) -> dict:
    """A chart as a Mitsuba rectangle, one-sided where its BSDF is; uv is (s, t)."""
    c, u, v = (np.asarray(x, float) for x in (chart.corner, chart.u, chart.v))
    n = np.cross(u, v)
    columns = np.column_stack([u / 2, v / 2, n / np.linalg.norm(n), c + (u + v) / 2])
    to_world = mi.ScalarTransform4f(np.vstack([columns, [0, 0, 0, 1]]))
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf}


def chart_index(p: mi.Point3f, charts: tuple[Chart, ...]) -> mi.UInt32:
    """The chart that each surface point lies on: the nearest."""
    nearest, index = mi.Float(dr.inf), mi.UInt32(0)
    for k, chart in enumerate(charts):
        c, u, v = (mi.Vector3f(x) for x in (chart.corner, chart.u, chart.v))
        s, t = (dr.clip(dr.dot(p - c, e) / dr.squared_norm(e), 0, 1) for e in (u, v))
        away = dr.squared_norm(p - (c + s * u + t * v))
        index = dr.select(away < nearest, mi.UInt32(k), index)
        nearest = dr.minimum(away, nearest)
    return index


def camera_rays(sensor: mi.Sensor, size: int) -> Camera:
    """Rays through the centres of size x size pixels, row by row from the top."""
    i = dr.arange(mi.UInt32, size * size)
    at = mi.Point2f(i % size + 0.5, i // size + 0.5) / size
    ray, _ = sensor.sample_ray(time=0.0, sample1=0.5, sample2=at, sample3=mi.Point2f(0.5))
    forward = sensor.world_transform() @ mi.Vector3f(0, 0, 1)
    return Camera(
        origin=dr.zeros(mi.Point3f, size * size) + ray.o,
        direction=dr.zeros(mi.Vector3f, size * size) + ray.d,
        forward=dr.normalize(mi.Vector3f(forward)),
        near=float(sensor.near_clip()),
        far=float(sensor.far_clip()),
    )


def g_buffer(surfaces: mi.Scene, camera: Camera) -> Surface:
    """First hits of the camera rays with the opaque surfaces of a scene."""
    si = surfaces.ray_intersect(mi.Ray3f(camera.origin, camera.direction))
    valid = si.is_valid()
    normal = dr.select(dr.dot(si.sh_frame.n, camera.direction) > 0, -si.sh_frame.n, si.sh_frame.n)
    albedo = si.bsdf().eval_diffuse_reflectance(si, valid)
    surface = Surface(valid, si.p, mi.Vector3f(normal), mi.Color3f(albedo), si.t, uv=si.uv)
    dr.eval(surface)
    return surface


def ray_tracer(surfaces: mi.Scene):
    """trace(o, d): the distance to the first surface, infinite where there is none."""

    def trace(o: mi.Point3f, d: mi.Vector3f) -> mi.Float:
        return surfaces.ray_intersect_preliminary(mi.Ray3f(o, d)).t

    return trace


def light_solver(world: mi.Scene, depth: int = -1):
    """gather(p, w, seed): one path's radiance that arrives at p from w, as an offline light-map compiler
    has it. depth: Mitsuba's max_depth, 1 for light seen directly. Evaluated at once, in a kernel of its own,
    since OptiX traces in one scene a kernel."""
    integrator = mi.load_dict({"type": "path", "max_depth": depth})

    def gather(p: mi.Point3f, w: mi.Vector3f, seed: int) -> mi.Color3f:
        random = mi.load_dict({"type": "independent"})
        random.seed(seed, dr.width(p + w))
        dr.eval(p, w)
        light = integrator.sample(world, random, mi.RayDifferential3f(p, w))[0]
        dr.eval(light)
        return light

    return gather


def ray_caster(surfaces: mi.Scene):
    """visible(p, n, w): true where no surface lies from p along w. p is lifted along n by 1e-4 m."""

    def visible(p: mi.Point3f, n: mi.Vector3f, w: mi.Vector3f) -> mi.Bool:
        return ~surfaces.ray_test(mi.Ray3f(p + 1e-4 * n, w))

    return visible
