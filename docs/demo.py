"""What `python3 build_addon.py demo` runs: a new hairstyle from a starter groom, as .blend, strands and a picture."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "docs"), str(ROOT / "blend_templates")]

import bpy  # noqa: E402, I001  before the modules that it brings
from hairloom.io.strands import write_strands  # noqa: E402
from hairloom.synthesis.pipeline import SynthesisParams, analyze, synthesize_from  # noqa: E402
from hairloom.synthesis.statistics import compare_styles  # noqa: E402
from tqdm import tqdm  # noqa: E402

from make_grooms import add_groom, add_head, load_groom  # noqa: E402
from render import RenderParams, render_strands, side_by_side  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--style", default="wavy", help="starter groom to learn from")
    parser.add_argument("--strands", type=int, default=0, help="strands of the new hairstyle (default: as the example)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=ROOT / "demo")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with tqdm(total=100, bar_format="{desc:40} {bar} {n:3.0f}%") as bar:

        def progress(fraction: float, message: str, /) -> None:
            bar.set_description_str(message[:40])
            bar.n = round(100 * fraction)
            bar.refresh()

        progress(0.0, f"Loading the starter groom '{options.style}'")
        strands, head = load_groom(options.style)
        params = SynthesisParams(n_strands=options.strands, seed=options.seed)
        example = analyze(strands, head, params, progress=lambda f, m: progress(0.05 + 0.15 * f, m))
        result = synthesize_from(example, head, params, progress=lambda f, m: progress(0.2 + 0.2 * f, m))
        style = compare_styles(example.hierarchy.levels[0], result.levels[0], seed=options.seed)
        progress(0.4, "Writing the strands")
        write_strands(options.out / "new_hairstyle.npz", result.strands)
        write_strands(options.out / "new_hairstyle.hair", result.strands)
        pictures = []
        for step, (name, hair) in enumerate([("input", strands), ("output", result.strands)]):
            progress(0.45 + 0.25 * step, f"Rendering the {name}")
            pictures.append(render_strands(hair, head, options.out / f"{name}.png", RenderParams()))
        progress(0.95, "Writing the .blend")
        side_by_side(pictures, [f"input: {options.style}", "output"], options.out / "input_and_output.png")
        bpy.ops.wm.read_factory_settings(use_empty=True)
        for hair, name, place in ((strands, f"{options.style} (input)", -0.2), (result.strands, "new hairstyle", 0.2)):
            surface = add_head(head)
            add_groom(hair, surface, name)
            surface.location.x = place  # the groom is its child
        bpy.ops.wm.save_as_mainfile(filepath=str(options.out / "demo.blend"), compress=True)
        progress(1.0, "Done")
    print(f"New hairstyle of {result.strands.n_strands} strands from '{options.style}' ({strands.n_strands} strands).")
    print(
        f"Copied strands: {style.copied_share:.1%}. Distance of the statistics: {style.mean_distance:.2f} (0 is equal)."
    )
    for name in ("input_and_output.png", "demo.blend", "new_hairstyle.npz", "new_hairstyle.hair"):
        print(f"  {options.out / name}")
    return 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pip's bpy may hang at interpreter exit
