"""How frames reach a receiver: one module for each wrapping that holds the bare messages of `wonderland_remote_id`."""
