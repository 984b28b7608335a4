"""Hairloom: hair modelling from examples. No import here is heavy; names load their module on first use."""

from __future__ import annotations
