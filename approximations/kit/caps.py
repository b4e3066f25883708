r"""Spherical caps: areas, overlaps and vector irradiance.

A cap has a unit axis a_i and an angular radius r_i (rad); d is the angle between two axes. Source:
SIGGRAPH 2006 Course 26, sections 8.4.1 and 8.4.2. The closed forms work for any float type; small
lights need float64, since the area is a difference of terms near 1 (in float32 the root mean square
error is about one area of the sun's disk, and ten times that where the penumbra ends).
"""

from __future__ import annotations

from typing import Any

import drjit as dr


def cap_area(r: Any) -> Any:
    """Solid angle 2 pi (1 - cos r), sr, in a form that keeps its digits for small r."""
    return 4 * dr.pi * dr.square(dr.sin(0.5 * r))


def cap_radius(area: Any) -> Any:
    """Radius (rad) of the cap of that solid angle: acos(1 - A / 2 pi)."""
    return dr.safe_acos(1 - area / (2 * dr.pi))


def _edge_angles(r0: Any, r1: Any, d: Any) -> tuple[Any, Any, Any]:
    """Half angles f0, f1 of the lens's arcs about each axis, and the angle g between the radii at a
    corner; arguments clamped to where an arc cosine exists."""
    s0, s1, sd = dr.sin(r0), dr.sin(r1), dr.sin(d)
    c0, c1, cd = dr.cos(r0), dr.cos(r1), dr.cos(d)
    f0 = dr.safe_acos((c1 - cd * c0) / (sd * s0))
    f1 = dr.safe_acos((c0 - cd * c1) / (sd * s1))
    g = dr.safe_acos((c0 * c1 - cd) / (s0 * s1))
    return f0, f1, g


def _contained_or_disjoint(r0: Any, r1: Any, d: Any, lens: Any) -> Any:
    """The smaller cap's area where it lies inside the other, 0 where they do not meet, else the lens."""
    whole = cap_area(dr.minimum(r0, r1))
    return dr.select(d <= dr.abs(r0 - r1), whole, dr.select(d >= r0 + r1, 0, lens))


def lens_area(r0: Any, r1: Any, d: Any) -> Any:
    """Solid angle (sr) that two caps share: 2 g - 2 f0 cos r0 - 2 f1 cos r1."""
    f0, f1, g = _edge_angles(r0, r1, d)
    return _contained_or_disjoint(r0, r1, d, 2 * g - 2 * f0 * dr.cos(r0) - 2 * f1 * dr.cos(r1))


def lens_area_printed(r0: Any, r1: Any, d: Any) -> Any:
    """The lens as printed in 8.4.1, with the wrong sign of its third term: it can be negative."""
    c0, c1, cd = dr.cos(r0), dr.cos(r1), dr.cos(d)
    s0, s1, sd = dr.sin(r0), dr.sin(r1), dr.sin(d)
    lens = (
        2 * c1 * dr.safe_acos((-c0 + cd * c1) / (sd * s1))
        - 2 * c0 * dr.safe_acos((c1 - cd * c0) / (sd * s0))
        - 2 * dr.safe_acos((-cd + c0 * c1) / (s0 * s1))
        - 2 * dr.pi * c1
    )
    return _contained_or_disjoint(r0, r1, d, lens)


def smoothstep_area(r0: Any, r1: Any, d: Any) -> Any:
    """The lens's area as a cubic (8.4.2): smaller cap times x^2 (3 - 2 x), x falling from 1 where the
    smaller lies inside to 0 where they part."""
    apart = dr.abs(r0 - r1)
    x = 1 - dr.clip((d - apart) / dr.maximum(r0 + r1 - apart, 1e-12), 0, 1)
    return cap_area(dr.minimum(r0, r1)) * x * x * (3 - 2 * x)


def lens_irradiance(a0: Any, r0: Any, a1: Any, r1: Any, d: Any) -> Any:
    """Vector irradiance Phi = int w dw over what two caps share; |Phi| is at most its area.

    Phi = sum_i [f_i sin(r_i)^2 a_i - sin(r_i) cos(r_i) sin(f_i) u_i], u_i the unit tangent at a_i
    towards the other axis. A whole cap gives pi sin(r)^2 a.
    """
    f0, f1, _ = _edge_angles(r0, r1, d)
    s0, c0, s1, c1 = dr.sin(r0), dr.cos(r0), dr.sin(r1), dr.cos(r1)
    sd, cd = dr.maximum(dr.sin(d), 1e-12), dr.cos(d)
    u0, u1 = (a1 - cd * a0) / sd, (a0 - cd * a1) / sd
    lens = f0 * s0 * s0 * a0 - s0 * c0 * dr.sin(f0) * u0 + f1 * s1 * s1 * a1 - s1 * c1 * dr.sin(f1) * u1
    smaller = dr.select(r0 < r1, dr.pi * s0 * s0 * a0, dr.pi * s1 * s1 * a1)
    return dr.select(d <= dr.abs(r0 - r1), smaller, dr.select(d >= r0 + r1, 0, lens))
