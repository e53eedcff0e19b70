"""Several backends behind one console: one is on duty, the others show what it shows and pass on the rest."""
