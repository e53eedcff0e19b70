"""Zenoh as a bus between agents and backends.

``settings``, ``identity``, ``keys``, ``access`` are pure but for reading PEM files; ``session`` speaks Zenoh.
"""
