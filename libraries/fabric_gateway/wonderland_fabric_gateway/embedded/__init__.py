"""A single-node ledger that speaks the Fabric Gateway's gRPC API: one process, SQLite, the same clients as Fabric.

It checks what Fabric checks (certificate chains, node OUs, revocation, signatures, endorsements, read versions), but
one machine holds every organisation's key: **it gives no multi-party trust**, and says so wherever it is used.

Rooms: `msp` who may sign · `genesis` the channel's configuration · `proposals`, `stub`, `endorser` running the
contract · `transactions`, `orderer`, `committer` from envelope to block · `state` SQLite ·
`seal`, `known_rows`, `recompute`, `comparison`, `integrity` whether what is stored is what was written · `gateway`,
`deliver`, `server` the gRPC side · `directory`, `administration` what lies on disk and how it is changed while it runs.
"""

from typing import Final

NOTICE: Final = (
    "Embedded ledger: one process holds the keys of all organisations, so it gives no multi-party trust. "
    "Use a Hyperledger Fabric network where the parties must not have to trust one operator."
)
"""What is said at every start, in connection.json, and to whoever asks the ledger what it is."""
