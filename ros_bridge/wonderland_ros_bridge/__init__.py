"""Topics of ROS as assets on the ledger, and what the ledger commits as topics.

``ledger`` is the half that knows no wire: messages in, assets out, and back. ``ros1`` is the wire of ROS 1.
"""
