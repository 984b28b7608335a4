"""The panels draw without errors in every state of the scene and show every setting."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import pytest
import scenes

ICONS = set(bpy.types.UILayout.bl_rna.functions["prop"].parameters["icon"].enum_items.keys())


class Layout:
    """A layout that notes what is drawn into it."""

    def __init__(self, drawn: list[tuple[str, str]]) -> None:
        self.__dict__["drawn"] = drawn

    def __setattr__(self, name, value):
        pass  # scale_y, enabled, use_property_split, ...

    def _inside(self, *_, **__):
        return Layout(self.drawn)

    row = column = box = split = _inside

    def separator(self, *_, **__):
        pass

    def label(self, text="", icon="NONE"):
        assert icon in ICONS, icon
        self.drawn.append(("label", text))

    def prop(self, group, name, icon="NONE", **_):
        assert icon in ICONS, icon
        assert name in group.bl_rna.properties, name
        self.drawn.append(("prop", f"{type(group).__name__}.{name}"))

    def prop_search(self, group, name, holder, collection, **_):
        assert hasattr(holder, collection)
        self.prop(group, name)

    def operator(self, name, icon="NONE", **_):
        assert icon in ICONS, icon
        self.drawn.append(("operator", name))
        return SimpleNamespace()

    def operator_menu_enum(self, name, prop, **_):
        self.drawn.append(("operator", name))

    def template_icon_view(self, group, name, **_):
        self.prop(group, name)

    def progress(self, factor, text):
        assert 0 <= factor <= 1
        self.drawn.append(("progress", text))


def draw_all() -> list[tuple[str, str]]:
    drawn: list[tuple[str, str]] = []
    parts = scenes.module("ui")._PARTS
    found = {name: getattr(part, name) for part in parts for name in dir(part) if name.startswith("HAIRLOOM_PT_")}
    for panel in found.values():
        if not panel.bl_label.endswith("Presets"):
            stand_in = SimpleNamespace(layout=Layout(drawn))
            for method in (getattr(panel, "draw_header", None), panel.draw):
                if method is not None:
                    method(stand_in, bpy.context)
    return drawn


def test_every_setting_is_in_a_panel():
    scenes.groom_on_head()
    bpy.ops.hairloom.cluster_wisps()
    props = scenes.module("props")
    shown = {text for kind, text in draw_all() if kind == "prop"}
    for group in props.CLASSES:
        for rna in group.bl_rna.properties:
            if rna.identifier not in {"rna_type", "name"} and not (
                rna.type == "POINTER" and rna.fixed_type.identifier in {cls.__name__ for cls in props.CLASSES}
            ):
                assert f"{group.__name__}.{rna.identifier}" in shown


def test_an_empty_scene_says_what_to_do_first():
    labels = " ".join(text for kind, text in draw_all() if kind == "label")
    assert "Add a head, or select a mesh of yours" in labels
    assert "Select a groom (hair Curves)" in labels


def test_each_level_of_wisps_has_its_buttons():
    scenes.groom_on_head()
    before = draw_all()
    assert ("operator", "hairloom.show_wisps") not in before
    bpy.ops.hairloom.cluster_wisps()
    after = draw_all()
    assert after.count(("operator", "hairloom.show_wisps")) == 3  # hair, level 1, level 2
    assert after.count(("operator", "hairloom.extract_centers")) == 2


def test_the_file_menus_import_and_export():
    drawn: list[tuple[str, str]] = []
    menus = scenes.module("ui.menus")
    for draw in (menus._draw_import, menus._draw_export):
        draw(SimpleNamespace(layout=Layout(drawn)), bpy.context)
    assert drawn == [("operator", "hairloom.import_groom"), ("operator", "hairloom.export_groom")]


@pytest.mark.parametrize("label", ["Synthesize", "Cluster Wisps", "Extract Centers", "Clean Up"])
def test_a_running_job_shows_its_progress_and_a_way_to_cancel(label):
    scenes.groom_on_head()
    job = bpy.context.window_manager.hairloom_job
    job.is_running, job.label, job.message, job.fraction = True, label, "Working", 0.5
    try:
        drawn = draw_all()
    finally:
        job.clear()
    assert drawn.count(("progress", "Working  50%")) == 1
    assert drawn.count(("operator", "hairloom.cancel_job")) == 1
