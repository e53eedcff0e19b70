"""``wonderland doctor``: what is wrong with a machine's parts, and what to do about it."""
