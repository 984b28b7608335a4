"""Give the active groom the details of another one."""

from __future__ import annotations

from typing import Any

import bpy

from .. import detail_library, details, lazy, material, scene
from ..jobs import JobOperator, Values


class TransferJob(JobOperator):
    """What the operators share that put details onto a groom: those of a groom or saved ones."""

    job = details.JOB

    def read(self, sources: dict[str, bpy.types.Object]) -> Values:
        self._transfer = details.prepare(sources, self.saved_detail(sources))
        return self._transfer.inputs

    def saved_detail(self, sources: dict[str, bpy.types.Object]) -> str:
        """The name of the saved detail that is applied; '' where the source is a groom."""
        return ""

    def params(self, context: bpy.types.Context) -> Values:
        return details.job_params(context, self._transfer)

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        self._transfer.keep(outputs)
        obj = self.write(context, sources, outputs)
        scene.select_only(context, obj)
        return f"{self._transfer.remarks()}{obj.name}: {_likeness(outputs['report'])}"

    def write(
        self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values
    ) -> bpy.types.Object:
        """The groom with the new strands: a new one that remembers where its details came from."""
        base, head, saved = sources["base"], sources["base_head"], self.saved_detail(sources)
        name = saved or sources["source"].name
        obj = lazy.bridge("transferred").new_result(f"{base.name} {name}", base, head, outputs, context.collection)
        obj.data.materials.append(material.material_of(base))
        details.remember(obj, sources, saved)
        return obj


def _likeness(report: dict[str, Any]) -> str:
    """How far the details are from those wanted, of the groom as it was and now; 0 is alike."""
    before, after = (report[name]["details"] for name in ("distance_before", "distance_after"))
    return f"{report['strands']:,} strands; distance from the details wanted {after:.2f}, before {before:.2f}"


class HAIRLOOM_OT_transfer_details(TransferJob, bpy.types.Operator):
    """Make a new groom with the shape of the active groom and the curls and wisps of the one chosen in Details From"""

    bl_idname = "hairloom.transfer_details"
    bl_label = "Transfer Details"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, details.why_no_transfer(context))

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        chosen = details.chosen_source(context)
        sources = {"source": chosen, "source_head": details.head_of_source(context), **details.base_and_head(context)}
        return {name: obj for name, obj in sources.items() if obj is not None}

    def saved_detail(self, sources: dict[str, bpy.types.Object]) -> str:
        saved = detail_library.detail_of(sources["source"])
        return saved.name if saved is not None else ""


CLASSES = (HAIRLOOM_OT_transfer_details,)
