"""An officer at work: does what a person does with mouse and keys, and counts it."""

from __future__ import annotations

from playwright.sync_api import expect


class Officer:
    """``acts`` counts clicks and single keys; what is typed into a field counts as one act for each word."""

    def __init__(self, page):
        self.page = page
        self.acts = 0
        self.said = []

    def click(self, locator):
        locator.click()
        self.acts += 1

    def press(self, key):
        self.page.keyboard.press(key)
        self.acts += 1

    def type(self, text):
        self.page.keyboard.type(text)
        self.acts += len(text.split())

    def did(self, task, *, at_most):
        """The task is done: say how many acts it took, and hold it to that."""
        acts, self.acts = self.acts, 0
        self.said.append(f"{task}: {acts}")
        print(f"{task}: {acts} clicks, keys and words (at most {at_most})")
        assert acts <= at_most, f"{task} takes {acts} clicks, keys and words"


def seen(locator):
    """What the task was for is on the screen."""
    expect(locator).to_be_visible()
