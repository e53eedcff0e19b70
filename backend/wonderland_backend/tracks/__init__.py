"""Positions that drones broadcast, as pads heard them. Nothing here is verified."""
