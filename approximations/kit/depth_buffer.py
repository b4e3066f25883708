"""The depth buffer of a pinhole camera: points to pixels, and depths back to points.

A pixel (x, y) looks along q = c + x r + y d, the ray at 1 m of depth; depth z is measured along the camera's
forward axis (m), so that the point seen is eye + z q.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from scenes.contract import View


@dataclass
class DepthBuffer:
    """eye (m); forward, unit; q of the corner pixel's centre, and its step to the right and down; z by pixel,
    infinite where nothing is seen."""

    eye: mi.Point3f
    forward: mi.Vector3f
    corner: mi.Vector3f
    right: mi.Vector3f
    down: mi.Vector3f
    z: mi.Float
    width: int
    height: int

    def project(self, p: mi.Point3f) -> tuple[mi.Point2f, mi.Float]:
        """(x, y) in pixels, whole at their centres, and z of a point."""
        v = mi.Vector3f(p) - self.eye
        z = dr.dot(v, self.forward)
        q = v / z - self.corner
        x = dr.dot(q, self.right) / dr.squared_norm(self.right)
        return mi.Point2f(x, dr.dot(q, self.down) / dr.squared_norm(self.down)), z

    def fetch(self, at: mi.Point2f) -> mi.Float:
        """z of the nearest pixel, infinite outside the screen."""
        pixel = mi.Point2i(dr.round(at))
        inside = dr.all((pixel >= 0) & (pixel < mi.Point2i(self.width, self.height)))
        index = dr.fma(mi.UInt32(pixel.y), self.width, mi.UInt32(pixel.x))
        return dr.select(inside, dr.gather(mi.Float, self.z, index, inside), dr.inf)

    def point(self, at: mi.Point2f) -> tuple[mi.Point3f, mi.Bool]:
        """The point seen by the nearest pixel, and whether there is one."""
        z = self.fetch(at)
        seen = dr.isfinite(z)
        whole = dr.round(at)
        q = self.corner + whole.x * self.right + whole.y * self.down
        return mi.Point3f(self.eye + dr.select(seen, z, 0) * q), seen

    def pixels(self, length: float, z: mi.Float) -> mi.Float:
        """How many pixels a length (m) across the view spans at depth z."""
        return length / (z * dr.norm(self.right))


def depth_buffer(view: View) -> DepthBuffer:
    """What a deferred renderer has kept of the visible surface. Rays start on the near plane."""
    camera, w = view.camera, view.width

    def ray(pixel: int) -> mi.Vector3f:
        d = dr.gather(mi.Vector3f, camera.direction, mi.UInt32(pixel))
        return d / dr.dot(d, camera.forward)

    corner, across, below = ray(0), w // 2, view.height // 2
    right, down = (ray(across) - corner) / across, (ray(w * below) - corner) / below
    eye = dr.gather(mi.Point3f, camera.origin, mi.UInt32(0)) - camera.near * corner
    z = dr.dot(view.surface.position - eye, camera.forward)
    z = dr.select(view.surface.valid, z, dr.inf)
    dr.eval(z)
    return DepthBuffer(eye, camera.forward, corner, right, down, z, w, view.height)
