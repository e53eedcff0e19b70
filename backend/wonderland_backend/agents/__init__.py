"""Agents of pads and drones: whose they are, and which are connected."""
