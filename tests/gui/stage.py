"""The scene that the sessions start from: a head with a small groom, the sidebar open at our tab."""

from __future__ import annotations

import bpy
import driver
import scenes

N_STRANDS = 1500  # what software drawing can keep up with


def set_the_scene(user: driver.User) -> driver.Steps:
    """Our head with a small groom, seen from the front at an angle, the sidebar open at our tab."""
    with user.override():
        bpy.ops.object.select_all(action="SELECT")
        bpy.ops.object.delete()
        make_groom()
        space = user.area().spaces.active
        space.show_region_ui = True
        space.overlay.show_floor = False
        space.overlay.show_cursor = False
        bpy.ops.view3d.view_selected()
        bpy.context.object.select_set(False)  # its outline would hide it; it stays the active object
        bpy.ops.ed.undo_push(message="Set the scene")  # what scripts call leaves no undo step
    yield 1.0
    user.region("UI").active_panel_category = "Hairloom"
    yield 1.0
    assert user.region("UI").active_panel_category == "Hairloom"


def make_groom() -> None:
    """A thinned starter groom on our head; without starter grooms the tests' ball and waves."""
    assets = scenes.module("assets")
    names = [name for name, _ in assets.starter_grooms()]
    if not names:
        scenes.groom_on_head()
        return
    bpy.ops.hairloom.add_starter_groom(groom="Wavy" if "Wavy" in names else names[0])
    hair = bpy.context.object
    curves, strands = scenes.module("bridge.curves"), scenes.module("backend.geometry.strands")
    whole = curves.read_strands(hair)
    step = max(1, whole.n_strands // N_STRANDS)
    curves.replace_strands(hair, strands.select_strands(whole, list(range(0, whole.n_strands, step))))
    bpy.context.scene.hairloom.synthesis.hierarchy.wisps.n_wisps = 60
