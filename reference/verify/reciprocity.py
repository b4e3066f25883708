r"""Paths may be walked either way.

Of a surface between media of index n_i, where it is seen from, and n_o, where light comes from:

    f(i, o) / n_i^2 = f(o, i) / n_o^2.

Of a whole scene: a small light on disk a and a meter on disk b may change places, and with radiance 1 the
flux is the same, A_b E_b = A_a E_a.
"""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.energy import INDEX, homogeneous
from reference.verify.rendered import BLACK, joined, mean_of
from scenes.mitsuba_parts import diffuse


@check(
    "physics",
    claim="f(i, o) / n_i^2 = f(o, i) / n_o^2",
    routes=("f(i, o)", "f(o, i)"),
)
def reciprocity_of_bsdfs(seed: int) -> list[Comparison]:
    """At those of 4096 pairs of directions where either reaches 1 % of the largest value; `within` is float32
    rounding, 1e-4 of the value."""
    rough = {"distribution": "ggx", "alpha": 0.3}
    plugins = {
        "diffuse": diffuse(0.7),
        "rough conductor": {"type": "roughconductor", "material": "Au", **rough},
        "anisotropic conductor": {
            "type": "roughconductor",
            "material": "Cr",
            "distribution": "beckmann",
            "alpha_u": 0.2,
            "alpha_v": 0.5,
        },
        "rough dielectric": {"type": "roughdielectric", "int_ior": INDEX, "ext_ior": 1.0, **rough},
        "rough plastic": {"type": "roughplastic", **rough},
    }
    found = []
    for label, plugin in plugins.items():
        i, o = directions(4096, label == "rough dielectric", seed)
        one, other = (bsdf_over_index(mi.load_dict(plugin), *pair) for pair in ((i, o), (o, i)))
        both = np.maximum(one, other)
        one, other = (f[both > 0.01 * both.max()] for f in (one, other))
        found.append(Comparison(label, Sampled.exact(one), Sampled.exact(other), within=1e-4 * other))
    return found


@check(
    "physics",
    claim="a small light and a small meter may change places in any scene",
    routes=("light at a, meter at b", "light at b, meter at a"),
)
def reciprocity_of_transport(seed: int) -> Comparison:
    """Two disks of different size behind a block, beside a white wall, with a cloud between: flux, W."""
    one, other = (
        joined([mean_of(exchange(a, b), 16, 40, 2 * seed + swapped)], np.pi * b["radius"] ** 2)
        for swapped, (a, b) in enumerate(((PLACES[0], PLACES[1]), (PLACES[1], PLACES[0])))
    )
    return Comparison("flux from disk to disk", one, other)


PLACES = (
    {"at": [-1.0, 0.0, 0.0], "toward": [1.0, 0.3, 0.0], "radius": 0.8},
    {"at": [1.2, 0.4, 0.3], "toward": [-1.0, 0.5, 0.2], "radius": 0.5},
)


def exchange(light: dict, meter: dict) -> dict:
    """A light of radiance 1 on one disk and a meter on another, with what scatters between them."""
    move = mi.ScalarTransform4f()

    def disk(place: dict) -> dict:
        toward = [a + b for a, b in zip(place["at"], place["toward"], strict=True)]
        to_world = move.look_at(place["at"], toward, [0, 0, 1]).scale(place["radius"])
        return {"type": "disk", "to_world": to_world, "bsdf": BLACK}

    wall = move.translate([0, 1.5, 0]).rotate([1, 0, 0], 90).scale(3)
    return {
        "type": "scene",
        "light": {
            **disk(light),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1.0}},
        },
        "meter": disk(meter),
        "wall": {"type": "rectangle", "to_world": wall, "bsdf": diffuse(0.8)},
        "block": {
            "type": "cube",
            "to_world": move.translate([0.5, -0.2, 0.1]).scale(0.2),
            "bsdf": diffuse(0.5),
        },
        "cloud": {
            "type": "sphere",
            "center": [0.1, 0.6, 0.2],
            "radius": 0.5,
            "bsdf": {"type": "null"},
            "interior": homogeneous(3.0, 0.6, 0.95),
        },
    }


def directions(n: int, both_sides: bool, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of unit directions (n, 3) at least 6 degrees above the surface, or on either side of it."""
    rng = np.random.default_rng(seed)
    azimuth, z = 2 * np.pi * rng.random((2, n)), rng.uniform(0.1, 1, (2, n))
    if both_sides:
        z *= rng.choice([-1, 1], (2, n))
    s = np.sqrt(1 - z**2)
    w = np.stack([s * np.cos(azimuth), s * np.sin(azimuth), z], axis=-1)
    return w[0], w[1]


def bsdf_over_index(bsdf: mi.BSDF, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """f(i, o) / n_i^2, first channel; light comes from o and is seen along i; n is 1 above the surface."""
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(i.T.astype(np.float32))
    value = bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(o.T.astype(np.float32)))
    index = np.where(i[:, 2] < 0, INDEX, 1.0)
    return np.asarray(value.x, np.float64) / np.abs(o[:, 2]) / index**2
