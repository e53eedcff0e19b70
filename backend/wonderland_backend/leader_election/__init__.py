"""Several backends on one database: one is the leader, the others stand by."""
