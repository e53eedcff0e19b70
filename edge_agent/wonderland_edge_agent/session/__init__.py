"""The eight steps of a proof, on the pad's side.

``machine`` is the explicit state machine: events in, actions out, no I/O and no clock of its own. ``gather`` turns the
reports of several nodes into rounds, ``evidence`` keeps what will come before the contract, ``runner`` is the thin
shell that performs the actions.
"""
