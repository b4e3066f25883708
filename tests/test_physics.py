"""Laws of light and printed numbers: they hold, and seeded faults in the renders are caught."""

import functools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from reference.transport import Transport
from reference.verify import energy, form_factors, light_laws, published, reciprocity, rendered, slabs
from reference.verify.checks import CHECKS
from reference.verify.run import rows_of_check
from scenes.mitsuba_parts import diffuse

MODULES = (energy, reciprocity, light_laws, form_factors, slabs, published)
MINE = [name for name, c in CHECKS.items() if c.function.__module__ in {m.__name__ for m in MODULES}]
EACH = 0.01 / 40
CATCHES = {
    "furnace_of_surfaces": 0.01,
    "furnace_of_interreflection": 0.01,
    "furnace_of_media": 0.01,
    "radiance_through_glass": 0.001,
    "inverse_square_and_cosine": 0.001,
    "beer_in_homogeneous_media": 0.005,
    "beer_in_grids": 0.005,
    "form_factors_of_elements": 0.002,
}
"""The relative error of the energy that each of these finds with probability 95 %."""

CRUDE = (
    "furnace_of_surfaces",
    "furnace_of_media",
    "reciprocity_of_transport",
    "diffusion_limit",
    "similarity",
    "beer_in_homogeneous_media",
    "beer_in_grids",
)
"""A few batches are enough for the faults that are seeded there."""


class WrongCosine(mi.BSDF):
    """A diffuse surface that lets light in without its cosine."""

    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        self.m_components = [mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide]
        self.m_flags = self.m_components[0]
        self.albedo = float(props["reflectance"][0])

    def sample(self, ctx, si, sample1, sample2, active=True):
        sample = dr.zeros(mi.BSDFSample3f)
        sample.wo = mi.warp.square_to_cosine_hemisphere(sample2)
        sample.pdf = self.pdf(ctx, si, sample.wo, active)
        sample.eta = mi.Float(1)
        sample.sampled_type = mi.UInt32(+mi.BSDFFlags.DiffuseReflection)
        sample.sampled_component = mi.UInt32(0)
        weight = self.eval(ctx, si, sample.wo, active) / sample.pdf
        return sample, dr.select(sample.pdf > 0, weight, 0)

    def eval(self, ctx, si, wo, active=True):
        lit = active & (si.wi.z > 0) & (wo.z > 0)
        return dr.select(lit, mi.Color3f(self.albedo / np.pi), 0)

    def pdf(self, ctx, si, wo, active=True):
        lit = active & (si.wi.z > 0) & (wo.z > 0)
        return dr.select(lit, mi.warp.square_to_cosine_hemisphere_pdf(wo), 0)

    def eval_pdf(self, ctx, si, wo, active=True):
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)


mi.register_bsdf("wrong_cosine", WrongCosine)


def altered(part, change):
    """A scene dictionary with every dictionary in it changed."""
    if not isinstance(part, dict):
        return part
    return change({k: altered(v, change) for k, v in part.items()})


def replaced(key, old, new):
    """change() that gives a key another value where it has the old one."""
    return lambda part: {**part, key: new} if part.get(key) == old else part


def scaled(key, factor):
    """change() that multiplies a number."""
    return lambda part: {**part, key: factor * part[key]} if isinstance(part.get(key), float) else part


def reflecting(old, new):
    """change() that gives diffuse surfaces of one albedo another."""
    return lambda part: diffuse(new) if part == diffuse(old) else part


def without_cosine(part):
    return {**part, "type": "wrong_cosine"} if part.get("type") == "diffuse" else part


def half_a_pixel_aside(part):
    if part.get("type") != "orthographic":
        return part
    size = part["film"]["width"]
    aside = mi.ScalarTransform4f().translate([1 / size, 0, 0])
    return {**part, "to_world": mi.ScalarTransform4f(part["to_world"].matrix) @ aside}


def half_a_voxel_aside(part):
    if part.get("type") != "gridvolume":
        return part
    aside = mi.ScalarTransform4f().translate([0.5 / light_laws.VOXELS, 0, 0])
    return {**part, "to_world": mi.ScalarTransform4f(part["to_world"].matrix) @ aside}


def verdicts(name, seed=1):
    rows = rows_of_check(CHECKS[name], seed, EACH)
    for r in rows:
        print(f"{name}: {r['truth']}: {r['verdict']}, p {r['p']:.2g}, catches {r['catches']:.2g}")
    return rows


@pytest.mark.parametrize("name", MINE)
def test_it_holds(name):
    rows = verdicts(name)
    assert [r["truth"] for r in rows if r["verdict"] != "agrees"] == []
    assert max(r["catches"] for r in rows) <= CATCHES.get(name, np.inf)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("furnace_of_surfaces", reflecting(1.0, 0.99)),
        ("furnace_of_interreflection", reflecting(0.9, 0.899)),
        ("furnace_of_media", replaced("albedo", 1.0, 0.99)),
        ("radiance_through_glass", replaced("int_ior", 1.5, 1.501)),
        ("reciprocity_of_transport", without_cosine),
        ("inverse_square_and_cosine", without_cosine),
        ("inverse_square_and_cosine", half_a_pixel_aside),
        ("limit_of_small_lights", scaled("radius", 1.005)),
        ("beer_in_homogeneous_media", scaled("sigma_t", 1.01)),
        ("beer_in_grids", half_a_voxel_aside),
        ("form_factors_of_elements", without_cosine),
        ("form_factors_of_elements", half_a_pixel_aside),
        ("diffusion_limit", replaced("albedo", 1.0, 0.99)),
        ("similarity", replaced("g", 0.5, -0.5)),
        ("configuration_factors", replaced("value", 1.0, 0.985)),
    ],
)
def test_a_fault_in_the_render_is_caught(monkeypatch, name, change):
    load, render = rendered.load, rendered.rendered
    if name in CRUDE:
        monkeypatch.setattr(rendered, "rendered", lambda d, size, batches, seed: render(d, size, 8, seed))
    monkeypatch.setattr(rendered, "load", lambda d, size, how: load(altered(d, change), size, how))
    assert "differs" in {r["verdict"] for r in verdicts(name)}


def test_paths_cut_short_are_caught(monkeypatch):
    short = Transport({"type": "path", "max_depth": 40}, "multijitter", 256)
    monkeypatch.setattr(rendered, "transport", lambda *_: short)
    assert "differs" in {r["verdict"] for r in verdicts("furnace_of_interreflection")}


def test_a_bsdf_that_is_not_reciprocal_is_caught(monkeypatch):
    monkeypatch.setattr(reciprocity, "diffuse", lambda albedo: {**diffuse(albedo), "type": "wrong_cosine"})
    assert verdicts("reciprocity_of_bsdfs")[0]["verdict"] == "differs"


@pytest.mark.parametrize(
    ("name", "table", "key", "misprint"),
    [
        ("heaslet_warming", published.HEASLET_WARMING, 3.0, 0.3061),
        ("chandrasekhar_h", published.H_FUNCTION, 0.5, 2.01287),
        ("absorbing_slabs", published.VAN_DE_HULST, "transmittance", 0.69066),
        ("configuration_factors", published.HOWELL, "parallel squares", 0.1989),
    ],
)
def test_a_misprint_is_caught(monkeypatch, name, table, key, misprint):
    monkeypatch.setattr(published, "BATCHES", 8)
    monkeypatch.setattr(slabs, "BATCHES", 4)
    monkeypatch.setitem(table, key, misprint)
    assert "differs" in {r["verdict"] for r in verdicts(name)}


def gauss(n=64):
    nodes, weights = np.polynomial.legendre.leggauss(n)
    return nodes, weights / 2


def test_area_factors_are_means_of_those_of_elements():
    nodes, weights = gauss()
    x, y = np.meshgrid(nodes, nodes)
    area = np.outer(weights, weights)
    above = np.array([(1, 1, 2), (-1, 1, 2), (-1, -1, 2), (1, -1, 2)], float)
    wall = np.array([(1, -1, 0), (1, 1, 0), (1, 1, 2), (1, -1, 2)], float)
    polygon = form_factors.to_polygon
    assert (area * polygon(x, y, above)).sum() == pytest.approx(form_factors.parallel_squares(1.0), 1e-9)
    assert (area * polygon(x, y, wall)).sum() == pytest.approx(form_factors.perpendicular_squares(), 1e-3)
    r, ratio = 0.5 * (nodes + 1) * form_factors.RADIUS, form_factors.RADIUS / form_factors.AT[2]
    ring = 2 * weights * r / form_factors.RADIUS
    disk = form_factors.to_disk(form_factors.AT[0] + r, np.full_like(r, form_factors.AT[1]))
    assert (ring * disk).sum() == pytest.approx(form_factors.coaxial_disks(ratio), 1e-9)


@functools.cache
def discrete_ordinates(tau, albedo, g, beam):
    """Reflectance and transmittance of a slab by PythonicDISORT, for a beam straight down or a sky."""
    from PythonicDISORT.pydisort import pydisort

    n = 64
    light = (1 - 1e-9, 1.0, 0) if beam else (0.5, 0, 0)
    more = {} if beam else {"b_neg": 1.0}
    _, up, down, *_ = pydisort(
        np.array([tau]),
        np.array([albedo]),
        n,
        g ** np.arange(n + 1)[None],
        *light,
        NLeg=n,
        only_flux=True,
        **more,
    )
    unit = 1.0 if beam else np.pi
    return float(up(0)) / unit, float(np.sum(down(tau))) / unit


@pytest.mark.filterwarnings("ignore:Some delta-scaled")
@pytest.mark.parametrize(("tau", "g"), [(5.0, 0.0), (8.0, 0.0), (8.0, 0.5), (4 / 0.15, 0.85)])
def test_diffusion_theory_is_as_close_as_it_says(tau, g):
    reduced = (1 - g) * tau
    apart = discrete_ordinates(tau, 1 - 1e-9, g, False)[1] - slabs.diffuse_transmittance(reduced)
    assert abs(apart) < slabs.spread_of_theory(reduced)


@pytest.mark.filterwarnings("ignore:Some delta-scaled")
def test_printed_slabs_are_those_of_discrete_ordinates():
    for tau in (0.5, 2.0):
        found = discrete_ordinates(tau, 1 - 1e-9, 0.0, False)[1]
        assert published.milne_transmittance(tau) == pytest.approx(found, abs=1e-4)
    expected = list(published.VAN_DE_HULST.values())
    assert discrete_ordinates(2.0, 0.9, 0.75, True) == pytest.approx(expected, abs=1e-5)


def test_quadratures_have_converged():
    assert published.milne_transmittance(3.0, 400) == pytest.approx(
        published.milne_transmittance(3.0), abs=1e-5
    )
    for index in (None, energy.INDEX):
        kept = energy.kept_by_one_scattering(0.1, index)
        for cosine in (0.13, 0.42, 0.97):
            fine = energy._kept(cosine, 0.1, index, 512)
            assert float(kept(cosine)) == pytest.approx(fine, abs=energy.QUADRATURE)
