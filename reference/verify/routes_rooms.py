"""Irradiance along the track in two rooms: our sampler against Mitsuba's irradiance meter.

The meter is a rectangle so small that it hides nothing worth counting, with its front towards the normal.
"""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from reference.render import to_array
from reference.room_irradiance import irradiance
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import name, seeds
from scenes.contract import IRRADIANCE
from scenes.rooms import IrradianceTrack

SIDE = 4  # probes along position and normal
HALF = 2e-4  # m, half an edge of the meter
SAMPLES = 4096


@check(
    "route",
    claim="irradiance in mid-air is what a small meter there reads",
    routes=("own Monte Carlo", "Mitsuba's irradiancemeter with its path tracer"),
    scenes=("IrradianceTrack",),
)
def irradiance_meters(seed: int) -> Comparison:
    """All probes of a 4 x 4 view, one batch of SAMPLES each for every seed."""
    scene = IrradianceTrack()
    ours = Sampled.of([irradiance(scene, SIDE, 1024, s) for s in seeds(seed, 0)])
    return Comparison(name(scene, IRRADIANCE), ours, Sampled.of(list(_meters(scene, seeds(seed, 1)))))


def _meters(scene: IrradianceTrack, drawn: tuple[int, ...]) -> np.ndarray:
    """What meters at the probes read, (len(drawn), SIDE, SIDE, 3)."""
    probes, path = scene.probes(SIDE).surface, mi.load_dict({"type": "path"})
    film = {"type": "hdrfilm", "width": 1, "height": 1, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    found = []
    for p, n in zip(np.array(probes.position).T, np.array(probes.normal).T, strict=True):
        up = [1, 0, 0] if abs(n[0]) < 0.9 else [0, 1, 0]
        frame = mi.ScalarTransform4f().look_at(p.tolist(), (p + n).tolist(), up).scale(HALF)
        meter = {"type": "rectangle", "to_world": frame, "sensor": {"type": "irradiancemeter", "film": film}}
        world = mi.load_dict({**scene.world(), "meter": meter}, optimize=False)
        found.append([to_array(mi.render(world, integrator=path, spp=SAMPLES, seed=s)) for s in drawn])
    return np.array(found).reshape(SIDE, SIDE, len(drawn), 3).transpose(2, 0, 1, 3)
