"""Whether blocks and transactions are what the channel's own configuration asks for; pure, without a connection.

Rooms: `channel_trust` whom a channel trusts from one config block to the next, and its policies · `block_checks`
the orderers' signatures of a block · `transaction_checks` who sent a transaction, what it is bound to, who endorsed it
· `light_client` all of it, from one block to the next.

What a peer alone says (validation codes, commit hashes) is signed by nobody in a block: nothing here believes it.
"""
