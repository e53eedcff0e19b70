"""From the ledger's blocks to rows: read, check, derive, write with the checkpoint, tell; or halt.

``derive`` turns a block into rows without I/O, ``store`` writes them with the checkpoint in one database transaction,
``follow`` keeps at it, ``source`` is where blocks come from, ``rebuild`` starts over and proves identical content.
"""
