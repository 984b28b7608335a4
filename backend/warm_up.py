"""Compile every kernel once, so that the first real job does not wait (the compiled code is cached on disk)."""

from __future__ import annotations

import numpy as np

from .editing.flow import FlowSession, extract_flow
from .geometry.cleanup import clean_up
from .geometry.head import default_head
from .geometry.roots import scatter_roots
from .geometry.scalp_space import fit_scalp_space, unroot_strands
from .kernels import KERNELS
from .progress import NO_PROGRESS, Progress, subrange
from .synthesis.hierarchy import HierarchyParams
from .synthesis.pipeline import SynthesisParams, place_roots, synthesize
from .synthesis.wisps import WispParams


def compile_all(progress: Progress = NO_PROGRESS) -> int:
    """Run every job on a tiny groom of our own head; returns the number of kernels compiled.

    The kernels are compiled per argument types, and all jobs call them with the same types whatever the size.
    """
    progress(0.0, "Compiling: head")
    head = default_head()
    space = fit_scalp_space(head)
    rooted = place_roots(space, scatter_roots(head, head.scalp, 64, 0), 8)
    outward = np.zeros((64, 8, 3), np.float32)
    outward[:, :, 1] = np.linspace(0.0, 1.0, 8)
    # strands that differ, and a threshold below their differences: wisps are split too
    outward[:, :, 0] = np.linspace(0.2, 0.4, 64)[:, None] * outward[:, :, 1] ** 2
    strands, _ = clean_up(unroot_strands(rooted.with_points(outward), space), head)
    params = SynthesisParams(n_samples=8, hierarchy=HierarchyParams(wisps=WispParams(n_wisps=16, error_threshold=1e-4)))
    synthesize(strands, head, params, progress=subrange(progress, 0.2, 1.0))
    flow, binding = extract_flow(strands, np.zeros(strands.n_strands, np.int32))
    session = FlowSession(strands, binding)
    session.update(flow)
    session.marks()
    return sum(bool(kernel.dispatcher.signatures) for kernel in KERNELS)
