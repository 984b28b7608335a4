"""The command line `hairloom`: info, convert, cluster, synthesize, comb, detail, transfer, fit-helices, bench, warm-up.

Exit status: 0 done, 2 bad input (one line on standard error), 130 cancelled with Ctrl-C.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from .cli_fourview import add_commands as add_photo_commands
from .cli_rods import add_commands as add_rod_commands
from .editing.binding import wisp_labels
from .editing.comb import comb
from .editing.strokes import read_strokes
from .errors import HairloomError, require
from .geometry.collider import comb_collider
from .geometry.head import default_head, find_scalp, read_head
from .geometry.strands import strand_lengths
from .io.bundle import write_bundle
from .io.files import read_file
from .io.npz import read_arrays
from .io.strands import read_strands, write_strands
from .io.units import Units
from .jobs.cluster_wisps import labels_of_strands
from .jobs.transfer_details import as_strand_set, fitting, transfer_report
from .progress import Progress
from .synthesis.detail_transfer import LENGTH_MODES, DetailParams, transfer_style
from .synthesis.details import SMALL, Detail, holds_detail, read_detail, reduce_details, write_detail
from .synthesis.hierarchy import HierarchyParams
from .synthesis.pipeline import SynthesisParams, analyze, synthesize_from
from .synthesis.statistics import compare_styles
from .types import Bools, Head, StrandSet, WispHierarchy

Report = dict[str, Any]


class StageClock:
    """Seconds per stage: call it with a stage's name when the stage begins; the same name adds up."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._stage = ""
        self._since = time.perf_counter()

    def __call__(self, stage: str) -> None:
        now = time.perf_counter()
        if self._stage:
            self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + now - self._since
        self._stage, self._since = stage, now


def peak_memory_bytes() -> int:
    """The most memory this process has had, bytes."""
    if sys.platform == "win32":
        import psutil  # only Windows needs it

        return int(psutil.Process().memory_info().peak_wset)
    import resource  # not on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak) if sys.platform == "darwin" else int(peak) * 1024


def _progress_bar(options: argparse.Namespace) -> tuple[Progress, Callable[[], None]]:
    """A progress bar on a terminal, nothing elsewhere or with --json."""
    bar = tqdm(total=100, disable=options.json or not sys.stderr.isatty(), bar_format="{desc:40} {bar} {n:3.0f}%")

    def progress(fraction: float, message: str, /) -> None:
        bar.set_description_str(message[:40])
        bar.n = round(100 * fraction)
        bar.refresh()

    return progress, bar.close


def _strands(options: argparse.Namespace) -> StrandSet:
    return _read_groom(options.hair, options.units)


def _read_groom(path: Path, units: str | None) -> StrandSet:
    strands = read_strands(path, units=_units(units))
    require(strands.n_strands > 0, f"{path} has no strands; choose a groom that has")
    return strands


def _groom(path: Path, head_path: str | None, units: str | None) -> tuple[StrandSet, Head]:
    strands = _read_groom(path, units)
    return strands, _read_head(head_path, units, strands)


def _units(text: str | None) -> Units | None:
    return Units.parse(text) if text else None


def _head(options: argparse.Namespace, strands: StrandSet) -> Head:
    return _read_head(options.head, options.head_units or options.units, strands)


def _read_head(path: str | None, units: str | None, strands: StrandSet) -> Head:
    if path is None:
        return default_head()
    head = read_head(path, _units(units))
    return head if head.scalp.any() else find_scalp(head, strands.roots)


def _region(path: str | None, head: Head) -> Bools | None:
    """A scalp region: an .npz with `triangles` (indices) or `mask` (one bool a triangle)."""
    if path is None:
        return None
    arrays = read_arrays(Path(path), read_file(Path(path)))
    if "mask" in arrays:
        mask = np.asarray(arrays["mask"], dtype=np.bool_)
        require(
            mask.shape == head.scalp.shape, f"{path}: the mask has {mask.size} values for {head.scalp.size} triangles"
        )
        return mask
    require("triangles" in arrays, f"{path} has neither 'mask' nor 'triangles'; store one of them")
    indices = np.asarray(arrays["triangles"])
    require(indices.dtype.kind in "iu", f"{path}: 'triangles' must be whole numbers, not {indices.dtype}")
    inside = (indices >= 0) & (indices < head.scalp.size)
    require(inside.all(), f"{path} names triangle {indices[~inside][:1]} but the head has {head.scalp.size} triangles")
    region = np.zeros(head.scalp.size, np.bool_)
    region[indices] = True
    return region


def _synthesis_params(options: argparse.Namespace) -> SynthesisParams:
    params = SynthesisParams(seed=options.seed)
    wisps = replace(params.hierarchy.wisps, n_wisps=options.k0, error_threshold=options.epsilon, seed=options.seed)
    hierarchy: HierarchyParams = replace(params.hierarchy, n_levels=options.levels, wisps=wisps)
    return replace(params, hierarchy=hierarchy, n_strands=getattr(options, "strands", 0))


def _info(options: argparse.Namespace, clock: StageClock, progress: Progress) -> Report:
    clock("read")
    strands = _strands(options)
    lengths, counts = strand_lengths(strands), strands.point_counts
    return {
        "strands": strands.n_strands,
        "points": len(strands.points),
        "points_per_strand": [int(counts.min()), int(counts.max())],
        "length_m": [float(lengths.min()), float(np.median(lengths)), float(lengths.max())],
        "bounds_m": [strands.points.min(axis=0).tolist(), strands.points.max(axis=0).tolist()],
        "attributes": sorted([*strands.point_attributes, *strands.strand_attributes]),
    }


def _convert(options: argparse.Namespace, clock: StageClock, progress: Progress) -> Report:
    clock("read")
    strands = _strands(options)
    clock("write")
    write_strands(options.out, strands, units=_units(options.out_units))
    return {"strands": strands.n_strands, "points": len(strands.points), "out": str(options.out)}


def _cluster(options: argparse.Namespace, clock: StageClock, progress: Progress) -> Report:
    clock("read")
    strands = _strands(options)
    head = _head(options, strands)
    clock("cluster")
    example = analyze(strands, head, _synthesis_params(options), progress=progress)
    clock("write")
    write_bundle(options.out, {"hierarchy": example.hierarchy})
    finest = example.wisp_sets[0]
    return {
        "wisps": [level.n_strands for level in example.hierarchy.levels[1:]],
        "energy": [finest.energies[0], finest.energies[-1]],
        "largest_error": float(finest.errors.max()),
        "iterations": len(finest.energies),
        "out": str(options.out),
    }


def _synthesize(options: argparse.Namespace, clock: StageClock, progress: Progress) -> Report:
    clock("read")
    strands = _strands(options)
    head = _head(options, strands)
    params = _synthesis_params(options)
    region = _region(options.region, head)
    clock("cluster")
    example = analyze(strands, head, params)
    result = synthesize_from(example, head, params, region=region, progress=progress, timer=clock)
    clock("write")
    write_strands(options.out, result.strands, units=_units(options.out_units))
    report: Report = {
        "strands": result.strands.n_strands,
        "levels": [level.n_strands for level in result.levels],
        "out": str(options.out),
        "refinement": [asdict(r) for r in result.refine_reports],
    }
    if options.compare:
        clock("compare")
        report["style"] = asdict(compare_styles(example.hierarchy.levels[0], result.levels[0], seed=options.seed))
    return report


def _detail(options: argparse.Namespace, clock: StageClock, progress: Progress) -> Report:
    clock("read")
    strands = _strands(options)
    head = _head(options, strands)
    clock("cluster")
    hierarchy = analyze(strands, head, _synthesis_params(options), progress=progress).hierarchy
    clock("write")
    small = reduce_details(hierarchy, options.strands) if options.strands > 0 else hierarchy
    write_detail(options.out, Detail(options.name or Path(options.hair).stem, small))
    return {"levels": [level.n_strands for level in small.levels], "out": str(options.out)}


def _details_of(options: argparse.Namespace, params: SynthesisParams, clock: StageClock) -> WispHierarchy:
    """The hierarchy of the detail hairstyle: a saved one, or that of a groom."""
    if holds_detail(options.detail):
        return read_detail(options.detail).hierarchy
    strands, head = _groom(options.detail, options.head_detail, options.units_detail)
    clock("cluster detail")
    return analyze(strands, head, params).hierarchy


def _transfer(options: argparse.Namespace, clock: StageClock, progress: Progress) -> Report:
    settings = DetailParams(
        levels=tuple(options.take), strength=options.strength, smoothing=options.smoothing,
        length_mode=options.length_mode, seed=options.seed,
    )  # fmt: skip
    params = _synthesis_params(options)
    clock("read")
    detail = _details_of(options, params, clock)
    clock("read")
    strands, head = _groom(options.base, options.head_base, options.units_base)
    clock("cluster base")
    base = analyze(strands, head, fitting(params, detail))
    clock("transfer")
    result = transfer_style(detail, base.hierarchy, settings, progress=progress)
    clock("write")
    made = as_strand_set(result.strands, base.space, strands)
    write_strands(options.out, made, units=_units(options.out_units))
    clock("compare")
    return transfer_report(detail, base.hierarchy, result, settings) | {"out": str(options.out)}


def _comb(options: argparse.Namespace, clock: StageClock, progress: Progress) -> Report:
    clock("read")
    strands = _strands(options)
    file = read_strokes(options.strokes)
    file.check(strands.n_strands, len(strands.points), str(options.strokes))
    head = _head(options, strands)
    others = [read_head(path, _units(options.head_units or options.units)) for path in options.collider]
    labels = wisp_labels(strands)
    if not labels:
        clock("cluster")
        labels = labels_of_strands(analyze(strands, head, _synthesis_params(options)).hierarchy)
    clock("collider")
    collider = comb_collider([head, *others], strands.roots) if options.collide else None
    clock("comb")
    combed = comb(strands, labels, file.strokes, collider, progress=progress)
    clock("write")
    write_strands(options.out, combed, units=_units(options.out_units))
    moved = np.abs(combed.points - strands.points).max(axis=1) > 0
    return {
        "strokes": len(file.strokes),
        "moved_strands": int(np.add.reduceat(moved, strands.offsets[:-1]).astype(np.bool_).sum()),
        "wisps": [int(level.max()) + 1 for level in labels],
        "out": str(options.out),
    }


def _bench(options: argparse.Namespace, clock: StageClock, progress: Progress) -> Report:
    from .bench import run_benchmarks  # loads the peers, which only this command needs

    return run_benchmarks(options.job, quick=options.quick, out=options.out)


def _warm_up(options: argparse.Namespace, clock: StageClock, progress: Progress) -> Report:
    from .warm_up import compile_all  # loads every kernel, which only this command needs

    clock("compile")
    return {"kernels": compile_all(progress)}


def _add_head(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--head", help="head mesh, .obj; the scalp is found from the roots (default: Hairloom's head)")
    parser.add_argument("--head-units", help="units of the head file if they differ from --units")


def _add_wisps(parser: argparse.ArgumentParser, levels_option: str = "--levels") -> None:
    defaults = SynthesisParams()
    wisps = defaults.hierarchy.wisps
    parser.add_argument(
        levels_option, dest="levels", type=int, default=defaults.hierarchy.n_levels, help="levels of the hierarchy"
    )
    parser.add_argument(
        "--epsilon", type=float, default=wisps.error_threshold, help="fitting error, head radii squared"
    )
    parser.add_argument("--k0", type=int, default=wisps.n_wisps, help="initial number of wisps")
    parser.add_argument("--seed", type=int, default=0, help="random seed")


def _add_transfer(parser: argparse.ArgumentParser) -> None:
    defaults = DetailParams()
    parser.add_argument("detail", type=Path, help="groom to take the details from, or a saved detail .npz")
    parser.add_argument("base", type=Path, help="groom that keeps its shape and takes the details")
    for side in ("detail", "base"):
        parser.add_argument(f"--head-{side}", help=f"head of the {side} groom, .obj (default: Hairloom's head)")
        parser.add_argument(f"--units-{side}", help=f"units of the {side} groom and its head")
    parser.add_argument(
        "--levels", dest="take", type=int, nargs="*", default=defaults.levels, help="finer levels to take; 0: the hair"
    )
    parser.add_argument("--strength", type=float, default=defaults.strength, help="0 nothing, 1 all, to 2 exaggerated")
    parser.add_argument(
        "--smoothing", type=float, default=defaults.smoothing, help="of the detail's coarsest level, 0..1"
    )
    parser.add_argument(
        "--length-mode", choices=LENGTH_MODES, default=defaults.length_mode, help="details on hair of other lengths"
    )


def build_parser() -> argparse.ArgumentParser:
    """The argument parser of the command line."""
    parser = argparse.ArgumentParser(prog="hairloom", description="Hair modelling from examples.")
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--json", action="store_true", help="print one JSON object with results, seconds and memory")
    hair = argparse.ArgumentParser(add_help=False)
    hair.add_argument("hair", type=Path, help=".hair .data .tfx .ply .obj .npz")
    hair.add_argument("--units", help="units and up axis of the file, such as 'cm,y-up' (default: the format's own)")
    commands = parser.add_subparsers(dest="command", required=True)

    def command(name: str, run: Callable[..., Report], text: str, *parents: Any) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text, parents=[common, *parents])
        sub.set_defaults(run=run)
        return sub

    command("info", _info, "Say what a groom file holds.", hair)
    convert = command("convert", _convert, "Convert a groom file; formats by suffix.", hair)
    cluster = command("cluster", _cluster, "Find the wisp hierarchy of a groom.", hair)
    synthesize = command("synthesize", _synthesize, "Make a new hairstyle like an example.", hair)
    combing = command("comb", _comb, "Play strokes of the comb on a groom.", hair)
    combing.add_argument("strokes", type=Path, help="strokes file, .json, as the comb tool saves it")
    combing.add_argument("--collider", action="append", default=[], help="another mesh that hair is kept out of, .obj")
    combing.add_argument("--no-collide", dest="collide", action="store_false", help="let hair pass through the head")
    detail = command("detail", _detail, "Save the details of a groom, for transfer.", hair)
    transfer = command("transfer", _transfer, "Put the details of one groom onto another.")
    _add_transfer(transfer)
    _add_wisps(transfer, "--hierarchy-levels")
    for sub in (cluster, synthesize, combing, detail):
        _add_head(sub)
        _add_wisps(sub)
    for sub in (convert, cluster, synthesize, combing, detail, transfer):
        sub.add_argument("out", type=Path, help="the file to write")
    for sub in (convert, synthesize, combing, transfer):
        sub.add_argument("--out-units", help="units and up axis of the output (default: the format's own)")
    synthesize.add_argument("--strands", type=int, default=0, help="strands of the result (default: same density)")
    synthesize.add_argument("--region", help=".npz with 'mask' or 'triangles' of the head where hair grows")
    synthesize.add_argument("--compare", action="store_true", help="report how alike and how new the result is")
    detail.add_argument("--strands", type=int, default=SMALL, help="strands a level; 0 keeps all")
    detail.add_argument("--name", help="name of the detail (default: that of the file)")
    add_rod_commands(command, hair)
    add_photo_commands(command)
    bench = command("bench", _bench, "Measure the jobs beside their peers.")
    bench.add_argument("job", nargs="?", help="one job only")
    bench.add_argument("--quick", action="store_true", help="small sizes only, no peers")
    bench.add_argument("--out", type=Path, help="Markdown file to write the table to")
    command("warm-up", _warm_up, "Compile all kernels into the cache.")
    return parser


def _print_report(report: Report, as_json: bool) -> None:
    if as_json:
        print(json.dumps(report))
        return
    for key, value in report.items():
        print(f"{key.replace('_', ' ')}: {value if isinstance(value, str) else json.dumps(value)}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    options = build_parser().parse_args(arguments)
    clock = StageClock()
    progress, close = _progress_bar(options)
    try:
        report = options.run(options, clock, progress)
    except (HairloomError, MemoryError) as error:
        close()
        message = str(error) or "not enough memory; use fewer strands or a coarser grid"
        print(f"hairloom: {' '.join(message.split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        close()
        print("hairloom: cancelled", file=sys.stderr)
        return 130
    close()
    clock("")
    report["seconds"] = {stage: round(seconds, 4) for stage, seconds in clock.seconds.items()}
    report["peak_memory_mb"] = round(peak_memory_bytes() / 2**20)
    _print_report(report, options.json)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
