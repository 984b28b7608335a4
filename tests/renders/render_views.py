"""Photos of known hair to test the four-view method with: `python tests/renders/render_views.py OUT [GROOM ...]`.

Each groom gets a folder OUT/GROOM with front.png, back.png, left.png, right.png (RGB), the hair masks that a person
would draw, front_mask.png ..., and cameras.npz (a bundle of `cameras`, by view, and `head`: what the method may see);
truth.npz (a bundle of `strands`, `head`, `cameras`) is for the judges alone. The starter grooms share head and cameras:
for mixed sources take each view from the folder of another groom.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from grooms import NAMES, ROOT, STARTER_STRANDS, VIEWS, Groom, load_groom
from hairloom.errors import FileError, HairloomError
from hairloom.geometry.strand_raster import marked_region, scalp_pixels
from hairloom.io.bundle import write_bundle
from hairloom.types import Bools, Float32
from quick_photo import draw_view

PLAIN = "0.86,0.87,0.88"  # sRGB, light


def render_groom(groom: Groom, folder: Path, arguments: argparse.Namespace) -> None:
    """Write the pictures, masks, cameras and the truth of one groom into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    write_bundle(folder / "cameras.npz", {"cameras": groom.cameras, "head": groom.head})
    write_bundle(folder / "truth.npz", {"strands": groom.strands, "head": groom.head, "cameras": groom.cameras})
    melanin = groom.melanin if arguments.melanin is None else arguments.melanin
    redness = groom.redness if arguments.redness is None else arguments.redness
    if not arguments.quick:
        import photo_scene  # Blender is only needed here

        scene = photo_scene.make_scene(groom, arguments.samples, melanin, redness, arguments.principled)
    rng = np.random.default_rng(arguments.seed)
    for view, camera in groom.cameras.items():
        start = time.perf_counter()
        if arguments.quick:
            rendered, coverage = draw_view(groom, camera, melanin)
        else:
            rendered, coverage = photo_scene.render_view(scene, camera), photo_scene.render_coverage(scene, camera)
        shot = photo(rendered, arguments.background, arguments.blur, arguments.noise, rng)
        cv2.imwrite(str(folder / f"{view}.png"), shot[..., ::-1])
        scalp = scalp_pixels(camera, groom.head)
        mask = without_windows(marked_region(coverage, scalp), scalp)
        cv2.imwrite(str(folder / f"{view}_mask.png"), mask.astype(np.uint8) * 255)
        print(f"{folder.name}/{view}: {time.perf_counter() - start:.1f} s, {mask.mean():.1%} hair", flush=True)


def without_windows(mask: Bools, scalp: Bools) -> Bools:
    """The mask (H, W) without holes that hair surrounds and that show scalp alone: thin hair, which a person marks."""
    _, labels = cv2.connectedComponents((~mask).astype(np.uint8), connectivity=4)
    bare = np.bincount(labels.ravel(), (~scalp).ravel())
    outside = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    filled = bare == 0
    filled[outside] = False
    return np.asarray(mask | filled[labels])


def photo(rendered: Float32, background: str, blur: float, noise: float, rng: np.random.Generator) -> np.ndarray:
    """(H, W, 3) uint8 sRGB: a rendered picture (H, W, 4) before a background, blurred and with noise.

    background : an image file, which is scaled to the picture, or a colour "r,g,b" in [0, 1].
    blur : standard deviation, pixels. noise : standard deviation, steps of 255.
    """
    height, width = rendered.shape[:2]
    try:
        behind = np.broadcast_to(np.array([float(part) for part in background.split(",")]), (height, width, 3))
    except ValueError:
        image = cv2.imread(background, cv2.IMREAD_COLOR)
        if image is None:
            raise FileError(f"{background}: neither an image that can be read nor a colour like 0.9,0.9,0.9") from None
        behind = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)[..., ::-1] / 255.0
    shot = (rendered[..., :3] * rendered[..., 3:] + behind * (1.0 - rendered[..., 3:])) * 255.0
    if blur > 0:
        shot = cv2.GaussianBlur(shot, (0, 0), blur)
    if noise > 0:
        shot = shot + rng.normal(0.0, noise, shot.shape)
    return np.asarray(np.clip(np.rint(shot), 0, 255), np.uint8)


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="folder that gets a folder for each groom")
    parser.add_argument(
        "grooms", nargs="*", default=NAMES, metavar="GROOM", help=f"of {', '.join(NAMES)}; default: all"
    )
    parser.add_argument("--data", type=Path, default=os.environ.get("HAIRLOOM_DATA", ROOT.parent / "shared" / "data"))
    parser.add_argument("--views", nargs="+", default=VIEWS, choices=(*VIEWS, "top"))
    parser.add_argument("--size", type=int, default=800, help="pixels")
    parser.add_argument("--samples", type=int, default=12, help="a pixel")
    parser.add_argument("--principled", action="store_true", help="Principled Hair; slow, take 100 samples or more")
    parser.add_argument("--quick", action="store_true", help="simple light instead of Cycles: a second a picture")
    parser.add_argument("--strands", type=int, default=STARTER_STRANDS, help="of a starter groom")
    parser.add_argument("--seed", type=int, default=0, help="of a starter groom's growth, and of the noise")
    parser.add_argument("--background", default=PLAIN, help="an image file, or a colour r,g,b in [0, 1]")
    parser.add_argument("--blur", type=float, default=0.0, help="standard deviation, pixels")
    parser.add_argument("--noise", type=float, default=0.0, help="standard deviation, steps of 255")
    parser.add_argument("--melanin", type=float, help="0 white .. 1 black; default: the groom's own")
    parser.add_argument("--redness", type=float, help="0 .. 1; default: the groom's own")
    return parser.parse_intermixed_args(argv)


def main(argv: Sequence[str] | None = None) -> int:
    arguments = parse(argv)
    for name in arguments.grooms:
        try:
            groom = load_groom(
                name,
                Path(arguments.data),
                arguments.size,
                n_strands=arguments.strands,
                seed=arguments.seed,
                views=tuple(arguments.views),
            )
            render_groom(groom, arguments.out / name, arguments)
        except HairloomError as error:
            print(f"error: {error}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pip's bpy may hang at interpreter exit
