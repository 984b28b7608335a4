"""The commands of the command line about photos: four-view, hair-database."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .cli_database import add_database_command
from .errors import require
from .fourview.database import open_database
from .fourview.inputs import read_inputs
from .fourview.pipeline import STAGES, FourViewParams, model_hair
from .fourview.project import read_project
from .io.images import write_image
from .io.strands import write_strands
from .io.units import Units
from .progress import Progress
from .registry import build_params
from .types import StrandSet

Report = dict[str, Any]
Clock = Callable[[str], None]


def add_commands(command: Callable[..., argparse.ArgumentParser]) -> None:
    """Add the commands; `command(name, run, text, *parents)` makes one."""
    parser = command("four-view", _four_view, "Model hair from 1 to 8 photos.")
    parser.add_argument("project", type=Path, help="the PROJECT.toml (docs/four-view.md); the wizard writes the same")
    parser.add_argument("out", type=Path, help="the groom to write: .hair .data .tfx .ply .npz")
    parser.add_argument("--out-units", help="units and up axis of the output (default: the format's own)")
    parser.add_argument("--strands", type=int, help="strands in all, instead of the project's number")
    parser.add_argument("--texture", type=Path, help="also write the hair texture, .png")
    parser.add_argument("--masks", type=Path, help="also write the masks that were used into this folder, .png")
    add_database_command(command)


def _four_view(options: argparse.Namespace, clock: Clock, progress: Progress) -> Report:
    clock("read")
    project = read_project(options.project)
    params: FourViewParams = build_params(FourViewParams, project.settings)
    if options.strands is not None:
        params = replace(params, strands=replace(params.strands, n_strands=options.strands))
    inputs = read_inputs(project, progress=progress)
    database = open_database(None, [project.path(folder) for folder in project.grooms])
    clock("model")
    stages = StageProgress(progress, clock)
    result = model_hair(inputs.views, inputs.head, database, inputs.strokes, params, progress=stages)
    clock("write")
    units = Units.parse(options.out_units) if options.out_units else None
    write_strands(options.out, with_point_colours(result.strands), units=units)
    if options.texture is not None:
        write_image(options.texture, result.texture.image())
    if options.masks is not None:
        require(options.masks.is_dir(), f"there is no folder {options.masks} for the masks; make it first")
        for view in inputs.views:
            write_image(options.masks / f"{view.name}_mask.png", view.mask)
    remarks = [*inputs.remarks, *database.remarks, *result.report.pop("remarks", [])]
    return {"strands": result.strands.n_strands, **result.report, "remarks": remarks, "out": str(options.out)}


def with_point_colours(strands: StrandSet) -> StrandSet:
    """The strands with their colours at the points too, where file formats keep them."""
    colours = np.repeat(strands.strand_attributes["groom_color"][:, :3], strands.point_counts, axis=0)
    points = {**strands.point_attributes, "color": colours}
    return StrandSet(strands.points, strands.offsets, points, strands.strand_attributes)


class StageProgress:
    """Passes progress on, and tells the clock which of the method's stages is running."""

    def __init__(self, progress: Progress, clock: Clock) -> None:
        self._progress, self._clock, self._stage = progress, clock, ""

    def __call__(self, fraction: float, message: str, /) -> None:
        stage = next((name for name, (_, end) in STAGES.items() if fraction < end), "report")
        if stage != self._stage:
            self._clock(stage)
            self._stage = stage
        self._progress(fraction, message)
