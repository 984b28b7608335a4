"""The operators, one a file."""

from __future__ import annotations

import bpy

from . import (
    add_head,
    add_starter_groom,
    apply_detail,
    apply_flow,
    attach_to_head,
    bake_alembic,
    bake_playback,
    bake_usd,
    cancel_job,
    clean_up,
    cluster_wisps,
    comb,
    export_groom,
    export_unreal,
    extract_centers,
    extract_flow,
    extract_guides,
    fit_helices,
    four_view_add_images,
    four_view_border,
    four_view_photo,
    four_view_place,
    four_view_project,
    four_view_scribble,
    four_view_segment,
    four_view_stages,
    four_view_stroke,
    free_cache,
    import_groom,
    make_guides,
    play_strokes,
    resume_simulation,
    save_detail,
    save_strokes,
    select_guides,
    set_up_head,
    show_helices,
    show_wisps,
    simulate,
    synthesize,
    transfer_details,
    update_details,
    warm_up,
)

_MODULES = (
    add_head, set_up_head, import_groom, export_groom, add_starter_groom, attach_to_head, clean_up, cluster_wisps,
    show_wisps, extract_centers, extract_flow, apply_flow, synthesize, comb, play_strokes, save_strokes,
    transfer_details, update_details, save_detail, apply_detail, make_guides, select_guides, extract_guides,
    fit_helices, show_helices, simulate, resume_simulation, free_cache, bake_alembic, bake_usd,
    bake_playback, export_unreal, four_view_add_images, four_view_photo, four_view_segment, four_view_scribble,
    four_view_border,
    four_view_place, four_view_stages, four_view_stroke, four_view_project, cancel_job, warm_up,
)  # fmt: skip

register, unregister = bpy.utils.register_classes_factory([cls for module in _MODULES for cls in module.CLASSES])
