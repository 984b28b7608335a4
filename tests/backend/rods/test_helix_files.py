"""Files of helices: both precisions come back, small size, damaged files."""

import json

import numpy as np
import pytest
from hairloom.cli import main
from hairloom.errors import FileError
from hairloom.geometry.strands import from_dense
from hairloom.io.npz import write_arrays
from hairloom.io.strands import write_strands
from hairloom.rods.helices import Helices, evaluate
from hairloom.rods.helix_files import read_helices, write_helices
from scipy.spatial.transform import Rotation


def random_helices(n_strands=300, seed=0):
    random = np.random.default_rng(seed)
    counts = random.integers(1, 26, n_strands)
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    frames = Rotation.random(n_strands, random_state=seed).as_matrix()
    turns = [np.diag([1, -1, -1]), np.diag([-1, 1, -1]), np.diag([-1, -1, 1])]  # half turns
    frames[:3] = turns
    curvatures = random.normal(0, 60, (counts.sum(), 3))
    lengths = random.uniform(0.01, 0.03, counts.sum())
    return Helices(random.normal(0, 0.1, (n_strands, 3)), frames, offsets, lengths, curvatures)


def test_exact_files_come_back(tmp_path):
    helices = random_helices()
    write_helices(tmp_path / "a.npz", helices, exact=True)
    read = read_helices(tmp_path / "a.npz")
    for name in ("roots", "offsets", "lengths", "curvatures"):
        assert np.array_equal(getattr(read, name), getattr(helices, name)), name
    assert np.abs(read.frames - helices.frames).max() < 1e-15


def test_small_files_keep_the_shape_and_are_small(tmp_path):
    helices = random_helices()
    write_helices(tmp_path / "a.npz", helices)
    size = (tmp_path / "a.npz").stat().st_size
    assert size < 16 * len(helices.lengths) + 32 * helices.n_strands + 2000
    points, _ = evaluate(helices, 50)
    again, _ = evaluate(read_helices(tmp_path / "a.npz"), 50)
    # up to 75 cm that turn by 45 radians
    assert np.abs(points - again).max() < 2e-5
    write_helices(tmp_path / "b.npz", helices)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def arrays_of(helices):
    count = helices.n_strands
    return {
        "meta": np.array(json.dumps({"format": "hairloom-helices", "version": 1})),
        "roots": helices.roots,
        "rotations": np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)),
        "counts": helices.element_counts,
        "lengths": helices.lengths,
        "curvatures": helices.curvatures,
    }


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("meta", np.array('{"format": "other"}'), "no hairloom-helices of version 1"),
        ("meta", np.array("{}"), "no hairloom-helices"),
        ("lengths", None, "'lengths' is missing"),
        ("roots", np.zeros((3, 2)), "'roots' is missing or of the wrong"),
        ("counts", np.ones(3), "'counts' is missing or of the wrong"),
        ("counts", np.zeros(300, np.int32), "do not fit together"),
        ("counts", np.ones(300, np.int32), "do not fit together"),
        ("rotations", np.ones((300, 4)), "no unit quaternion"),
        ("rotations", np.full((300, 4), np.nan), "no unit quaternion"),
        ("lengths", -1.0, "longer than 0"),
        ("curvatures", np.nan, "NaN"),
    ],
)
def test_damaged_files_are_refused(tmp_path, name, change, words):
    arrays = arrays_of(random_helices())
    if change is None:
        del arrays[name]
    elif np.ndim(change) == 0 and not isinstance(change, np.ndarray):
        arrays[name] = np.full_like(arrays[name], change)
    else:
        arrays[name] = change
    with open(tmp_path / "a.npz", "wb") as stream:
        write_arrays(stream, arrays)
    with pytest.raises(FileError, match=words):
        read_helices(tmp_path / "a.npz")


def test_missing_and_cut_files_are_refused(tmp_path):
    with pytest.raises(FileError, match="cannot read"):
        read_helices(tmp_path / "none.npz")
    write_helices(tmp_path / "a.npz", random_helices(3))
    (tmp_path / "b.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:-100])
    with pytest.raises(FileError):
        read_helices(tmp_path / "b.npz")


def test_the_command_fits_a_groom_and_writes_it(tmp_path, capsys):
    u = np.linspace(0, 1, 30)
    points = np.stack([0.05 * u**2, 0.02 * np.sin(5 * u), -0.2 * u], 1) + np.zeros((7, 1, 1))
    write_strands(tmp_path / "hair.npz", from_dense(points))
    paths = [str(tmp_path / "hair.npz"), str(tmp_path / "out.npz")]
    assert main(["fit-helices", *paths, "--json", "--n-elements", "6"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["strands"] == 7
    assert report["elements_per_strand"] == [6, 6.0, 6]
    assert 0 < report["rms_m"] < report["maximum_m"] < 2e-3
    assert report["compression"] == 3.0
    helices = read_helices(paths[1])
    assert helices.n_strands == 7
    assert len(helices.lengths) == 42
    assert np.array_equal(helices.roots.astype(np.float32), points[:, 0].astype(np.float32))
    assert main(["fit-helices", *paths, "--n-max", "0"]) == 2
    assert "n_max is 0" in capsys.readouterr().err
    assert main(["fit-helices", str(tmp_path / "none.npz"), paths[1]]) == 2
