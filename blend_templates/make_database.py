"""Make the database of hairstyles: `python blend_templates/make_database.py [OUT.npz] [--processes N]`.

Writes backend/data/hairstyles.npz from the recipes of `hairstyle_recipes` (grown) and `hairstyle_variations` (made by
Hairloom's own synthesis, detail transfer and comb from grown ones), all on Hairloom's plain head. Needs no Blender. The
same script gives the same bytes, whatever the number of processes.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path
from zlib import crc32

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

import numpy as np  # noqa: E402
from collider import Collider  # noqa: E402
from growth import arc_lengths, resample_to  # noqa: E402
from hairloom.fourview.database_entries import EntryHead, EntryParams, entry_head, make_hairstyle  # noqa: E402
from hairloom.fourview.database_files import Hairstyle, pack_strands, read_hairstyles, write_hairstyles  # noqa: E402
from hairloom.geometry.head import default_head  # noqa: E402
from hairloom.geometry.strands import from_dense  # noqa: E402
from hairloom.types import StrandSet  # noqa: E402
from hairstyle_recipes import Recipe, recipes  # noqa: E402
from hairstyle_shapes import Hair  # noqa: E402
from hairstyle_variations import Variation, variations  # noqa: E402
from styles import grow_style  # noqa: E402
from tqdm import tqdm  # noqa: E402

OUTPUT = HERE.parent / "backend" / "data" / "hairstyles.npz"
N_POINTS = 40
N_KEPT = 1100  # strands of an entry, at most
LARGEST = 8_000_000  # bytes of the file; strands are thinned until it is no larger
ALLOWANCE = 1_000_000  # bytes of these for masks and names
N_VARIED = 900  # strands that variations are made from and of


@cache
def collider() -> Collider:
    """Of Hairloom's plain head, once a process."""
    return Collider(default_head())


@cache
def head() -> EntryHead:
    return entry_head(default_head())


def grow_recipe(recipe: Recipe) -> StrandSet:
    """The hairstyle of a recipe on Hairloom's plain head: world space, metres, N_POINTS points a strand."""
    seed = crc32(recipe.name.encode()) + recipe.seed
    grown = grow_style(recipe.style, collider(), recipe.n_strands, N_POINTS, seed)
    strands = collider().to_unit(grown.points).reshape(recipe.n_strands, -1, 3)
    hair = Hair(strands, grown.strand_attributes["wisp"], collider())
    rng = np.random.default_rng(seed)
    for step in recipe.steps:
        hair = step(hair, rng)
    even = resample_to(hair.strands, arc_lengths(hair.strands)[:, -1], N_POINTS)
    return from_dense(collider().to_world(even), {"wisp": hair.wisps})


def make_entry(name: str) -> Hairstyle:
    """The entry of the recipe or variation of this name."""
    made = all_by_name()[name]
    if isinstance(made, Variation):
        strands = made.make(lambda base: grow_recipe(replace(recipe_named(base), n_strands=N_VARIED)), default_head())
    else:
        strands = grow_recipe(made)
    params = EntryParams(N_KEPT, made.n_points)
    return make_hairstyle(name, strands, head(), tags=made.tags, family=made.family, params=params)


@cache
def all_by_name() -> dict[str, Recipe | Variation]:
    """Every hairstyle of the database, in its order."""
    return {made.name: made for made in (*recipes(), *variations())}


def recipe_named(name: str) -> Recipe:
    """A grown hairstyle."""
    found = all_by_name()[name]
    if not isinstance(found, Recipe):
        raise KeyError(name)
    return found


def fit_into(styles: list[Hairstyle], largest: int) -> list[Hairstyle]:
    """The hairstyles with so many strands less, the same share of each, that all strands take `largest` bytes."""
    fitting, share = styles, 1.0
    while (size := sum(len(style.packed) for style in fitting)) > largest:
        share *= 0.99 * largest / size
        fitting = [thinned(style, share) for style in styles]
    return fitting


def thinned(style: Hairstyle, share: float) -> Hairstyle:
    """Every so many-th strand of a hairstyle; they are sorted by place, so the rest is as even."""
    count = max(round(share * style.n_strands), 1)
    chosen = ((np.arange(count) + 0.5) * style.n_strands / count).astype(np.int64)
    return replace(style, n_strands=count, packed=pack_strands(style.points()[chosen]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, nargs="?", default=OUTPUT)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", default="", help="make again only the hairstyles whose name has this in it")
    options = parser.parse_args()
    names = [name for name in all_by_name() if options.only in name]
    with ProcessPoolExecutor(options.processes) as pool:
        styles = list(tqdm(pool.map(make_entry, names, chunksize=4), total=len(names)))
    if options.only and options.out.exists():
        made = {style.name: style for style in (*read_hairstyles(options.out), *styles)}
        styles = [made[name] for name in all_by_name() if name in made]
    write_hairstyles(options.out, fit_into(styles, LARGEST - ALLOWANCE))
    print(f"{options.out}: {len(styles)} hairstyles, {options.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
