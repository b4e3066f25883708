"""Light that met another surface before the one seen.

`indirect` wraps an integrator: the camera ray's first surface scatters it once, and what the wrapped
integrator sees from there, but for the lights themselves, is what arrives by other surfaces.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

PLUGIN = "indirect"


def indirect(integrator: dict) -> dict:
    """Mitsuba's dictionary of the wrapped integrator, in the current variant. Lights that it meets first are
    not counted: it must know `hide_emitters`."""
    _declare(mi.variant())
    return {"type": PLUGIN, "nested": {**integrator, "hide_emitters": True}}


_declared: set[str] = set()


def _declare(variant: str) -> None:
    if variant in _declared:
        return
    _declared.add(variant)

    ray_type, context, spectrum = mi.RayDifferential3f, mi.BSDFContext(), mi.Spectrum

    class Indirect(mi.SamplingIntegrator):
        def __init__(self, props: mi.Properties) -> None:
            super().__init__(props)
            self.nested = props["nested"]

        def sample(self, scene, sampler, ray, medium=None, active=True):
            hit = scene.ray_intersect(ray, active)
            met = active & hit.is_valid()
            drawn, weight = hit.bsdf(ray).sample(
                context, hit, sampler.next_1d(met), sampler.next_2d(met), met
            )
            on = ray_type(hit.spawn_ray(hit.to_world(drawn.wo)))
            met &= dr.any(weight != 0)
            found, _, _ = self.nested.sample(scene, sampler, on, None, met)
            return dr.select(met, weight * found, spectrum(0)), hit.is_valid(), []

    mi.register_integrator(PLUGIN, Indirect)
