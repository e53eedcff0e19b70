from __future__ import annotations


class Subscription:
    def __init__(self, made):
        self._made = made

    def destroy(self):
        self._made.close()
