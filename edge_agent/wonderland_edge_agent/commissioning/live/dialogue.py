"""What a commissioning tells its operator, and asks."""

from __future__ import annotations

from typing import Protocol

from wonderland_edge_agent.commissioning.live.recorder import RunRecorder
from wonderland_edge_agent.commissioning.offline import Calibrated
from wonderland_edge_agent.self_survey import SelfSurvey


class Dialogue(Protocol):
    """Who sits in front of it."""

    def step(self, number: int, name: str, text: str) -> None:
        """Say that a step begins: its number from 1, its name, and what it does."""
        ...

    def say(self, text: str) -> None:
        """Say something that needs no answer."""
        ...

    def warn(self, text: str) -> None:
        """Something to look at."""
        ...

    def confirm(self, text: str) -> bool:
        """Whether it may go on."""
        ...

    def show_check(self, found: SelfSurvey) -> None:
        """Show what the anchors' ranges to each other say of the survey."""
        ...

    def progress(self, recorder: RunRecorder, seconds: float, reach_m: float, problem: str) -> None:
        """The run, twice a second."""
        ...

    def show_result(self, found: Calibrated) -> None:
        """Show the fit's biases and what the pad can verify with them (go or no-go)."""
        ...
