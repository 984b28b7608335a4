"""Feature map and texture optimisation on a real groom."""

from __future__ import annotations

import numpy as np
import pytest
from hairloom.geometry.head import find_scalp, read_head
from hairloom.geometry.scalp_space import fit_scalp_space, root_strands
from hairloom.io.strands import Units, read_strands
from hairloom.synthesis.features import feature_map, fit_features, sample_map
from hairloom.synthesis.texture import TextureParams, synthesize_texture


@pytest.fixture(scope="module")
def sintel(data_dir):
    strands = read_strands(data_dir / "sintel" / "hair.tfx", units=Units(1.0, "Y"))
    head = find_scalp(read_head(data_dir / "sintel" / "head.obj", Units(1.0, "Y")), strands.roots)
    return root_strands(strands, fit_scalp_space(head), 64)


def test_sixteen_features_hold_the_hair(sintel):
    basis = fit_features(sintel.points, 16)
    assert basis.retained > 0.999
    error = np.sqrt(((basis.decode(basis.encode(sintel.points)) - sintel.points) ** 2).sum(axis=2).mean())
    assert error < 0.01  # head radii: a millimetre


def test_the_map_holds_the_strands(sintel):
    basis = fit_features(sintel.points, 16)
    features = basis.encode(sintel.points)
    made = feature_map(sintel.uv, features)
    assert max(made.mask.shape) < 100 and made.mask.mean() > 0.5
    sampled = sample_map(made, sintel.uv)
    # a cell holds several strands, which differ (0.14 of what strands anywhere differ when this was written)
    near = np.median(np.linalg.norm(sampled - features, axis=1))
    far = np.median(np.linalg.norm(features - features[::-1], axis=1))
    assert near < 0.2 * far


def test_a_new_map_is_new_and_alike(sintel):
    basis = fit_features(sintel.points, 16)
    made = feature_map(sintel.uv, basis.encode(sintel.points))
    result = synthesize_texture(made, made.mask, TextureParams(layout_weight=0.3))
    rows, columns = np.nonzero(made.mask)
    source = result.source[rows, columns]
    moved = np.hypot(source[:, 0] - rows, source[:, 1] - columns) * made.spacing
    assert (moved > 2 * made.spacing).mean() > 0.5
    spread, own = result.map.values[made.mask].var(axis=0).sum(), made.values[made.mask].var(axis=0).sum()
    assert 0.4 < spread / own < 1.3
    again = synthesize_texture(made, made.mask, TextureParams(layout_weight=0.3))
    assert result.map.values.tobytes() == again.map.values.tobytes()
