"""Several backends on one database: one is on duty, the others stand by."""
