"""On PYTHONPATH of a program that wants rclpy: packages of messages come from .msg files, as rosidl would make them."""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import os
import sys
import types
from pathlib import Path

from messages import PACKAGES, classes_of

_AT = os.environ.get("ROS_MESSAGES", "")


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    def find_spec(self, name, path=None, target=None):
        package, _, rest = name.partition(".")
        known = package in PACKAGES and rest in {"", "msg"}
        return importlib.machinery.ModuleSpec(name, self, is_package=True) if known else None

    def create_module(self, spec):
        return types.ModuleType(spec.name)

    def exec_module(self, module):
        package, _, rest = module.__name__.partition(".")
        if rest:
            vars(module).update(classes_of(package))


for each in Path(_AT).rglob("*.msg") if _AT else ():
    if each.parent.name == "msg":
        PACKAGES.setdefault(each.parent.parent.name, {})[each.stem] = each.read_text()
sys.meta_path.append(_Finder())
