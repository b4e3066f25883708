"""The depth buffer of a view as a texture: where a point falls on the screen, and what stands there.

Depth is z along the camera's forward axis (m), not the distance along the ray. Texels hold what their centre
sees; where it meets nothing the depth is infinite. A pixel's ray over its depth, q = d / (d . f), is linear
in the pixel's coordinates, which gives the screen's axes without any matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from scenes.contract import View


@dataclass
class DepthBuffer:
    """width, height in texels; origin: the eye; corner: q of the first texel's centre; right, down: how it
    changes from texel to texel; z per texel."""

    width: int
    height: int
    origin: mi.Point3f
    forward: mi.Vector3f
    corner: mi.Vector3f
    right: mi.Vector3f
    down: mi.Vector3f
    z: mi.Float

    def project(self, p: mi.Point3f) -> tuple[mi.Point2f, mi.Float]:
        """Texel coordinates of a point, 0 at the centre of the first texel, and its depth (m)."""
        v = p - self.origin
        z = dr.dot(v, self.forward)
        q = v / z - self.corner
        x = dr.dot(q, self.right) / dr.squared_norm(self.right)
        y = dr.dot(q, self.down) / dr.squared_norm(self.down)
        return mi.Point2f(x, y), z

    def fetch(self, at: mi.Point2f) -> tuple[mi.Float, mi.Bool]:
        """Depth in the nearest texel, and whether the point lies on the screen; infinite off it."""
        i, j = dr.round(at.x), dr.round(at.y)
        on = (i >= 0) & (j >= 0) & (i < self.width) & (j < self.height)
        index = mi.UInt32(dr.select(on, j * self.width + i, 0))
        return dr.select(on, dr.gather(mi.Float, self.z, index, on), dr.inf), on

    def reach(self, radius: float, z: mi.Float) -> mi.Float:
        """Texels that a radius (m) at a depth spans along the screen, at most its width."""
        return dr.minimum(radius / (z * dr.norm(self.right)), self.width)

    def surface_at(self, at: mi.Point2f) -> mi.Point3f:
        """The point that stands in the nearest texel, infinitely far off the screen and where nothing is."""
        z, _ = self.fetch(at)
        at = dr.round(at)
        return self.origin + z * (self.corner + at.x * self.right + at.y * self.down)


def depth_buffer(view: View) -> DepthBuffer:
    """Of a perspective view with square pixels, whose rays start on the near plane."""
    camera, w, h = view.camera, view.width, view.height
    forward = mi.Vector3f(camera.forward)
    cosine = dr.dot(camera.direction, forward)
    q = camera.direction / cosine

    def at(index: int) -> mi.Vector3f:
        return dr.gather(mi.Vector3f, q, mi.UInt32(index))

    corner = at(0)
    return DepthBuffer(
        w,
        h,
        dr.gather(mi.Point3f, camera.origin, mi.UInt32(0)) - camera.near * corner,
        forward,
        corner,
        (at(w - 1) - corner) / (w - 1),
        (at((h - 1) * w) - corner) / (h - 1),
        view.surface.distance * cosine + camera.near,
    )
