"""Save the active groom's details."""

from __future__ import annotations

import bpy

from .. import detail_library, details, lazy, scene
from ..jobs import JobOperator, Values


class HAIRLOOM_OT_save_detail(JobOperator, bpy.types.Operator):
    """Save the curls and wisps of the active groom, to be put onto other grooms later; they show in the asset browser
    as well"""

    bl_idname = "hairloom.save_detail"
    bl_label = "Save Detail"
    job = "save_detail"

    name: bpy.props.StringProperty(
        name="Name",
        description="Name of the detail; the one typed in the panel, or that of the groom, when empty",
        maxlen=60,
    )
    overwrite: bpy.props.BoolProperty(
        name="Overwrite", description="Replace a detail of yours that has this name", default=False
    )
    n_strands: bpy.props.IntProperty(
        name="Strands", description="Most strands that are kept; 2,400 make a file of 2 to 3 MB",
        default=2400, min=1, soft_min=200, soft_max=20_000, max=1_000_000,
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_busy(context) or details.why_no_base(context))

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        sources = details.base_and_head(context)
        name = self.name or details.new_name(context) or detail_library.proposed_name(sources["base"].name)
        self._place = detail_library.free_place(detail_library.checked_name(name), overwrite=self.overwrite)
        return sources

    def read(self, sources: dict[str, bpy.types.Object]) -> Values:
        hierarchies = lazy.bridge("hierarchies")
        analysis = details.analysis_params(bpy.context)
        self._groom = hierarchies.read_groom(sources["base"], sources["base_head"], analysis)
        kept = hierarchies.kept(self._groom)
        if kept is not None:
            return {"hierarchy": kept.hierarchy}
        return {"strands": self._groom.strands, "head": self._groom.head}

    def params(self, context: bpy.types.Context) -> Values:
        return {"n_strands": self.n_strands, "analysis": details.analysis_params(context)}

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        hierarchy = outputs["hierarchy"]
        space = lazy.bridge("hierarchies").space_of(self._groom)
        lazy.bridge("detail_assets").write(self._place, hierarchy, space, self._groom, sources["base"])
        size = self._place.stat().st_size / 1e6
        return f"Saved '{self._place.stem}': {hierarchy.levels[0].n_strands:,} strands, {size:.1f} MB"


CLASSES = (HAIRLOOM_OT_save_detail,)
