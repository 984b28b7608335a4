"""The jobs that the worker process and the add-on can run by name, with values that travel in a bundle."""

from __future__ import annotations

import importlib
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from .errors import InputError, require
from .progress import NO_PROGRESS, Progress

Values = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Job:
    """A job: `run` is 'module:function' of (inputs, params, progress) -> outputs; `params` 'module:class' or None.

    Names, not functions, so that listing the jobs imports nothing heavy.
    """

    run: str
    params: str | None = None


JOBS: Mapping[str, Job] = {
    "clean_up": Job(".jobs.clean_up:run", ".geometry.cleanup:CleanUpParams"),
    "cluster_wisps": Job(".jobs.cluster_wisps:run", ".synthesis.pipeline:SynthesisParams"),
    "fit_helices": Job(".jobs.fit_helices:run", ".rods.fitting:FitParams"),
    "four_view_directions": Job(".jobs.four_view:run_directions", ".fourview.pipeline:FourViewParams"),
    "four_view_place": Job(".jobs.four_view:run_place"),
    "four_view_segment": Job(".jobs.four_view:run_segment", ".jobs.four_view:SegmentParams"),
    "four_view_shape": Job(".jobs.four_view:run_shape", ".fourview.pipeline:FourViewParams"),
    "four_view_strands": Job(".jobs.four_view:run_strands", ".fourview.pipeline:FourViewParams"),
    "four_view_texture": Job(".jobs.four_view:run_texture", ".fourview.pipeline:FourViewParams"),
    "make_guides": Job(".jobs.make_guides:run", ".rods.guides:GuideParams"),
    "save_detail": Job(".jobs.save_detail:run", ".jobs.save_detail:SaveDetailParams"),
    "simulate": Job(".jobs.simulate:run", ".jobs.simulate:SimulateParams"),
    "synthesize": Job(".jobs.synthesize:run", ".synthesis.pipeline:SynthesisParams"),
    "transfer_details": Job(".jobs.transfer_details:run", ".jobs.transfer_details:TransferJobParams"),
    "warm_up": Job(".jobs.warm_up:run"),
}


def _load(name: str) -> Any:
    module, attribute = name.split(":")
    return getattr(importlib.import_module(module, __package__), attribute)


def build_params(cls: type, values: Mapping[str, Any]) -> Any:
    """A Params dataclass from a (nested) dict, as JSON gives it; what is missing keeps its default.

    Raises
    ------
    InputError : a name that the class does not have, or a value of the wrong kind.
    """
    hints = typing.get_type_hints(cls)
    known = {f.name for f in fields(cls)}
    for name in values:
        require(name in known, f"{cls.__name__} has no setting '{name}'; it has {', '.join(sorted(known))}")
    return cls(**{name: _convert(f"{cls.__name__}.{name}", hints[name], value) for name, value in values.items()})


def _convert(name: str, hint: Any, value: Any) -> Any:
    if is_dataclass(hint) and isinstance(hint, type):
        require(isinstance(value, Mapping), f"{name} must be a group of settings, not {value!r}")
        return build_params(hint, value)
    origin = typing.get_origin(hint)
    if origin is tuple and isinstance(value, list | tuple):
        return tuple(value)
    if origin in (typing.Union, types.UnionType):
        return value
    plain: dict[Any, tuple[type, ...]] = {bool: (bool,), int: (int,), float: (int, float), str: (str,)}
    wanted = plain.get(hint)
    if wanted is None:
        return value
    if not isinstance(value, wanted) or (isinstance(value, bool) and hint is not bool):
        raise InputError(f"{name} must be {hint.__name__}, not {value!r}")
    return hint(value)


def run_job(name: str, inputs: Values, params: Mapping[str, Any], progress: Progress = NO_PROGRESS) -> Values:
    """Run the job `name` and return its outputs.

    Raises
    ------
    InputError : no such job, bad settings or bad input. Cancelled : as `progress` says.
    """
    require(name in JOBS, f"there is no job '{name}'; the jobs are {', '.join(JOBS)}")
    job = JOBS[name]
    settings = build_params(_load(job.params), params) if job.params else None
    run: Callable[[Values, Any, Progress], Values] = _load(job.run)
    return run(inputs, settings, progress)
