"""What a session has in common on the pad and on the drone: how it runs, and how it talks in the link.

``runner`` hands events and the time to a machine and performs its actions; ``words`` puts the proof's words into the
link's messages and understands the other side's; ``actions`` and ``events`` are those of both machines. The machines
(``wonderland_edge_agent.session``, ``wonderland_uav_agent.session``) are each side's own.
"""
