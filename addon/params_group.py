"""What the groups of settings share that stand for a Params class of the backend."""

from __future__ import annotations

from typing import Any


class ParamsGroup:
    """Mixin: a PropertyGroup whose properties are the fields of a Params class."""

    def to_params(self) -> dict[str, Any]:
        """The settings as a nested dict, as `registry.run_job` takes them."""
        return {name: plain_value(getattr(self, name)) for name in self.setting_names()}

    @classmethod
    def setting_names(cls) -> tuple[str, ...]:
        """The settings of this group in order, groups within it included."""
        return tuple(cls.__annotations__)


def plain_value(value: Any) -> Any:
    """A property's value as JSON takes it."""
    if isinstance(value, ParamsGroup):
        return value.to_params()
    if isinstance(value, float):
        # Blender keeps float32; back to the number that was typed, so that panel and command line agree to the bit
        return float(f"{value:.7g}")
    return value
