"""The starter grooms' hairstyles, grown on any head by procedures of our own; no Blender needed."""

from __future__ import annotations

import numpy as np
from collider import Collider
from growth import (
    Course,
    Style,
    Wisps,
    arc_lengths,
    clump,
    frames_along,
    fringe_weight,
    gather_wisps,
    grow,
    nearest_on_part,
    resample_to,
    smoothstep,
    unit,
    wander_along,
    wave,
)
from hairloom.errors import require
from hairloom.geometry.roots import scatter_roots
from hairloom.types import Float64, Floats, Head, StrandSet

TEAR = 2.5  # steps of a pushed strand that are so many times longer than its others are gaps
SHORTEST_CUT = 0.35  # head radii: hair rooted below the height it is cut at is left this long

STYLES: dict[str, Style] = {
    "straight": Style(
        n_points=32,
        length=4.4,
        cut_height=-2.5,
        length_spread=0.05,
        sweep_back=0.05,
        root_lift=0.6,
        wander=7.0,
        coarse_clump=0.45,
        clump=0.7,
        frizz=0.012,
        melanin=0.6,
        redness=0.35,
    ),
    "wavy": Style(
        n_points=32,
        length=4.0,
        cut_height=-2.1,
        length_spread=0.08,
        part=0.3,
        sweep_back=0.15,
        root_lift=0.8,
        thickness=0.2,
        wander=8.0,
        coarse_wave=0.14,
        coarse_pitch=0.95,
        curl_start=0.9,
        coarse_wisps=110,
        wisps=1000,
        coarse_clump=0.6,
        clump=0.8,
        frizz=0.012,
        flyaways=0.02,
        melanin=0.42,
        redness=0.6,
    ),
    "curly": Style(
        n_points=56,
        length=2.9,
        cut_height=-1.3,
        length_spread=0.12,
        part=-0.2,
        comb=0.6,
        comb_fade=1.2,
        sweep_back=0.1,
        root_lift=1.4,
        lift=0.12,
        thickness=0.34,
        wander=14.0,
        curl=0.1,
        curl_pitch=0.42,
        curl_start=0.5,
        curl_spread=0.2,
        wisps=480,
        coarse_clump=0.2,
        clump=0.93,
        clump_power=0.4,
        frizz=0.014,
        melanin=0.52,
        redness=0.4,
    ),
    "spiky": Style(
        n_strands=16_000,
        n_points=14,
        length=0.8,
        length_spread=0.16,
        side_length=0.4,
        nape_length=0.9,
        part_front=90.0,
        part_back=115.0,
        comb=0.5,
        gravity=0.12,
        lift=1.6,
        side_lift=0.15,
        root_lift=1.8,
        bend=0.5,
        thickness=0.02,
        wander=16.0,
        coarse_wisps=140,
        wisps=300,
        coarse_clump=0.25,
        clump=0.97,
        clump_power=1.5,
        frizz=0.004,
        flyaways=0.015,
        melanin=0.85,
    ),
    "puffy": Style(
        n_points=40,
        length=0.85,
        length_spread=0.1,
        comb=0.15,
        gravity=0.04,
        lift=1.0,
        root_lift=2.5,
        bend=0.5,
        part_front=90.0,
        thickness=0.02,
        wander=25.0,
        curl=0.035,
        curl_pitch=0.1,
        curl_start=0.15,
        curl_spread=0.9,
        wisps=2600,
        coarse_clump=0.15,
        clump=0.5,
        frizz=0.05,
        flyaways=0.06,
        melanin=0.75,
        redness=0.3,
    ),
    "bob": Style(
        n_strands=12_000,
        n_points=24,
        length=2.6,
        cut_height=-1.1,
        length_spread=0.02,
        root_lift=0.6,
        thickness=0.16,
        comb_fade=0.9,
        fringe_height=0.12,
        bend_under=1.6,
        wander=3.5,
        coarse_clump=0.08,
        clump=0.35,
        frizz=0.006,
        flyaways=0.015,
        melanin=0.9,
        redness=0.2,
        sweep_back=-0.12,
    ),
    "short_crop": Style(
        n_strands=20_000,
        n_points=12,
        length=0.42,
        length_spread=0.12,
        side_length=0.4,
        nape_length=0.6,
        part_front=110.0,
        part_back=112.0,
        whorl=50.0,
        comb=1.0,
        gravity=0.25,
        lift=0.25,
        root_lift=1.1,
        thickness=0.06,
        wander=14.0,
        wisps=1200,
        coarse_clump=0.3,
        clump=0.6,
        frizz=0.01,
        melanin=0.55,
        redness=0.6,
        strand_radius=0.00014,
    ),
    "tangled": Style(
        n_points=40,
        length=2.6,
        cut_height=-1.5,
        length_spread=0.2,
        part=0.15,
        comb=0.6,
        root_lift=1.2,
        lift=0.3,
        thickness=0.4,
        wander=30.0,
        coarse_wave=0.14,
        coarse_pitch=1.1,
        curl=0.06,
        curl_pitch=0.5,
        curl_flat=0.3,
        wisps=700,
        curl_spread=0.5,
        coarse_clump=0.5,
        clump=0.85,
        frizz=0.04,
        flyaways=0.08,
        melanin=0.33,
        redness=0.8,
    ),
}


def make_style(
    name: str, head: Head, n_strands: int | None = None, n_points: int | None = None, seed: int = 0
) -> StrandSet:
    """Grow one of STYLES on a head.

    Parameters
    ----------
    head : world space, metres, z up, the face towards -y; its scalp grows the hair.
    n_strands, n_points : None for what the style needs.

    Returns
    -------
    StrandSet : world space, metres, every strand of n_points points; point attribute `radius` (P,) float32 metres,
        strand attributes `wisp` and `coarse_wisp` (S,) int32. The same arguments give the same bytes.

    Raises
    ------
    InputError : no such style, or a head without a scalp.
    """
    require(name in STYLES, f"no hairstyle '{name}'; take one of {', '.join(STYLES)}")
    return grow_style(STYLES[name], Collider(head), n_strands, n_points, seed)


def grow_style(
    style: Style, collider: Collider, n_strands: int | None = None, n_points: int | None = None, seed: int = 0
) -> StrandSet:
    """As `make_style`, for a style of one's own; a collider can serve several."""
    n_strands = style.n_strands if n_strands is None else n_strands
    n_points = style.n_points if n_points is None else n_points
    require(n_strands >= 1 and n_points >= 2, f"{n_strands} strands of {n_points} points; take 1 of 2 or more")
    rng = np.random.default_rng(seed)
    roots, normals = _roots(collider, n_strands, seed)
    coarse, fine = _gather(style, roots, rng)
    loose = rng.random(n_strands) < style.flyaways
    fringe = fine.spread(coarse.spread(fringe_weight(style, roots[coarse.centres]))[fine.centres])
    strands = grow(style, collider, roots, normals, _course(style, roots, coarse, fine, loose, fringe, rng), 48)
    lengths = _lengths(style, strands, coarse, fine, loose, fringe, rng)
    for wisps, strength in ((coarse, style.coarse_clump), (fine, style.clump)):
        held = strength * wisps.spread(rng.uniform(0.75, 1.1, len(wisps.centres)))
        held = np.clip(held, 0.0, 0.98) * np.where(loose, 0.15, rng.uniform(0.8, 1.0, n_strands))
        strands = clump(strands, wisps, held, style.clump_power, lengths)
    strands = resample_to(strands, lengths, n_points)
    strands = _add_detail(style, strands, normals, coarse, fine, loose, rng)
    strands = _keep_outside(collider, strands)
    strands[:, 0] = roots
    return _as_strand_set(style, collider, strands, coarse, fine, loose)


def _roots(collider: Collider, count: int, seed: int) -> tuple[Float64, Float64]:
    head = collider.surface.head
    roots = scatter_roots(head, head.scalp, count, seed)
    normals = collider.surface.normals_at(roots.triangles, roots.barycentric)
    return collider.to_unit(roots.points), normals.astype(np.float64)


def _gather(style: Style, roots: Float64, rng: np.random.Generator) -> tuple[Wisps, Wisps]:
    """Coarse wisps, and wisps that do not cross the borders of the coarse ones."""
    side = np.where(roots[:, 0] > style.part, 1.0, -1.0) * (unit(roots)[:, 1] < 0.5)
    share = len(roots) / 10_000
    coarse = gather_wisps(roots, side, max(8, round(style.coarse_wisps * min(share, 1.0) ** 0.5)), rng)
    fine = gather_wisps(roots, side, max(16, round(style.wisps * share)), rng)
    # a wisp belongs to the coarse wisp of its centre
    labels = coarse.labels[fine.centres][fine.labels]
    return Wisps(labels, coarse.centres), fine


def _varied(wisp_levels: tuple[Wisps, Wisps], n_strands: int, rng: np.random.Generator) -> Floats:
    """(S,) noise of standard deviation 1: part from the coarse wisp, part from the wisp, part from the strand."""
    coarse, fine = wisp_levels
    from_coarse = coarse.spread(rng.normal(size=len(coarse.centres)))
    from_fine = fine.spread(rng.normal(size=len(fine.centres)))
    return 0.7 * from_coarse + 0.6 * from_fine + 0.4 * rng.normal(size=n_strands)


def _course(
    style: Style, roots: Float64, coarse: Wisps, fine: Wisps, loose: Floats, fringe: Floats, rng: np.random.Generator
) -> Course:
    levels, count = (coarse, fine), len(roots)
    angle = np.radians(style.wander) * _varied(levels, count, rng) * np.where(loose, 2.0, 1.0)
    # roots near the parting lean to and fro across it, or a bald line would show
    on_sphere = unit(roots)
    from_part = np.linalg.norm(on_sphere - nearest_on_part(style, on_sphere), axis=1)
    angle += np.radians(35.0) * np.exp(-((from_part / 0.14) ** 2)) * rng.normal(size=count)
    lift = np.clip(1.0 + 0.25 * _varied(levels, count, rng), 0.2, 2.0) * np.where(loose, 1.5, 1.0)
    # near the part on top of the layer, at its lower border beneath
    above = smoothstep(-0.4, 1.0, on_sphere[:, 2])
    height = style.thickness * np.clip(0.15 + 0.85 * above + 0.18 * _varied(levels, count, rng), 0.03, 1.4)
    return Course(angle, lift, height * np.where(loose, 1.25, 1.0), fringe)


def _lengths(
    style: Style, strands: Float64, coarse: Wisps, fine: Wisps, loose: Floats, fringe: Floats, rng: np.random.Generator
) -> Floats:
    """(S,) where each strand is cut: by length, and by height where the style or its fringe is cut straight."""
    count = len(strands)
    factor = 1.0 + style.length_spread * _varied((coarse, fine), count, rng)
    factor *= np.where(rng.random(count) < 0.12, rng.uniform(0.6, 1.0, count), 1.0)  # hair that grows back
    place = unit(strands[:, 0])
    factor *= 1.0 + (style.side_length - 1.0) * smoothstep(0.75, 0.35, place[:, 2])
    factor *= 1.0 + (style.nape_length - 1.0) * smoothstep(0.1, -0.45, place[:, 2]) * smoothstep(-0.2, 0.5, place[:, 1])
    factor *= np.where(loose, rng.uniform(0.55, 1.0, count), 1.0)
    arcs = arc_lengths(strands)
    lengths = arcs[:, -1].copy()
    for height, chosen in ((style.cut_height, fringe < 0.5), (style.fringe_height, fringe >= 0.5)):
        if height is not None:
            below = strands[:, :, 2] < height
            cut = arcs[np.arange(count), np.where(below.any(axis=1), below.argmax(axis=1), -1)]
            lengths = np.where(chosen, np.maximum(cut, SHORTEST_CUT), lengths)
    return np.clip(lengths * factor, 0.02, arcs[:, -1])


def _add_detail(
    style: Style,
    strands: Float64,
    normals: Float64,
    coarse: Wisps,
    fine: Wisps,
    loose: Floats,
    rng: np.random.Generator,
) -> Float64:
    """Waves of the coarse wisps, curls of the wisps, frizz of the strands, across each strand's own direction."""
    arcs = arc_lengths(strands)
    count = len(strands)
    frames = frames_along(strands, normals)
    across, up = np.zeros_like(arcs), np.zeros_like(arcs)
    if style.coarse_wave:
        waves = len(coarse.centres)
        radius = coarse.spread(style.coarse_wave * rng.uniform(0.6, 1.3, waves))
        pitch = coarse.spread(style.coarse_pitch * rng.uniform(0.85, 1.15, waves))
        phase = coarse.spread(rng.uniform(0.0, 2.0 * np.pi, waves)) + rng.normal(0.0, 0.15, count)
        offsets = wave(arcs, radius, pitch, phase, 0.8, np.ones(count), style.curl_start)
        across, up = across + offsets[0], up + offsets[1]
    if style.curl:
        curls = len(fine.centres)
        radius = fine.spread(style.curl * rng.uniform(0.7, 1.25, curls)) * rng.normal(1.0, 0.12, count)
        pitch = fine.spread(style.curl_pitch * rng.uniform(0.85, 1.2, curls)) * rng.normal(1.0, 0.02, count)
        phase = fine.spread(rng.uniform(0.0, 2.0 * np.pi, curls)) + rng.normal(0.0, style.curl_spread, count)
        hand = fine.spread(rng.choice([-1.0, 1.0], curls))
        offsets = wave(arcs, radius, pitch, phase, style.curl_flat, hand, style.curl_start)
        across, up = across + offsets[0], up + offsets[1]
    detailed = strands + across[..., None] * frames[..., 1] + up[..., None] * frames[..., 0]
    amount = style.frizz * np.where(loose, 3.0, rng.uniform(0.4, 1.3, count))
    grown = amount[:, None] * smoothstep(0.0, 1.0, arcs / max(1e-6, 0.8 * style.length))
    return detailed + grown[..., None] * wander_along(arcs, 1.1, rng)


def _keep_outside(collider: Collider, strands: Float64) -> Float64:
    """Push strands out of the head, again after making their steps even, which moves points.

    A strand that the head tears apart, its one part on this side and its other on that, ends where it tears.
    """
    count, n_points = strands.shape[:2]
    lengths = arc_lengths(strands)[:, -1]
    for _ in range(3):
        strands = resample_to(strands, lengths, n_points)
        soft = np.minimum(0.03, 0.5 * arc_lengths(strands)).ravel()
        strands = collider.push_out(strands.reshape(-1, 3), soft).reshape(count, n_points, 3)
        arcs = arc_lengths(strands)
        steps = np.diff(arcs, axis=1)
        torn = steps > TEAR * np.median(steps, axis=1, keepdims=True)
        last = np.where(torn.any(axis=1), np.maximum(torn.argmax(axis=1), 1), n_points - 1)
        lengths = arcs[np.arange(count), last]
    return strands


def _as_strand_set(
    style: Style, collider: Collider, strands: Float64, coarse: Wisps, fine: Wisps, loose: Floats
) -> StrandSet:
    count, n_points = strands.shape[:2]
    taper = style.strand_radius * (1.0 - 0.75 * np.linspace(0.0, 1.0, n_points) ** 2)
    radius = np.where(loose, 0.7, 1.0)[:, None] * taper
    return StrandSet(
        collider.to_world(strands).reshape(-1, 3),
        (np.arange(count + 1) * n_points).astype(np.int32),
        {"radius": radius.astype(np.float32).ravel()},
        {"wisp": fine.labels, "coarse_wisp": coarse.labels},
    )
