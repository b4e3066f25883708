r"""Light that arrives at points, as samples for bakes: a unit direction and a weight each, such that

    E(b) = sum over the samples of a point of weight max(b . w, 0)

is the irradiance on any normal b there. What rectangular lights send is sampled over their surfaces, what
other surfaces send over the hemisphere, where a light that is met is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from approximations.kit.sampling import hemisphere_direction, random_turn
from scenes.contract import AreaLight, View

LIFT = 1e-4  # m, off the surface


@dataclass
class Arriving:
    """`count` samples for each point, one point after another: unit directions and weights
    (radiance times solid angle, W m^-2)."""

    direction: mi.Vector3f
    weight: mi.Color3f
    count: int

    def on(self, b: mi.Vector3f) -> mi.Color3f:
        """Irradiance (W m^-2) on unit normals b, one for each point."""
        lane = dr.arange(mi.UInt32, dr.width(self.weight)) // self.count
        cosine = dr.maximum(dr.dot(dr.gather(mi.Vector3f, mi.Vector3f(b), lane), self.direction), 0)
        return dr.block_sum(self.weight * cosine, self.count)


def irradiance_on(
    view: View, p: mi.Point3f, n: mi.Vector3f, normals: list[mi.Vector3f], edge: int, paths: int
) -> list[mi.Color3f]:
    """Irradiance (W m^-2) at points p of surfaces with normals n on each of some other normals there, from
    the light's edge x edge points and `paths` light paths."""
    direct, bounced = from_lights(view, p, n, edge), from_surfaces(view, p, n, paths, seed=1)
    found = [direct.on(b) + bounced.on(b) for b in normals]
    dr.eval(found)
    return found


def from_lights(view: View, p: mi.Point3f, n: mi.Vector3f, edge: int) -> Arriving:
    """What the first light sends to points p of surfaces with normals n, by edge x edge points of it. The
    light is a rectangle."""
    light, count = view.lights[0], edge * edge
    lane, start = _spread(p, n, count)
    u, v = mi.Vector3f(light.u), mi.Vector3f(light.v)
    k, corner = lane % count, mi.Vector3f(light.centre) - u - v
    a, b = ((mi.Float(c) + 0.5) * 2 / edge for c in (k % edge, k // edge))
    towards = mi.Point3f(corner + a * u + b * v) - start
    far = dr.norm(towards)
    w = towards / far
    leaving = dr.maximum(-dr.dot(dr.cross(u, v), w), 0) * 4 / (count * far * far)
    above = dr.dot(dr.gather(mi.Vector3f, mi.Vector3f(n), lane // count), w) > 0
    seen = above & (view.trace(start, w) > 0.999 * far)
    return Arriving(w, dr.select(seen, leaving * mi.Color3f(light.radiance), 0), count)


def from_surfaces(view: View, p: mi.Point3f, n: mi.Vector3f, rays: int, seed: int) -> Arriving:
    """What surfaces send to points p of surfaces with normals n, by `rays` even directions over the
    hemisphere about n and one light path along each."""
    lane, start = _spread(p, n, rays)
    turn = dr.gather(mi.Float, random_turn(dr.width(n), seed), lane // rays)
    local = hemisphere_direction(lane % rays, rays, turn)
    w = mi.Frame3f(dr.gather(mi.Vector3f, mi.Vector3f(n), lane // rays)).to_world(local)
    met = view.gather(start, w, seed)
    lit = sum((dr.select(meets(view, light, start, w), mi.Float(1), 0) for light in view.lights), mi.Float(0))
    found = Arriving(w, dr.select(lit > 0, 0, 2 * dr.pi / rays * met), rays)
    dr.eval(found.direction, found.weight)
    return found


def meets(view: View, light: AreaLight, p: mi.Point3f, w: mi.Vector3f) -> mi.Bool:
    """Whether a ray from p along w meets the glowing side of a rectangle before anything else."""
    u, v = mi.Vector3f(light.u), mi.Vector3f(light.v)
    normal = dr.cross(u, v)
    facing = dr.dot(normal, w)
    t = dr.dot(normal, mi.Vector3f(light.centre) - p) / facing
    at = p + t * w - mi.Vector3f(light.centre)
    inside = (dr.abs(dr.dot(at, u)) < dr.squared_norm(u)) & (dr.abs(dr.dot(at, v)) < dr.squared_norm(v))
    return (facing < 0) & (t > 0) & inside & (view.trace(p, w) > t)


def _spread(p: mi.Point3f, n: mi.Vector3f, count: int) -> tuple[mi.UInt32, mi.Point3f]:
    """`count` lanes for each point, and where their rays start."""
    lane = dr.arange(mi.UInt32, dr.width(n) * count)
    return lane, dr.gather(mi.Point3f, mi.Point3f(p + LIFT * n), lane // count)
