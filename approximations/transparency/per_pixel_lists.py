r"""Per-pixel lists: every fragment is kept in one pass over the geometry, and sorted where it is shown.

GPU Pro 5, chapter I.1: the A-buffer frame, its unsorted builder (POST-LIN) and the sort in local memory
(POST-SORT).

    key      floor(S (1 - z) / 2), S = 2^32 - 1 or 2^24 - 1: bigger is nearer               (1.1)
    CLEAR    no list has an entry, no cell is taken
    BUILD    fresh = increment(counter);  cell[fresh] = (key, data);
             next(fresh) = exchange(head[x + y W], fresh)                                  (1.2.1)
    packed   the W H heads and the cells are one buffer of (key << 32) | next; a head holds
             the key and the number of the newest fragment, each cell those of the one after
             it, and data lie apart, at cell number - W H                                  (1.2.2)
    RENDER   copy a list to a local array, sort it by decreasing key, and composite
             C = sum_i a_i c_i prod_{j<i} (1 - a_j) + C_background prod_j (1 - a_j)         (1.1.2)

In print, and what was done here:
- The unpacked listing starts its counter at 0 and does not show how heads are cleared. With 0 as the end of
  a list, as in the packed layout, the first fragment of the frame would be lost; here lists of that layout
  end in 2^32 - 1. One fragment of a frame is too little for an option.
- With S = 2^32 - 1 the product passes the 24 bits of a float32 and its S rounds to 2^32. Keys are computed
  in float32 as a shader would: z below 0 loses its last bit, and z = -1 is kept in range by a clamp.
- Atomics of fragments in flight come in any order on a GPU. Draw calls are inserted one after another
  here, so that ties and overflow, which go by the order of the list, are the same in every run.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import CAPACITY, NUMBER_FORMAT, Domain, Sweep, exact_when, technique
from approximations.kit.draw_calls import Draw, draw_calls
from scenes.contract import RADIANCE, View
from scenes.glass import GlassSheets

S = {"24": 0xFFFFFF, "32": 0xFFFFFFFF, "exact": 0xFFFFFFFF}
LARGEST_FLOAT_KEY = 0xFFFFFF00  # the largest float32 below 2^32


@technique(
    source="GPU Pro 5, ch. I.1, 1.1 to 1.2.2 and 1.4.1",
    covers=("a-buffer/01", "a-buffer/02", "a-buffer/08"),
    estimates=RADIANCE,
    on=(GlassSheets,),
    replaces="compositing of all layers in the order of depth",
    neglects=(NUMBER_FORMAT, CAPACITY),
    claims=(exact_when("GlassSheets", 1e-5, knobs={"depth_bits": "exact", "data": "exact"}),),
    stress={"GlassSheets": ("sheets", "alpha", "spacing", "near", "brightness")},
)
def per_pixel_lists(
    view: View,
    *,
    depth_bits: Literal["24", "32", "exact"] = "32",
    data: Literal["rgba8", "exact"] = "rgba8",
    layout: Literal["plain", "packed"] = "packed",
    capacity: Annotated[int, Sweep(4, 8, 16, 64, 256, low=1, high=256)] = 64,
    sort: Literal["bubble", "insertion"] = "bubble",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    depth_bits  bits of the depth key; "exact" sorts by the distance in float64 kept beside the data.
    data        colour and opacity in 8 bits each, clamped to [0, 1] and linear, or "exact": in float32.
    layout      heads, keys and links in arrays of their own (8 B a cell), or "packed" in one (8 B an entry).
    capacity    fragments a pixel's local array holds. What comes later in the list, drawn earlier, is
                dropped wherever it lies in depth.
    sort        kind of the local sort: same image, other cost. Equal keys stay newest first.
    """
    pixels, fragments = view.width * view.height, view.fragments
    lists = clear(pixels, dr.width(fragments.pixel), depth_bits, data, layout)
    for draw in draw_calls(fragments):
        insert(lists, draw, depth_bits)
    key, slot, count = local_copy(lists, dr.arange(mi.UInt32, pixels), capacity)
    key, slot = SORTS[sort](key, slot, count)
    return composite(lists, slot, count, fragments.background)


@per_pixel_lists.domain
def domain(scene: GlassSheets) -> Domain:
    """Moderate depth complexity (1.1.3), colours that RGBA8 holds, layers that the depth key tells apart."""
    if scene.brightness > 1:
        return Domain(False, "8 bits a channel hold no radiance above 1")
    if scene.brightness < 0.1:
        return Domain(False, "8 bits a channel leave a dark picture few levels")
    farthest = max(sheet.centre[1] for sheet in scene.layers())
    if scene.spacing < farthest**2 / (scene.near * 2**23):
        return Domain(False, "neighbouring sheets stand closer than float32 NDC depth can tell apart")
    return Domain(True)


# CLEAR and BUILD -----------------------------------------------------------------------------------------


@dataclass
class Plain:
    """Heads, keys and links in arrays of their own; the number of a cell is its slot."""

    head: mi.UInt32  # per pixel
    key: mi.UInt32  # per cell, as is next
    next: mi.UInt32
    counter: mi.UInt32

    END = 0xFFFFFFFF

    @staticmethod
    def clear(pixels: int, cells: int) -> Plain:
        """No list has an entry."""
        return Plain(
            dr.full(mi.UInt32, Plain.END, pixels),
            dr.empty(mi.UInt32, cells),
            dr.empty(mi.UInt32, cells),
            dr.zeros(mi.UInt32, 1),
        )

    def insert(self, pixel: mi.UInt32, key: mi.UInt32) -> mi.UInt32:
        """A fresh cell at the head of the pixel's list; its slot (1.2.1)."""
        fresh = dr.scatter_inc(self.counter, dr.zeros(mi.UInt32, dr.width(pixel)))
        dr.scatter(self.key, key, fresh)
        dr.scatter(self.next, dr.scatter_exch(self.head, fresh, pixel), fresh)
        return fresh

    def first(self, pixel: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
        """Key and cell of the newest fragment."""
        return self._with_key(dr.gather(mi.UInt32, self.head, pixel))

    def after(self, cell: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
        """Key and cell of the fragment that came before the one in `cell`."""
        return self._with_key(dr.gather(mi.UInt32, self.next, cell))

    def slot(self, cell: mi.UInt32) -> mi.UInt32:
        """Where the data of a cell lie."""
        return cell

    def _with_key(self, cell: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
        return dr.gather(mi.UInt32, self.key, cell, cell != self.END), cell


@dataclass
class Packed:
    """Heads and cells in one buffer of (key << 32) | next, so that one exchange moves both."""

    main: mi.UInt64  # W H heads, then the cells
    counter: mi.UInt32
    pixels: int

    END = 0

    @staticmethod
    def clear(pixels: int, cells: int) -> Packed:
        """No list has an entry; the first fresh cell comes after the heads."""
        return Packed(dr.zeros(mi.UInt64, pixels + cells), dr.full(mi.UInt32, pixels, 1), pixels)

    def insert(self, pixel: mi.UInt32, key: mi.UInt32) -> mi.UInt32:
        """A fresh cell at the head of the pixel's list; its slot (1.2.2)."""
        fresh = dr.scatter_inc(self.counter, dr.zeros(mi.UInt32, dr.width(pixel)))
        record = (mi.UInt64(key) << 32) | mi.UInt64(fresh)
        newest = dr.scatter_exch(self.main, record, pixel)
        dr.eval(fresh, newest)
        dr.scatter(self.main, newest, fresh)
        return self.slot(fresh)

    def first(self, pixel: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
        """Key and cell of the newest fragment."""
        record = dr.gather(mi.UInt64, self.main, pixel)
        return mi.UInt32(record >> 32), mi.UInt32(record)

    def after(self, cell: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
        """Key and cell of the fragment that came before the one in `cell`."""
        return self.first(cell)

    def slot(self, cell: mi.UInt32) -> mi.UInt32:
        """Where the data of a cell lie."""
        return cell - self.pixels


LAYOUTS = {"plain": Plain, "packed": Packed}


@dataclass
class Lists:
    """The lists and what their cells carry: RGBA8 words or float32 vectors, and the distance (m) where
    the sort is exact."""

    links: Plain | Packed
    data: mi.UInt32 | mi.Vector4f
    distance: mi.Float64 | None


def clear(pixels: int, cells: int, depth_bits: str, data: str, layout: str) -> Lists:
    """CLEAR: empty lists with room for `cells` fragments."""
    return Lists(
        LAYOUTS[layout].clear(pixels, cells),
        dr.empty(mi.Vector4f if data == "exact" else mi.UInt32, cells),
        dr.empty(mi.Float64, cells) if depth_bits == "exact" else None,
    )


def insert(lists: Lists, draw: Draw, depth_bits: str) -> None:
    """BUILD: a draw call's fragments become the heads of their lists."""
    slot = lists.links.insert(draw.pixel, depth_key(draw.depth, depth_bits))
    rgba = mi.Vector4f(draw.colour.x, draw.colour.y, draw.colour.z, draw.alpha)
    dr.scatter(lists.data, rgba if dr.is_vector_v(lists.data) else pack_rgba8(rgba), slot)
    if lists.distance is not None:
        dr.scatter(lists.distance, draw.distance, slot)
    dr.eval(lists)


def depth_key(z: mi.Float, depth_bits: str) -> mi.UInt32:
    """floor(S (1 - z) / 2): the bigger the nearer."""
    return mi.UInt32(dr.minimum(S[depth_bits] * (1 - z) / 2, LARGEST_FLOAT_KEY))


def pack_rgba8(rgba: mi.Vector4f) -> mi.UInt32:
    """8 bits a channel, red lowest."""
    r, g, b, a = (mi.UInt32(dr.round(255 * dr.clip(x, 0, 1))) for x in rgba)
    return r | g << 8 | b << 16 | a << 24


def unpack_rgba8(word: mi.UInt32) -> mi.Vector4f:
    """The four channels in [0, 1]."""
    return mi.Vector4f(*(mi.Float(word >> shift & 0xFF) / 255 for shift in (0, 8, 16, 24)))


# RENDER --------------------------------------------------------------------------------------------------


@dr.syntax
def local_copy(lists: Lists, pixel: mi.UInt32, capacity: int) -> tuple[dr.Local, dr.Local, mi.UInt32]:
    """Keys and slots of each pixel's list, newest first, in local arrays; and how many they are."""
    keys = dr.alloc_local(mi.UInt32 if lists.distance is None else mi.Float64, capacity)
    slots = dr.alloc_local(mi.UInt32, capacity)
    count = dr.zeros(mi.UInt32, dr.width(pixel))
    key, cell = lists.links.first(pixel)
    while (cell != lists.links.END) & (count < capacity):
        slot = lists.links.slot(cell)
        keys[count] = key if lists.distance is None else -dr.gather(mi.Float64, lists.distance, slot)
        slots[count] = slot
        key, cell = lists.links.after(cell)
        count += 1
    return keys, slots, count


@dr.syntax
def bubble_sort(keys: dr.Local, slots: dr.Local, count: mi.UInt32) -> tuple[dr.Local, dr.Local]:
    """Decreasing keys, by swaps of neighbours: n (n - 1) / 2 comparisons whatever the order."""
    end = mi.UInt32(count)
    while end > 1:
        j = mi.UInt32(1)
        while j < end:
            i = j - 1
            left, right = keys[i], keys[j]
            if left < right:
                keys[i], keys[j] = right, left
                left_slot, right_slot = slots[i], slots[j]
                slots[i], slots[j] = right_slot, left_slot
            j += 1
        end -= 1
    return keys, slots


@dr.syntax
def insertion_sort(keys: dr.Local, slots: dr.Local, count: mi.UInt32) -> tuple[dr.Local, dr.Local]:
    """Decreasing keys, each entry moved up to its place: n - 1 comparisons for a sorted list."""
    j = mi.UInt32(1)
    while j < count:
        key, slot = keys[j], slots[j]
        free, before = mi.UInt32(j), keys[j - 1]
        while (free > 0) & (before < key):
            keys[free] = before
            slots[free] = slots[free - 1]
            free -= 1
            before = keys.read(free - 1, free > 0)
        keys[free] = key
        slots[free] = slot
        j += 1
    return keys, slots


SORTS = {"bubble": bubble_sort, "insertion": insertion_sort}


@dr.syntax
def composite(lists: Lists, slots: dr.Local, count: mi.UInt32, background: mi.Color3f) -> mi.Color3f:
    """C = sum_i a_i c_i T_i + C_background T, T_i = prod_{j<i} (1 - a_j), in the order of the slots."""
    colour, transmittance = dr.zeros(mi.Color3f, dr.width(count)), mi.Float(1)
    i = mi.UInt32(0)
    while i < count:
        word = dr.gather(type(lists.data), lists.data, slots[i])
        rgba = word if dr.is_vector_v(lists.data) else unpack_rgba8(word)
        colour += transmittance * rgba.w * mi.Color3f(rgba.x, rgba.y, rgba.z)
        transmittance *= 1 - rgba.w
        i += 1
    return colour + transmittance * background
