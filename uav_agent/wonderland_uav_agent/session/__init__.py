"""The eight steps of a proof on the drone: a machine without I/O, its words, and its own check of the ranges."""
