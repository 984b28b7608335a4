"""Detail transfer between real grooms on different heads: sintel and ponytail."""

import numpy as np
import pytest
from hairloom.geometry.cleanup import clean_up
from hairloom.geometry.head import find_scalp, read_head
from hairloom.geometry.strands import join_strands, polyline_lengths
from hairloom.io.strands import read_strands
from hairloom.io.units import Units
from hairloom.jobs.transfer_details import transfer_report
from hairloom.synthesis.detail_statistics import compare_details
from hairloom.synthesis.detail_transfer import DetailParams, transfer_style
from hairloom.synthesis.details import Detail, read_detail, reduce_details, write_detail
from hairloom.synthesis.pipeline import analyze

UNITS = {"sintel": Units.parse("m,y-up"), "ponytail": Units(0.0035, "Y", "-Z")}
FILES = {"sintel": ("hair",), "ponytail": ("front_top", "side", "back", "tail")}


@pytest.fixture(scope="module")
def styles(data_dir):
    made = {}
    for name, units in UNITS.items():
        strands = join_strands([read_strands(data_dir / name / f"{part}.tfx", units=units) for part in FILES[name]])
        head = find_scalp(read_head(data_dir / name / "head.obj", units), strands.roots)
        made[name] = analyze(clean_up(strands, head)[0], head).hierarchy
    return made


def some(hair):
    return hair.points[:: max(1, hair.n_strands // 3000)]


@pytest.mark.parametrize("name", UNITS)
def test_a_groom_on_itself_is_itself(styles, name):
    hair = styles[name]
    result = transfer_style(hair, hair, DetailParams(smoothing=0.0))
    for made, own in zip(result.levels, hair.levels):
        # float32 through three levels of frames, strands of up to six head radii
        np.testing.assert_allclose(made.in_head_space(), own.in_head_space(), atol=5e-5)


@pytest.mark.parametrize("detail", UNITS)
def test_details_come_across_and_the_coarsest_level_stays(styles, detail):
    (base,) = set(UNITS) - {detail}
    source, target = styles[detail], styles[base]
    result = transfer_style(source, target)
    kept = result.levels[-1].points[:, :: result.subdivision]
    assert kept.tobytes() == target.levels[-1].points.tobytes()
    assert (result.strands.roots == target.levels[0].roots).all()
    report = transfer_report(source, target, result, DetailParams())
    assert report["distance_after"]["details"] < report["distance_before"]["details"]
    # nothing flies off
    lengths = polyline_lengths(result.strands.points)
    assert np.median(lengths) < 1.5 * np.median(polyline_lengths(target.levels[0].points))
    assert lengths.max() < 2 * max(polyline_lengths(style.levels[0].points).max() for style in styles.values())


def test_a_saved_detail_does_nearly_what_the_groom_does(styles, tmp_path):
    source, target = styles["sintel"], styles["ponytail"]
    path = tmp_path / "sintel.npz"
    write_detail(path, Detail("Sintel", reduce_details(source)))
    assert path.stat().st_size < 3e6
    full = transfer_style(source, target).strands
    small = transfer_style(read_detail(path).hierarchy, target).strands
    before = compare_details(some(source.levels[0]), some(target.levels[0]))["curvature"]
    assert compare_details(some(full), some(small))["curvature"] < 0.4 * before
