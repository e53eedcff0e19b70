"""What a committed verdict switches on: the pad's lights, its dock, its clearance; here a record of it."""

from wonderland_edge_agent.permission.permission import CommandPermission, LogPermission, Permission, Permissions

__all__ = ["CommandPermission", "LogPermission", "Permission", "Permissions"]
