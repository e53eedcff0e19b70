"""The pad's agent: it hears requests from the ledger, ranges drones, brings evidence, and permits what was granted.

``session`` holds the eight steps as a machine without I/O and the shell that runs it; ``radios`` the four UWB nodes;
``receiver``, ``spool`` and ``uplink`` what is heard, kept and told; ``permission`` what a verdict switches on.
"""
