"""Is a broadcast supported by a proof: what the newest measurement allows to say about a drone's place later."""
