"""The command `hair-database` of the command line: list, search, add."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .errors import require
from .fourview.database import HairDatabase, open_database, search
from .fourview.database_entries import CACHE_SUFFIX, hairstyle_of_file
from .fourview.database_files import write_hairstyles
from .fourview.inputs import read_inputs
from .fourview.placement import place_cameras
from .fourview.project import read_project
from .fourview.views import View
from .geometry.head import default_head, read_head
from .geometry.scalp_guess import guess_scalp
from .io.images import read_mask
from .io.strands import write_strands
from .io.units import Units
from .progress import Progress
from .types import Bools, Head

Report = dict[str, Any]
Clock = Callable[[str], None]


def add_database_command(command: Callable[..., argparse.ArgumentParser]) -> None:
    """Add the command; `command(name, run, text, *parents)` makes one."""
    parser = command("hair-database", run_database, "The database of hairstyles: list it, search it, add to a folder.")
    parser.add_argument("--database", type=Path, help="another file of hairstyles than Hairloom's own")
    parser.add_argument(
        "--folder", type=Path, action="append", default=[], help="a folder of own grooms that joins in; repeatable"
    )
    actions = parser.add_subparsers(dest="action", required=True)
    shown = actions.add_parser("list", help="names, tags and families")
    shown.add_argument("--tag", action="append", default=[], help="only hairstyles with this tag; repeatable")
    shown.add_argument("--family", help="only hairstyles of this family")
    found = actions.add_parser("search", help="the hairstyles that look most like the masks (eq. 1)")
    found.add_argument("what", nargs="+", help="a PROJECT.toml, or masks as front=FRONT.png, left=LEFT.png ...")
    found.add_argument("--head", type=Path, help="the head of the masks, .obj (default: Hairloom's own)")
    found.add_argument("--head-units", help="units and up axis of --head, such as 'cm,y-up'")
    found.add_argument("--best", type=int, default=5, help="how many (default: 5)")
    found.add_argument("--exclude", action="append", default=[], help="a hairstyle that is not to be found; repeatable")
    found.add_argument("--exclude-family", action="append", default=[], help="likewise all of a family; repeatable")
    found.add_argument("--out", type=Path, help="write the best one, on the head, to this groom file")
    added = actions.add_parser("add", help="make a hairstyle of a groom and put it into a folder")
    added.add_argument("to", type=Path, help="the folder")
    added.add_argument("groom", type=Path, help=".hair .data .tfx .ply .obj .npz")
    added.add_argument("--head", type=Path, help="its head, .obj (default: guessed from the roots)")
    added.add_argument("--units", help="units and up axis of both files (default: the format's own)")
    added.add_argument("--name", default="", help="its name (default: that of the file)")
    added.add_argument("--tag", action="append", default=[], help="a word to choose it by; repeatable")


def run_database(options: argparse.Namespace, clock: Clock, progress: Progress) -> Report:
    """What the action asks for; raises FileError and InputError."""
    if options.action == "add":
        return _add(options, clock)
    clock("open")
    database = open_database(options.database, options.folder)
    return _list(options, database) if options.action == "list" else _search(options, database, clock, progress)


def _list(options: argparse.Namespace, database: HairDatabase) -> Report:
    wanted = set(options.tag)
    chosen = [
        style
        for style in database.styles
        if wanted <= set(style.tags) and options.family in (None, style.family)
    ]  # fmt: skip
    if options.json:
        entries = [{"name": style.name, "tags": list(style.tags), "family": style.family} for style in chosen]
        return {"n_hairstyles": len(chosen), "hairstyles": entries, "remarks": list(database.remarks)}
    shown = {style.name: f"{', '.join(style.tags)} ({style.family})" for style in chosen}
    return {"hairstyles": len(chosen), **shown, **_remarks(database)}


def _search(options: argparse.Namespace, database: HairDatabase, clock: Clock, progress: Progress) -> Report:
    require(options.best >= 1, f"--best is {options.best}; it must be 1 or more")
    clock("read")
    views, head = _views(options, progress)
    exclude = {*options.exclude, *database.named(*options.exclude_family)}
    clock("search")
    matches = search(database, views, head, n_best=options.best, exclude=exclude)
    report: Report = {
        "matches": [
            {
                "name": match.name,
                "distance": round(match.distance, 4),
                "per_view": {view.name: round(float(part), 4) for view, part in zip(views, match.per_view)},
            }
            for match in matches
        ]
    }
    if options.out is not None:
        clock("write")
        write_strands(options.out, database.strands(matches[0].index, head))
        report["out"] = str(options.out)
    return report | _remarks(database)


def _views(options: argparse.Namespace, progress: Progress) -> tuple[tuple[View, ...], Head]:
    """The views of a project, or of masks alone with cameras placed by them."""
    given: Head | None = None
    if options.head is not None:
        given = guess_scalp(read_head(options.head, Units.parse(options.head_units) if options.head_units else None))
    if len(options.what) == 1 and "=" not in options.what[0]:
        inputs = read_inputs(read_project(Path(options.what[0])), given, progress)
        return inputs.views, inputs.head
    masks: dict[str, Bools] = {}
    for text in options.what:
        name, equals, path = text.partition("=")
        require(equals and path, f"'{text}' is no mask; write it as front=FRONT.png, or give one PROJECT.toml")
        require(name not in masks, f"view '{name}' is given twice; give each once")
        masks[name] = read_mask(Path(path))
    head = given or default_head()
    cameras = place_cameras(masks, head)
    blank = {name: np.zeros((*mask.shape, 3), np.uint8) for name, mask in masks.items()}
    return tuple(View(name, blank[name], mask, cameras[name]) for name, mask in masks.items()), head


def _add(options: argparse.Namespace, clock: Clock) -> Report:
    require(options.to.is_dir(), f"there is no folder {options.to}; make it first")
    clock("read")
    units = Units.parse(options.units) if options.units else None
    style = hairstyle_of_file(options.groom, options.head, units=units, tags=options.tag, name=options.name)
    clock("write")
    path = options.to / f"{options.groom.stem}{CACHE_SUFFIX}"
    write_hairstyles(path, [style])
    return {"name": style.name, "strands": style.n_strands, "points": style.n_points, "out": str(path)}


def _remarks(database: HairDatabase) -> Report:
    return {"remarks": list(database.remarks)} if database.remarks else {}
