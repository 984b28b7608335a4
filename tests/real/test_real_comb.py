"""Twenty strokes on the real groom sintel: lengths, roots and head after each."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from comb_quality import composed_labels, drag, kept, look
from hairloom.editing.comb import CombSession, comb
from hairloom.editing.strokes import CombParams, Stroke, View
from hairloom.geometry.cleanup import clean_up
from hairloom.geometry.collider import build_collider
from hairloom.geometry.head import HeadSurface, find_scalp, read_head
from hairloom.geometry.strands import select_strands, strand_lengths
from hairloom.io.strands import read_strands
from hairloom.io.units import Units
from hairloom.synthesis.pipeline import analyze
from hairloom.types import Float32, Head, Int32, StrandSet

UNITS = Units.parse("m,y-up")
N_STRANDS = 1500
# four strokes from each side: mode, where the hair's box the brush starts (share from left and from below), way in px
STROKES = {
    "front": (
        ("comb", (0.35, 0.8), (-70, -60)), ("comb", (0.65, 0.8), (60, -70)), ("smooth", (0.2, 0.6), (-20, -90)),
        ("lift", (0.5, 0.9), (0, 25)),
    ),
    "right": (
        ("comb", (0.3, 0.65), (120, -30)), ("comb", (0.4, 0.8), (110, -40)), ("smooth", (0.6, 0.6), (40, -110)),
        ("lift", (0.6, 0.85), (20, 15)),
    ),
    "back": (
        ("comb", (0.4, 0.65), (-40, -110)), ("comb", (0.6, 0.65), (40, -110)), ("twist", (0.5, 0.35), (40, 0)),
        ("length", (0.5, 0.15), (0, 20)),
    ),
    "left": (
        ("comb", (0.7, 0.65), (-120, -30)), ("comb", (0.6, 0.8), (-110, -40)), ("smooth", (0.4, 0.6), (-40, -110)),
        ("lift", (0.4, 0.85), (-20, 15)),
    ),
    "above": (
        ("comb", (0.4, 0.5), (-30, 70)), ("comb", (0.6, 0.5), (30, 70)), ("smooth", (0.5, 0.5), (0, 60)),
        ("twist", (0.5, 0.6), (30, 0)),
    ),
}  # fmt: skip
EYES = {"front": (0, -1, 0), "right": (1, 0, 0), "back": (0, 1, 0), "left": (-1, 0, 0), "above": (0, -0.3, 1)}


@pytest.fixture(scope="module")
def sintel(data_dir: Path) -> tuple[StrandSet, Head, tuple[Int32, ...]]:
    hair = read_strands(data_dir / "sintel" / "hair.tfx", units=UNITS)
    thinned = select_strands(hair, np.arange(0, hair.n_strands, max(1, hair.n_strands // N_STRANDS)))
    head = find_scalp(read_head(data_dir / "sintel" / "head.obj", UNITS), thinned.roots)
    strands = clean_up(thinned, head)[0]
    return strands, head, composed_labels(analyze(strands, head).hierarchy)


def strokes(points: Float32, size: float) -> Iterator[Stroke]:
    """The twenty strokes, seen from 4 `size` away; the places are those of the groom before the first one."""
    low, high = np.percentile(points, [2, 98], axis=0)
    middle = (low + high) / 2.0
    for name, of_side in STROKES.items():
        eye = np.array(EYES[name], float)
        view = look(middle + 4.0 * size * eye / np.linalg.norm(eye), middle)
        picture = on_picture(view, points)
        for mode, (across, up), way in of_side:
            place = np.percentile(picture, [2, 98], axis=0)
            first = place[0] + (place[1] - place[0]) * [across, up]
            samples = drag(view, middle, way, 8)
            samples[:, :2] += first - samples[0, :2]
            yield Stroke(CombParams(mode=mode, radius=50.0), view, np.eye(4), samples)


def on_picture(view: View, points: Float32) -> np.ndarray:
    clip = points @ view.matrix[:, :3].T + view.matrix[:, 3]
    return (clip[:, :2] / clip[:, 3:] + 1.0) / 2.0 * [view.width, view.height]


def test_twenty_strokes_keep_lengths_roots_and_head(sintel: tuple[StrandSet, Head, tuple[Int32, ...]]) -> None:
    strands, head, labels = sintel
    surface, collider = HeadSurface(head), build_collider([head])
    session = CombSession(strands, labels, collider)
    size = float(strand_lengths(strands).max())
    played = []
    for number, stroke in enumerate(strokes(strands.points, size)):
        before = StrandSet(session.points.copy(), strands.offsets)
        session.play(stroke)
        played.append(stroke)
        result = kept(before, session.points, surface)
        name = f"stroke {number + 1}, {stroke.params.mode}: {result}"
        assert result.moved > 0, name
        assert result.root_error == 0.0, name
        assert stroke.params.mode == "length" or result.length_error < 0.005, name
        assert result.deepest < 0.0005, name
    assert len(played) == 20
    assert np.isfinite(session.points).all()
    assert comb(strands, labels, played, collider).points.tobytes() == session.points.tobytes()
