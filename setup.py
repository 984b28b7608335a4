"""Only what pyproject.toml cannot say: the version, whose single source is the extension's manifest."""

import tomllib
from pathlib import Path

from setuptools import setup

manifest = Path(__file__).parent / "addon" / "blender_manifest.toml"
setup(version=tomllib.loads(manifest.read_text(encoding="utf-8"))["version"])
