"""The names of metrics that the dashboard and the alert rules ask for."""

import json
import re
from pathlib import Path

import yaml

DIRECTORY = Path(__file__).parents[2] / "deploy" / "monitoring"
_WORDS = {"or", "and", "unless", "by", "up"}
_LEFT_OUT = re.compile(r"\{[^}]*\}|\"[^\"]*\"|\bby \([^)]*\)|\[[^\]]*\]")
_NAME = re.compile(r"[A-Za-z_]\w*(?!\w|\s*\()")


def expressions():
    """Every PromQL expression, with where it stands."""
    for group in yaml.safe_load((DIRECTORY / "alerts.yml").read_text())["groups"]:
        for rule in group["rules"]:
            yield f"alert {rule['alert']}", rule["expr"]
    for panel in json.loads((DIRECTORY / "grafana-dashboard.json").read_text())["panels"]:
        for target in panel.get("targets", ()):
            yield f"panel {panel['title']}", target["expr"]


def names():
    """Metric by where it is asked for."""
    return {
        name: where
        for where, expr in expressions()
        for name in _NAME.findall(_LEFT_OUT.sub(" ", expr))
        if name not in _WORDS
    }
