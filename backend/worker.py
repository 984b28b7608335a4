"""The add-on's child process: one job, JSON lines out, values in bundles (npz), never pickle.

Started as a script of its own (Blender's Python starts isolated), so it finds its package from its own place.
Reads one JSON line {"job", "inputs", "outputs", "params", "package"} from standard input and prints JSON lines:
{"progress", "message"} while it works, then {"done": true}, {"error": one line} or {"crash": traceback}.
It leaves when standard input closes: the parent is gone.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import sys
import threading
import traceback
from pathlib import Path
from types import ModuleType
from typing import Any, TextIO

PACKAGE = "hairloom"


def _import_package(name: str) -> None:
    """Make the folder of this file importable as the package `name`, whatever the folder is called.

    The parent gives the name under which it has the package itself: compiled kernels remember the module that they
    are from, and both processes share the cache of them.
    """
    if name in sys.modules:
        return
    folder = Path(__file__).resolve().parent
    spec = importlib.util.spec_from_file_location(
        name, folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # the packages around it, empty: an import within the package looks up the first of them
    ancestor = name.rpartition(".")[0]
    while ancestor:
        sys.modules.setdefault(ancestor, ModuleType(ancestor))
        ancestor = ancestor.rpartition(".")[0]
    sys.modules[name] = module
    spec.loader.exec_module(module)


def _leave_with_parent(stream: TextIO) -> None:
    stream.read()
    os._exit(1)


def run_request(request: dict[str, Any], say: Any) -> None:
    """Run one request; `say` takes each message as a dict."""
    package = request.get("package", PACKAGE)
    registry, bundle, errors = (
        importlib.import_module(f"{package}.{name}") for name in ("registry", "io.bundle", "errors")
    )
    try:
        inputs = bundle.read_bundle(request["inputs"]) if request.get("inputs") else {}
        outputs = registry.run_job(
            request["job"],
            inputs,
            request.get("params") or {},
            lambda fraction, message: say({"progress": fraction, "message": message}),
        )
        bundle.write_bundle(request["outputs"], outputs)
    except errors.HairloomError as error:
        say({"error": str(error)})
    except MemoryError:
        say({"error": "not enough memory for this job; use fewer strands or a coarser grid"})
    except Exception:  # noqa: BLE001  the process border: the parent shows the traceback as a bug
        say({"crash": traceback.format_exc()})
    else:
        say({"done": True})


def main() -> int:
    """Serve one request from standard input."""
    channel = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    # libraries that write to standard output must not break the protocol
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())

    def say(message: dict[str, Any]) -> None:
        channel.write(json.dumps(message) + "\n")
        channel.flush()

    request = json.loads(sys.stdin.readline())
    _import_package(request.get("package", PACKAGE))
    threading.Thread(target=_leave_with_parent, args=(sys.stdin,), daemon=True).start()
    run_request(request, say)
    channel.flush()
    # the reader thread sits in read(); leave without waiting for it
    os._exit(0)


if __name__ == "__main__":
    main()
