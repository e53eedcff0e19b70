from __future__ import annotations

import messages


class Publisher:
    def __init__(self, kind, made):
        self._kind = kind
        self._made = made

    def publish(self, message):
        sent = messages.as_sent(self._made.session_mgr.store, self._kind, message)
        self._made.publish(**{name: getattr(sent, name) for name, _ in messages.fields_of(self._kind)[1]})

    def destroy(self):
        self._made.close()
