"""The hairstyles of the database that are grown: a starter style, changed numbers, and steps of `hairstyle_shapes`.

A family is what is alike in shape: variants of one starter groom, or one way of cutting or tying. A test on a groom
leaves its family out of the search.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from growth import Style
from hairstyle_shapes import (
    Region,
    Step,
    Tie,
    above,
    below,
    blow,
    both,
    brow,
    cut,
    drape,
    everywhere,
    flip,
    keep,
    outside,
    puff,
    side,
    strip,
    sweep,
    tie,
    trim,
)  # fmt: skip
from styles import STYLES

HEIGHTS = {"chin": -1.25, "collar": -1.75, "shoulder": -2.2, "chest": -3.0, "back": -3.9, "waist": -5.2}


@dataclass(frozen=True, slots=True)
class Recipe:
    """How one hairstyle is grown.

    n_points : that the database keeps of a strand. n_strands : grown over the whole scalp, some of which `keep` drops.
    """

    name: str
    tags: tuple[str, ...]
    family: str
    style: Style
    steps: tuple[Step, ...] = ()
    n_points: int = 14
    seed: int = 0
    n_strands: int = 1400


def hanging(base: str, to: str, **changes: float) -> Style:
    """A starter style that hangs down to a height of HEIGHTS."""
    height = HEIGHTS[to]
    style = STYLES[base]
    return replace(style, cut_height=height, length=2.1 - height * 1.05, **changes)  # type: ignore[arg-type]


PARTS = {"middle": 0.0, "left": 0.32, "right": -0.32}


def parted_lengths() -> Iterator[Recipe]:
    """Long hair hanging down: straight, wavy, curly and tangled, by length and parting."""
    plan: dict[str, tuple[tuple[str, ...], int]] = {
        "straight": (("collar", "shoulder", "chest", "back", "waist"), 12),
        "wavy": (("collar", "shoulder", "chest", "back", "waist"), 16),
        "curly": (("chin", "collar", "shoulder", "chest", "back"), 20),
        "tangled": (("chin", "shoulder", "back"), 16),
    }
    for base, (lengths, n_points) in plan.items():
        for index, to in enumerate(lengths):
            parts = list(PARTS) if index % 2 == 0 else list(PARTS)[: 1 + index % 3]
            for part in parts:
                tags = (base, to, f"{part} parting", "long" if HEIGHTS[to] < -2 else "medium")
                style = hanging(base, to, part=PARTS[part])
                yield Recipe(f"{base} to the {to}, {part} parting", tags, base, style, (), n_points, index)


def volumes() -> Iterator[Recipe]:
    """The same with more or less volume, without a parting, layered."""
    for base, n_points in (("straight", 12), ("wavy", 16), ("curly", 20)):
        flat = hanging(base, "chest", thickness=0.06, root_lift=0.3)
        yield Recipe(f"{base}, flat", (base, "long", "flat"), base, flat, (), n_points)
        full = hanging(base, "shoulder", thickness=0.4, root_lift=1.4, wander=16.0)
        yield Recipe(f"{base}, full", (base, "long", "volume"), base, full, (puff(0.3),), n_points)
        huge = hanging(base, "chest", thickness=0.5, root_lift=1.8, wander=20.0)
        yield Recipe(f"{base}, very full", (base, "long", "volume"), base, huge, (puff(0.38),), n_points)
        back = hanging(base, "shoulder", sweep_back=2.6, root_lift=0.9, part_front=60.0)
        yield Recipe(f"{base}, swept back", (base, "long", "swept back"), base, back, (), n_points)
        back = hanging(base, "back", sweep_back=2.6, root_lift=0.6, part_front=70.0, thickness=0.1)
        yield Recipe(f"{base}, swept back to the waist", (base, "long", "swept back"), base, back, (), n_points)
        layered = (trim(0.55, above(0.5), 0.2), trim(0.8, both(above(0.0), below(0.5)), 0.15))
        yield Recipe(f"{base}, layered", (base, "long", "layers"), base, hanging(base, "chest"), layered, n_points)
        feathered = (trim(0.42, above(0.35), 0.15), flip(0.35, 0.8), puff(0.12))
        made = hanging(base, "shoulder", root_lift=1.3)
        yield Recipe(f"{base}, feathered", (base, "medium", "layers", "flicked"), base, made, feathered, n_points)


def fringes() -> Iterator[Recipe]:
    """Bangs: cut straight, short, long, swept to a side, parted like curtains."""
    for base, to, n_points in (("straight", "shoulder", 12), ("straight", "back", 12), ("wavy", "shoulder", 16),
                               ("wavy", "chest", 16), ("curly", "shoulder", 20)):  # fmt: skip
        family, tags = f"{base} fringe", (base, to, "fringe", "bangs")
        name = f"{base} to the {to}"
        yield Recipe(f"{name}, fringe", tags, family, hanging(base, to, fringe_height=0.1), (), n_points)
        short = hanging(base, to, fringe_height=0.42)
        yield Recipe(f"{name}, short fringe", (*tags, "short fringe"), family, short, (), n_points)
        for sign, word in ((1.0, "left"), (-1.0, "right")):
            style = hanging(base, to, fringe_height=-0.12, part=-0.3 * sign)
            steps = (trim(1.0, brow(0.8), longest=1.25), sweep(38.0 * sign, brow(0.7), 0.1, 0.8))
            yield Recipe(f"{name}, bangs to the {word}", (*tags, "side bangs"), family, style, steps, n_points, 3)
        curtain = (trim(0.42, brow(0.55, 0.3), 0.08), flip(0.12, 0.5))
        style = hanging(base, to, root_lift=1.1)
        yield Recipe(f"{name}, curtain bangs", (*tags, "curtain bangs"), family, style, curtain, n_points)


def bobs() -> Iterator[Recipe]:
    """Bobs: straight, A-line, inverted, asymmetric, long, round, with and without a fringe; bowls."""
    base = STYLES["bob"]
    bare = replace(base, fringe_height=None)
    for name, height in (("ear", -0.55), ("jaw", -0.95), ("chin", -1.25), ("neck", -1.55)):
        length = 2.1 - height * 1.05
        straight = replace(base, cut_height=height, length=length)
        yield Recipe(f"bob to the {name}, fringe", ("bob", "short", "fringe"), "bob", straight, (), 12)
        for part in ("middle", "left", "right") if height > -1.3 else ("middle", "right"):
            style = replace(bare, cut_height=height, length=length, part=PARTS[part])
            yield Recipe(
                f"bob to the {name}, {part} parting", ("bob", "short", f"{part} parting"), "bob", style, (), 12
            )
    wavy = replace(bare, coarse_wave=0.1, coarse_pitch=0.7, part=0.3, thickness=0.24, cut_height=-1.3, length=3.2)
    yield Recipe("wavy bob", ("bob", "wavy", "short"), "bob", wavy, (), 16)
    curly = replace(bare, curl=0.08, curl_pitch=0.35, part=-0.3, thickness=0.3, cut_height=-1.1, length=3.0)
    yield Recipe("curly bob", ("bob", "curly", "short"), "bob", curly, (puff(0.15),), 20)
    tousled = replace(bare, wander=18.0, thickness=0.3, frizz=0.03, flyaways=0.05, cut_height=-1.2, length=3.2)
    yield Recipe("tousled bob", ("bob", "messy", "short"), "bob", tousled, (puff(0.12),), 14)
    round_bob = replace(base, thickness=0.34, bend_under=3.5, cut_height=-0.95, length=3.1)
    yield Recipe("round bob", ("bob", "round", "fringe"), "bob", round_bob, (puff(0.1),), 14)
    long = replace(bare, cut_height=-2.6, length=4.6, bend_under=0.0)
    for name, slope_x, slope_y, height, part in (
        ("A-line bob", 0.0, 0.55, -1.35, 0.0), ("steep A-line bob", 0.0, 0.9, -1.3, 0.3),
        ("inverted bob", 0.0, -0.35, -1.3, 0.0), ("asymmetric bob, long left", -0.55, 0.15, -1.3, -0.32),
        ("asymmetric bob, long right", 0.55, 0.15, -1.3, 0.32),
        ("asymmetric long bob", -0.75, 0.0, -1.9, 0.0),
    ):  # fmt: skip
        steps = (cut(height, slope_x=slope_x, slope_y=slope_y),)
        tags = ("bob", "asymmetric" if slope_x else "graduated", "short")
        yield Recipe(name, tags, "cut bob", replace(long, part=part), steps, 12)
    fringed = replace(long, fringe_height=0.12)
    yield Recipe("A-line bob, fringe", ("bob", "fringe"), "cut bob", fringed, (cut(-1.3, slope_y=0.6),), 12)
    for name, height, thickness in (("low", -0.25, 0.22), ("high", 0.15, 0.2), ("full", -0.1, 0.34)):
        style = replace(base, fringe_height=None, cut_height=None, length=2.6, part_front=88.0, part_back=92.0,
                        thickness=thickness, bend_under=0.0, whorl=20.0)  # fmt: skip
        steps = (cut(height, slope_y=-0.2, spread=0.02), trim(0.35, below(-0.3, 0.1)))
        yield Recipe(f"bowl cut, {name}", ("bowl", "short", "fringe"), "bowl", style, steps, 12)
    pudding = replace(base, fringe_height=None, cut_height=None, length=2.9, part_front=88.0, part_back=92.0,
                      thickness=0.2, bend_under=0.0)  # fmt: skip
    yield Recipe("mop top", ("bowl", "short", "fringe", "messy"), "bowl", replace(pudding, wander=14.0, frizz=0.03),
                 (cut(-0.45, slope_y=0.15, spread=0.12),), 12)  # fmt: skip
    page = (cut(-1.35, outside(brow(0.6)), spread=0.02), cut(0.15, brow(0.6), spread=0.02), flip(-0.3, 0.6))
    yield Recipe("page boy", ("bowl", "medium", "fringe"), "bowl", replace(pudding, length=3.5), page, 12)


def short_hair() -> Iterator[Recipe]:
    """Crops, pixies, side partings, quiffs, undercuts, slicked back, spikes."""
    crop = STYLES["short_crop"]
    fade = trim(0.35, below(0.45))
    for name, length in (("buzz cut", 0.1), ("butch cut", 0.2), ("crop", 0.45), ("long crop", 0.75)):
        yield Recipe(name, ("short", "crop"), "short_crop", replace(crop, length=length), (), 8)
    yield Recipe("crop, faded", ("short", "crop", "fade"), "short_crop", replace(crop, length=0.6), (fade,), 8)
    yield Recipe("crop, high fade", ("short", "fade"), "short_crop", replace(crop, length=0.7),
                 (trim(0.12, below(0.6)),), 8)  # fmt: skip
    messy = replace(crop, length=1.0, wander=35.0, frizz=0.04, root_lift=1.6, side_length=0.7)
    yield Recipe("messy crop", ("short", "messy"), "short_crop", messy, (), 10)
    curly = replace(crop, length=1.1, curl=0.06, curl_pitch=0.25, curl_start=0.2, lift=0.6, gravity=0.15, wander=25.0)
    yield Recipe("curly crop", ("short", "curly"), "short_crop", replace(curly, side_length=0.8), (), 14)
    yield Recipe("curly top, short sides", ("short", "curly", "fade"), "short_crop",
                 replace(curly, length=1.5, lift=0.9), (trim(0.12, below(0.5)),), 16)  # fmt: skip
    pixie = replace(crop, length=1.3, gravity=0.6, lift=0.0, root_lift=0.8, thickness=0.14, part=0.3, part_front=-10.0,
                    part_back=110.0, whorl=0.0, side_length=0.75, nape_length=0.5)  # fmt: skip
    for sign, word in ((1.0, "left"), (-1.0, "right")):
        style = replace(pixie, part=-0.34 * sign)
        tags = ("pixie", "short", "side parting")
        yield Recipe(f"pixie, parting {word}", tags, "pixie", style, (), 10, 2)
        swept = (sweep(35.0 * sign, brow(0.7), 0.0, 0.7), trim(0.6, below(0.1)))
        yield Recipe(
            f"pixie, bangs to the {word}", (*tags, "side bangs"), "pixie", replace(style, length=1.8), swept, 12
        )
        slick = replace(pixie, part=-0.45 * sign, length=1.25, thickness=0.09, comb=1.5, wander=4.0, clump=0.4)
        yield Recipe(f"side parting, {word}", ("short", "side parting", "neat"), "side parting", slick, (fade,), 10)
        high = replace(slick, root_lift=2.0, length=1.5, thickness=0.28, lift=0.25)
        yield Recipe(f"side parting with volume, {word}", ("short", "side parting", "volume"), "side parting", high,
                     (trim(0.25, below(0.5)),), 12)  # fmt: skip
    yield Recipe("long pixie", ("pixie", "short"), "pixie", replace(pixie, length=1.9, side_length=0.9), (), 12)
    shaggy = replace(pixie, length=1.7, wander=22.0, flyaways=0.08, root_lift=1.5, frizz=0.04)
    yield Recipe("shaggy pixie", ("pixie", "short", "messy"), "pixie", shaggy, (flip(0.2, 0.6),), 12)
    back = replace(crop, part_front=88.0, part_back=92.0, sweep_back=4.0, comb=1.6, whorl=0.0, gravity=0.5, lift=0.0,
                   root_lift=1.0, thickness=0.1, side_length=0.9, wander=5.0)  # fmt: skip
    for name, length, steps in (
        ("slicked back, short", 1.0, ()), ("slicked back", 1.7, ()), ("slicked back to the neck", 2.6, ()),
        ("slicked back, undercut", 1.9, (trim(0.07, below(0.5)),)),
    ):  # fmt: skip
        yield Recipe(name, ("short", "swept back", "slick"), "slicked back", replace(back, length=length), steps, 12)
    quiff = replace(back, root_lift=4.0, lift=0.9, side_lift=0.0, gravity=0.35, bend=0.6, thickness=0.2)
    for name, length, lift in (("quiff", 1.2, 0.9), ("high quiff", 1.7, 1.2), ("pompadour", 2.1, 0.7)):
        tags = ("short", "quiff", "swept back", "fade")
        steps = (trim(0.15, outside(both(strip(0.45, 0.15), above(0.45)))),)
        yield Recipe(name, tags, "quiff", replace(quiff, length=length, lift=lift), steps, 12)
        curled = replace(quiff, length=length + 0.3, lift=lift, curl=0.08, curl_pitch=0.4, clump=0.9, wisps=300)
        yield Recipe(f"curly {name}", (*tags, "curly"), "quiff", curled, steps, 16)


def standing() -> Iterator[Recipe]:
    """Spikes, mohawks, flat tops, afros."""
    spiky = STYLES["spiky"]
    for name, length, wisps in (("short spikes", 0.45, 400), ("spikes", 0.85, 300), ("long spikes", 1.5, 160),
                                ("great spikes", 2.1, 60)):  # fmt: skip
        style = replace(spiky, length=length, wisps=wisps, lift=2.0)
        yield Recipe(name, ("short", "spiky"), "spiky", style, (), 10)
    all_round = replace(spiky, side_length=1.0, nape_length=1.0, side_lift=1.0, length=1.1, lift=2.4, gravity=0.0)
    yield Recipe("spikes all round", ("spiky", "punk"), "spiky", all_round, (), 10)
    forward = replace(spiky, length=1.0, comb=0.0, gravity=0.5, lift=0.9)
    yield Recipe("spikes, hanging", ("spiky", "short"), "spiky", forward, (), 10)
    up = replace(spiky, comb=0.0, gravity=0.0, lift=3.0, side_lift=1.0, root_lift=3.0, side_length=1.0, nape_length=1.0,
                 wander=5.0, coarse_clump=0.1, clump=0.5, length_spread=0.05)  # fmt: skip
    for name, width, length, stubble in (
        ("mohawk, short", 0.2, 0.6, 0.0), ("mohawk", 0.16, 1.3, 0.0), ("mohawk, high", 0.14, 2.0, 0.0),
        ("mohawk over stubble", 0.18, 1.1, 0.06), ("wide mohawk", 0.32, 0.8, 0.05),
    ):  # fmt: skip
        style = replace(up, length=length)
        yield Recipe(name, ("mohawk", "punk", "shaved sides"), "mohawk", style, (keep(strip(width), stubble),), 10,
                     n_strands=3500)  # fmt: skip
    liberty = replace(up, length=1.7, clump=0.95, wisps=60, coarse_wisps=40)
    yield Recipe("mohawk of spikes", ("mohawk", "spiky", "punk"), "mohawk", liberty, (keep(strip(0.16)),), 10,
                 n_strands=3500)  # fmt: skip
    fallen = replace(up, length=1.7, gravity=0.9, lift=0.0, comb=1.5, part=-0.6, wander=10.0, root_lift=1.5)
    steps = (keep(strip(0.25), 0.05),)
    yield Recipe("mohawk, fallen", ("mohawk", "shaved sides"), "mohawk", fallen, steps, 12)
    faux = replace(spiky, length=1.1, comb=0.0, lift=2.2)
    steps = (trim(0.25, outside(strip(0.35, 0.15))),)
    yield Recipe("false mohawk", ("mohawk", "short", "fade"), "mohawk", faux, steps, 10)
    puffy = STYLES["puffy"]
    for name, length in (("afro, short", 0.4), ("afro", 0.8), ("afro, big", 1.3), ("afro, huge", 1.7)):
        style = replace(puffy, length=length, lift=1.3, gravity=0.0)
        yield Recipe(name, ("afro", "coils", "round"), "puffy", style, (), 12)
    free = replace(puffy, length=1.4, gravity=0.25, lift=0.8, wander=40.0, frizz=0.09)
    yield Recipe("afro, loose", ("afro", "coils", "messy"), "puffy", free, (), 14)
    hanging_afro = replace(puffy, length=2.0, gravity=0.6, lift=0.7, curl=0.06, curl_pitch=0.18)
    yield Recipe("afro, hanging", ("afro", "coils", "medium"), "puffy", hanging_afro, (), 18)
    tapered = replace(puffy, length=1.2, lift=1.3, gravity=0.0)
    for name, steps in (
        ("afro, tapered", (trim(0.3, below(0.45, 0.3)),)), ("afro, faded", (trim(0.1, below(0.4)),)),
        ("afro, parted", (trim(0.12, both(strip(0.05, 0.06), above(0.2))), puff(0.25, below(0.6)))),
    ):  # fmt: skip
        yield Recipe(name, ("afro", "coils", "fade"), "shaped afro", tapered, steps, 12)
    flat = replace(puffy, length=1.6, lift=2.0, gravity=-0.8, comb=0.0, curl=0.015, frizz=0.02)
    for name, height in (("flat top, low", 1.4), ("flat top", 1.75), ("flat top, high", 2.2)):
        steps = (cut(height, over=True, spread=0.015), trim(0.1, below(0.55, 0.12)))
        yield Recipe(name, ("afro", "flat top", "fade"), "flat top", flat, steps, 10)


def curls() -> Iterator[Recipe]:
    """Ringlets, big waves, dreadlocks."""
    for to in ("collar", "shoulder", "chest", "back"):
        style = hanging("curly", to, curl=0.13, curl_pitch=0.6, wisps=220, clump=0.97, curl_spread=0.1, frizz=0.006)
        yield Recipe(f"ringlets to the {to}", ("ringlets", "curly", "long"), "ringlets", style, (), 24)
        big = hanging("wavy", to, coarse_wave=0.24, coarse_pitch=1.5, coarse_wisps=60, thickness=0.3, part=-0.3)
        yield Recipe(f"big waves to the {to}", ("wavy", "volume", "long"), "big waves", big, (puff(0.15),), 16)
        locks = hanging("curly", to, curl=0.015, curl_pitch=0.3, clump=0.98, clump_power=0.25, wisps=110,
                        thickness=0.3, wander=18.0, coarse_clump=0.0)  # fmt: skip
        yield Recipe(f"dreadlocks to the {to}", ("dreadlocks", "long"), "dreadlocks", locks, (), 14)
    short = replace(STYLES["curly"], length=1.2, cut_height=None, gravity=0.5, lift=0.5, clump=0.98, wisps=140,
                    curl=0.03, curl_pitch=0.3)  # fmt: skip
    yield Recipe("short dreadlocks", ("dreadlocks", "short"), "dreadlocks", short, (), 14)
    finger = hanging("wavy", "chin", coarse_wave=0.1, coarse_pitch=0.55, coarse_wisps=12, part=0.4, thickness=0.1,
                     comb=1.6, curl_start=0.2)  # fmt: skip
    yield Recipe("finger waves", ("wavy", "short", "side parting"), "big waves", finger, (), 18)
    perm = hanging("curly", "collar", curl=0.07, curl_pitch=0.24, wisps=900, thickness=0.5, lift=0.2, wander=25.0)
    yield Recipe("perm", ("curly", "volume", "medium"), "perm", perm, (puff(0.3),), 24)
    long_perm = replace(perm, cut_height=-2.8, length=4.6, lift=0.05)
    yield Recipe("perm, long", ("curly", "volume", "long"), "perm", long_perm, (puff(0.2),), 24)
    yield Recipe("perm, fringe", ("curly", "volume", "fringe"), "perm", replace(perm, fringe_height=0.05),
                 (puff(0.3),), 24)  # fmt: skip


BACK_OF_HEAD: Region = everywhere
PLACES = {"high": (0.0, 0.65, 0.85), "middle": (0.0, 1.0, 0.25), "low": (0.0, 1.0, -0.35)}


def tails() -> Iterator[Recipe]:
    """Pony tails."""
    grown = hanging("straight", "shoulder")
    for place, anchor in PLACES.items():
        rise = {"high": 0.5, "middle": 0.1, "low": -0.4}[place]
        for word, tail in (
            ("short", Tie(anchor, length=1.1, width=0.2, taper=0.7, rise=rise, bend=0.6)),
            ("long", Tie(anchor, length=3.2, width=0.24, rise=rise)),
            ("wavy", Tie(anchor, length=2.6, width=0.32, wave=0.1, pitch=0.9, rise=rise)),
            ("curly", Tie(anchor, length=2.2, width=0.42, wave=0.12, pitch=0.4, rise=rise, taper=0.8)),
        ):
            tags = ("ponytail", "tied", place, word)
            yield Recipe(f"pony tail, {place}, {word}", tags, "ponytail", grown, (tie(tail),), 16)
        fringe = hanging("straight", "shoulder", fringe_height=0.12)
        tail = Tie(anchor, length=2.3, width=0.26, rise=rise)
        steps = (tie(tail, outside(brow(0.55))),)
        yield Recipe(f"pony tail, {place}, fringe", ("ponytail", "tied", "fringe"), "ponytail", fringe, steps, 16)
        framed = hanging("straight", "chin")
        steps = (tie(tail, lambda roots: 1.0 - below(0.45)(roots) * (roots[:, 1] < -0.45)),)
        yield Recipe(f"pony tail, {place}, loose strands", ("ponytail", "tied"), "ponytail", framed, steps, 16)
    for sign, word in ((1.0, "left"), (-1.0, "right")):
        tail = Tie((0.8 * sign, 0.6, 0.1), length=2.4, width=0.28, rise=0.2)
        yield Recipe(f"side tail, {word}", ("ponytail", "tied", "asymmetric"), "ponytail", grown, (tie(tail),), 16)


def half_up() -> Iterator[Recipe]:
    """The upper half tied, pigtails."""
    grown = hanging("straight", "shoulder")
    for base, to, n_points in (("straight", "chest", 14), ("wavy", "shoulder", 16), ("wavy", "back", 16),
                               ("curly", "chest", 20), ("straight", "waist", 14)):  # fmt: skip
        loose = hanging(base, to)
        tail = Tie((0.0, 0.95, 0.5), length=1.4, width=0.2, rise=0.0, out=0.18, taper=0.6)
        top = above(0.35)
        yield Recipe(f"half up, {base} to the {to}", ("half up", base, "long"), "half up", loose, (tie(tail, top),),
                     n_points)  # fmt: skip
        knot = Tie((0.0, 0.75, 0.75), width=0.34, kind="bun")
        if to != "waist":
            yield Recipe(f"half up with a knot, {base} to the {to}", ("half up", "bun", base), "half up", loose,
                         (tie(knot, above(0.5)),), max(n_points, 16))  # fmt: skip
    for word, anchor, rise in (("high", (0.72, 0.35, 0.75), 0.5), ("middle", (0.95, 0.5, 0.1), 0.3),
                               ("low", (0.75, 0.75, -0.45), 0.0)):  # fmt: skip
        mirrored = (-anchor[0], *anchor[1:])
        for kind, tail in (
            ("straight", Tie(anchor, length=2.2, width=0.2, rise=rise)),
            ("curly", Tie(anchor, length=1.7, width=0.34, wave=0.1, pitch=0.4, rise=rise)),
            ("plaits", Tie(anchor, length=2.6, width=0.14, rise=rise, kind="braid", pitch=0.75)),
        ):
            steps = (tie(tail, side(1.0)), tie(replace(tail, anchor=mirrored), side(-1.0)))
            tags = ("pigtails", "tied", word, kind)
            yield Recipe(f"pigtails, {word}, {kind}", tags, "pigtails", grown, steps, 18 if kind == "plaits" else 16)


def buns() -> Iterator[Recipe]:
    """Buns, afro puffs, plaits."""
    grown = hanging("straight", "shoulder")
    for word, place in (*PLACES.items(), ("top", (0.0, 0.15, 1.0))):
        for size, width in (("small", 0.3), ("big", 0.52)):
            knot = Tie(place, width=width, kind="bun", out=0.06)
            yield Recipe(f"bun, {word}, {size}", ("bun", "tied", word), "bun", grown, (tie(knot),), 18)
    pair = Tie((0.7, 0.2, 0.85), width=0.36, kind="bun", out=0.05)
    steps = (tie(pair, side(1.0)), tie(replace(pair, anchor=(-0.7, 0.2, 0.85)), side(-1.0)))
    yield Recipe("two buns", ("bun", "tied", "double"), "bun", grown, steps, 18)
    fringe = hanging("straight", "shoulder", fringe_height=0.12)
    steps = (tie(Tie(PLACES["high"], width=0.45, kind="bun", out=0.06), outside(brow(0.55))),)
    yield Recipe("bun, fringe", ("bun", "tied", "fringe"), "bun", fringe, steps, 18)
    man_bun = (tie(Tie((0.0, 0.6, 0.9), width=0.28, kind="bun", out=0.05), above(0.4)), trim(0.05, below(0.35)))
    yield Recipe("top knot, undercut", ("bun", "shaved sides"), "bun", grown, man_bun, 18)
    puff_ball = Tie((0.0, 0.5, 0.9), width=0.85, kind="ball", out=0.05)
    yield Recipe("afro puff", ("afro", "tied"), "afro puffs", grown, (tie(puff_ball),), 24)
    pair = Tie((0.75, 0.25, 0.75), width=0.6, kind="ball", out=0.05)
    steps = (tie(pair, side(1.0)), tie(replace(pair, anchor=(-0.75, 0.25, 0.75)), side(-1.0)))
    yield Recipe("two afro puffs", ("afro", "tied", "double"), "afro puffs", grown, steps, 24)
    for word, anchor, length in (("low", PLACES["low"], 3.4), ("high", PLACES["high"], 3.6),
                                 ("over the left shoulder", (0.75, 0.7, -0.4), 3.0)):  # fmt: skip
        plait = Tie(anchor, length=length, width=0.2, kind="braid", pitch=0.85, rise=0.0)
        steps = (tie(plait), drape((0.75, -0.75))) if "over" in word else (tie(plait),)
        yield Recipe(f"plait, {word}", ("braid", "tied", "long"), "braid", grown, steps, 20)


def sides() -> Iterator[Recipe]:
    """Over a shoulder, behind or before both, blown about, one side shaved, mullets, balding."""
    for base, to, n_points in (("straight", "back", 14), ("wavy", "chest", 16), ("curly", "chest", 20)):
        loose = hanging(base, to)
        for sign, word in ((1.0, "left"), (-1.0, "right")):
            steps = (drape((0.85 * sign, -0.7)),)
            yield Recipe(f"{base} over the {word} shoulder", (base, "long", "one side"), "one side", loose, steps,
                         n_points)  # fmt: skip
        steps = (drape((1.0, -0.95), side(1.0)), drape((-1.0, -0.95), side(-1.0)))
        yield Recipe(f"{base} before the shoulders", (base, "long"), "before", loose, steps, n_points)
        steps = (drape((0.0, 1.1), low=-0.4),)
        yield Recipe(f"{base} behind the shoulders", (base, "long"), "behind", loose, steps, n_points)
        for word, wind in (("the left", (1.1, 0.2, 0.35)), ("the back", (0.0, 1.5, 0.5))):
            steps = (blow(wind),)
            yield Recipe(f"{base}, blown to {word}", (base, "long", "wind"), "wind", loose, steps, n_points)
    for sign, word in ((1.0, "left"), (-1.0, "right")):
        long = hanging("straight", "chin", part=0.35 * sign, thickness=0.24)
        steps = (trim(0.06, side(sign, 0.35)),)
        yield Recipe(f"{word} side shaved, bob", ("asymmetric", "shaved sides"), "side shaved", long, steps, 12)
        waves = hanging("wavy", "chest", part=0.35 * sign)
        yield Recipe(f"{word} side shaved, wavy", ("asymmetric", "long"), "side shaved", waves, steps, 16)
        combed = hanging("straight", "collar", part=0.5 * sign, part_front=-30.0, comb=1.5, root_lift=1.4)
        yield Recipe(f"deep parting, {word}", ("side parting", "medium", "volume"), "deep parting", combed,
                     (puff(0.18),), 14)  # fmt: skip
    mullet = hanging("straight", "shoulder", sweep_back=1.0, root_lift=1.2)
    for name, base, front in (("mullet", mullet, 0.3), ("wavy mullet", hanging("wavy", "shoulder"), 0.35),
                              ("curly mullet", hanging("curly", "shoulder"), 0.4)):  # fmt: skip
        region = lambda roots: above(0.1)(roots) * (roots[:, 1] < 0.35)  # noqa: E731
        yield Recipe(name, ("mullet", "medium"), "mullet", base, (trim(front, region, 0.1),), 16)
    for name, base, to, amount in (("flicked out", "straight", "collar", 0.6),
                                   ("flicked out, long", "straight", "shoulder", 0.5),
                                   ("turned in", "straight", "collar", -0.4)):  # fmt: skip
        made = (flip(amount), puff(0.1))
        yield Recipe(name, ("medium", "straight", "flicked"), "flicked", hanging(base, to), made, 16)
    crown = lambda roots: above(0.62)(roots)  # noqa: E731
    for name, style, n_points in (("balding, short", replace(STYLES["short_crop"], length=0.35), 8),
                                  ("balding, long", hanging("wavy", "collar"), 16)):  # fmt: skip
        yield Recipe(name, ("balding",), "balding", style, (keep(outside(crown)),), n_points)
    receding = lambda roots: (roots[:, 1] < -0.1) * above(0.3)(roots) * (1.0 - strip(0.2)(roots))  # noqa: E731
    yield Recipe("receding", ("balding", "short"), "balding", replace(STYLES["short_crop"], length=0.5),
                 (keep(outside(receding)),), 8)  # fmt: skip


GROUPS: tuple[Callable[[], Iterator[Recipe]], ...] = (
    parted_lengths, volumes, fringes, bobs, short_hair, standing, curls, tails, half_up, buns, sides,
)  # fmt: skip


def recipes() -> list[Recipe]:
    """All recipes; their names differ."""
    return [recipe for group in GROUPS for recipe in group()]
