"""Plugins: how headsets, motion capture, robots, importers, metrics and suites come in."""

from vrbench.plugin.hookspecs import PLUGIN_API, hookimpl

__all__ = ["PLUGIN_API", "hookimpl"]
