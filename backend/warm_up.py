"""Compile every kernel once, so that the first real job does not wait (the compiled code is cached on disk)."""

from __future__ import annotations

import numpy as np

from .editing.comb import comb
from .editing.flow import FlowSession, extract_flow
from .editing.object_space import return_to_object
from .editing.strokes import MODES, CombParams, Stroke, View
from .fields.grid import dense_grid
from .fourview.appearance import strand_colours
from .fourview.database import HairDatabase
from .fourview.database_entries import entry_head, make_hairstyle
from .fourview.deformation import DeformationParams
from .fourview.detail import add_detail
from .fourview.directions import DirectionParams, find_directions
from .fourview.filling import grow_strands
from .fourview.growth import GrowthParams
from .fourview.patch_match import fill_hole
from .fourview.poisson import PoissonSolver, blend_views
from .fourview.projection import initial_texture, project_views
from .fourview.remeshing import cluster_evenly
from .fourview.shape import RoughShape, ShapeParams, find_shape
from .fourview.surface import SurfaceParams, make_surface
from .fourview.texture import SurfaceTextureParams, synthesize_texture
from .fourview.views import DirectionStroke
from .fourview.views import View as Photo
from .fourview.volume import direction_volume
from .geometry.camera import standard_camera
from .geometry.cleanup import clean_up
from .geometry.collider import comb_collider
from .geometry.head import default_head, submesh
from .geometry.roots import scatter_roots
from .geometry.scalp_space import fit_scalp_space, unroot_strands
from .geometry.strand_raster import hair_mask
from .geometry.strand_scores import strand_scores
from .geometry.strands import select_strands
from .kernels import KERNELS
from .progress import NO_PROGRESS, Progress, subrange
from .rods.contacts import ContactParams, ContactSolver, Solid, find_contacts
from .rods.dynamics import Stepper
from .rods.energies import generalised_force
from .rods.equilibrium import find_rest_shape
from .rods.fitting import FitParams, fit_helices
from .rods.guides import choose_guides
from .rods.helices import Helices, evaluate
from .rods.interpolation import FollowerParams, bind_followers, interpolate, keep_out, rest_depths
from .rods.material import MaterialParams
from .rods.model import initial_state, make_rods
from .rods.training import train_followers
from .synthesis.detail_transfer import transfer_style
from .synthesis.details import reduce_details
from .synthesis.hierarchy import HierarchyParams
from .synthesis.pipeline import SynthesisParams, analyze, place_roots, synthesize
from .synthesis.wisps import WispParams
from .types import Head, Mesh, StrandSet


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
    hierarchy = analyze(strands, head, params).hierarchy
    transfer_style(reduce_details(hierarchy, 8), hierarchy)
    flow, binding = extract_flow(strands, np.zeros(strands.n_strands, np.int32))
    session = FlowSession(strands, binding)
    session.update(flow)
    session.marks()
    progress(0.97, "Compiling: rods")
    helices = fit_helices(strands, FitParams(polish=1)).helices
    evaluate(helices, 2)
    _step_rods(helices)
    _rest_on_head(helices, strands, head)
    progress(0.98, "Compiling: comb")
    _comb_in_all_modes(strands, head)
    progress(0.99, "Compiling: followers")
    _follow(strands, head)
    _keep_hairstyle(strands, head)
    _look(strands, head)
    _lay_texture(strands, head)
    _grow_and_colour(strands, head)
    _shape(strands, head)
    return sum(bool(kernel.dispatcher.signatures) for kernel in KERNELS)


def _step_rods(helices: Helices) -> None:
    """A time step with an impulse at every rod's first element, and the forces of the weight."""
    rods, state = make_rods(helices, MaterialParams()), initial_state(helices)
    gravity, stepper = np.array([0.0, 0.0, -9.81]), Stepper(rods)
    stepper.begin(state, state.roots, state.frames, 0.01, gravity, np.zeros_like(rods.rest))
    offsets, elements = np.arange(rods.n_strands + 1), rods.offsets[:-1].copy()
    arcs = rods.lengths[elements]
    stepper.points(elements, arcs)
    stepper.delassus(offsets, elements, arcs)
    stepper.apply(offsets, elements, arcs, stepper.free_velocities(elements, arcs) * 0.0)
    stepper.end(state)
    stepper.energies()
    generalised_force(rods, state.roots, state.frames, state.curvatures, gravity)


def _rest_on_head(helices: Helices, strands: StrandSet, head: Head) -> None:
    """The rest shape of rods thick enough to touch the head and each other, and a step in contact from there."""
    rods, state = make_rods(helices, MaterialParams(), radius=0.02), initial_state(helices)
    solids = [Solid(comb_collider([head], strands.roots), np.eye(4), np.eye(4))]
    params, gravity = ContactParams(self_contact=True), np.array([0.0, 0.0, -9.81])
    contacts = find_contacts(rods, params, helices, solids)
    found = find_rest_shape(rods, helices, gravity, contacts)
    stepper = Stepper(found.rods)
    solver = ContactSolver(found.rods, params, stepper)
    solver.set_rest(state.roots, state.frames, state.curvatures, solids)
    solver.set_static(contacts, found.forces)
    stepper.begin(state, state.roots, state.frames, 0.01, gravity, np.zeros_like(rods.rest))
    solver.solve(solids, 0.01)
    stepper.end(state)


def _comb_in_all_modes(strands: StrandSet, head: Head) -> None:
    """A stroke of each mode over the middle of the hair, seen from the front, with and without the head."""
    low, high = strands.points.min(axis=0), strands.points.max(axis=0)
    matrix = np.eye(4)[[0, 2, 1, 3]] / float((high - low).max())
    matrix[:3, 3] = -matrix[:3, :3] @ ((low + high) / 2)
    matrix[3, 3] = 1.0
    samples = np.array([[40.0, 50.0, 1.0], [60.0, 55.0, 1.0], [70.0, 60.0, 1.0]])
    view, frame, selection = View(matrix, 100.0, 100.0), np.eye(4), np.ones(strands.n_strands, np.float32)
    strokes = [Stroke(CombParams(mode=mode, radius=60.0), view, frame, samples, selection) for mode in MODES]
    wisps = [np.arange(strands.n_strands, dtype=np.int32) // 4]
    for collider in (None, comb_collider([head], strands.roots)):
        combed = comb(strands, wisps, strokes, collider)
    return_to_object(combed.points, strands.points, strands.points, frame)


def _follow(strands: StrandSet, head: Head) -> None:
    """All hair after a fourth of it, with trained weights, on roots that move, kept out of the head."""
    guides, wisps = choose_guides(strands, np.arange(strands.n_strands, dtype=np.int32) // 4)
    helices = fit_helices(select_strands(strands, guides)).helices
    params = FollowerParams(training_strands=4, training_frames=2)
    followers = bind_followers(strands, helices, params, guides=guides, wisps=wisps)
    followers = train_followers(followers, strands, helices, MaterialParams(), params)
    # the head half a centimetre further than the hair
    solid = Solid(comb_collider([head], strands.roots), np.eye(4), np.eye(4), 0.0)
    solid.matrix[2, 3] = 0.005
    points = np.empty_like(strands.points)
    interpolate(followers, *evaluate(helices, params.n_samples), points, roots=np.eye(4)[None, :3])
    keep_out(followers, points, [solid], rest_depths(followers, [solid]))


def _keep_hairstyle(strands: StrandSet, head: Head) -> None:
    """A hairstyle of the database, its masks rendered, and back on the head."""
    HairDatabase((make_hairstyle("one", strands, entry_head(head)),)).strands(0, head)


def _look(strands: StrandSet, head: Head) -> None:
    """Strands before the head in a view, and their scores."""
    hair_mask(standard_camera("back", head.vertices.mean(axis=0), 200.0, (64, 64)), strands, head)
    strand_scores(strands, strands)


def _lay_texture(strands: StrandSet, head: Head) -> None:
    """Atlas, texels and patches on the scalp, one photo on them with a hole, blended and solved; its directions."""
    scalp = submesh(head, head.scalp)
    mesh = Mesh(scalp.vertices, scalp.triangles)
    surface = make_surface(mesh, SurfaceParams(64, 1, atlas_vertices=100, subdivisions=0))
    texels = surface.levels[0].texels
    camera = standard_camera("back", scalp.vertices.mean(axis=0), 200.0, (64, 64))
    photo = Photo("back", np.zeros((64, 64, 3), np.uint8), np.ones((64, 64), np.bool_), camera)
    seen = project_views(texels, [photo], mesh)
    colours = initial_texture(texels, seen, [photo])
    blended, gradients = blend_views(colours[None], seen.alpha, texels.edges)
    PoissonSolver(texels.edges, texels.n_texels).solve(blended, gradients)
    texture = synthesize_texture(surface, mesh, [photo], SurfaceTextureParams(iterations=(1,)))
    shape = RoughShape(Mesh(head.vertices, head.triangles), mesh, strands, "", np.ones(1))
    stroke = DirectionStroke(camera, np.array([[32.0, 20.0], [32.0, 30.0]]))
    directions = find_directions(texture, surface, shape, [photo], head, [stroke])
    direction_volume(directions, shape, head, DirectionParams(cells=16))
    gap = np.zeros((64, 64), np.bool_)
    gap[30:34, 30:34] = True
    fill_hole(np.zeros((64, 64, 3), np.uint8), gap)
    # a cluster in two parts
    cluster_evenly(np.eye(4, 3), np.ones(4), np.array([[0, 1], [2, 3]], np.int32), 1)


def _grow_and_colour(strands: StrandSet, head: Head) -> None:
    """A few strands in a shape one tenth larger than the head, with detail, in one photo's mask and colours."""
    middle = head.vertices.mean(axis=0)
    scalp = submesh(head, head.scalp)
    closed = Mesh(middle + np.float32(1.1) * (head.vertices - middle), head.triangles)
    outer = Mesh(middle + np.float32(1.1) * (scalp.vertices - middle), scalp.triangles)
    shape = RoughShape(closed, outer, strands, "", np.ones(1))
    low = closed.vertices.min(axis=0)
    down = dense_grid(np.full((8, 8, 8, 3), [0.0, 0.0, -1.0], np.float32), low, float(np.ptp(closed.vertices)) / 8)
    camera = standard_camera("back", middle, 200.0, (64, 64))
    photo = Photo("back", np.zeros((64, 64, 3), np.uint8), np.ones((64, 64), np.bool_), camera)
    grown = grow_strands(down, shape, [photo], head, GrowthParams(n_guides=16, n_strands=32, n_points=8))
    strand_colours(add_detail(grown, down), [photo], head)


def _shape(strands: StrandSet, head: Head) -> None:
    """The rough shape of a few strands in one small photo."""
    camera = standard_camera("back", head.vertices.mean(axis=0), 200.0, (64, 64))
    mask = np.zeros((64, 64), np.bool_)
    mask[8:40, 16:48] = True
    photo = Photo("back", np.zeros((64, 64, 3), np.uint8), mask, camera)
    deformation = DeformationParams(rounds=1, outline_points=16)
    find_shape(strands, "", [photo], head, ShapeParams(resolution=32, growth_rounds=1, deformation=deformation))
