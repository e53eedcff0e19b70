"""Everything about the ledger that a client, an authority or a mirror needs; each part stands alone.

- `identity`, `attributes`, `signing`: who signs, and low-S ECDSA signatures as Fabric wants them.
- `gateway`: an asynchronous client of the Fabric Gateway; `connection`: connection.json, which says where it is.
- `blocks`, `transactions`, `channel_config`: blocks as plain Python. `checkpoints`: where a reader continues.
- `ca`: an organisation's certificate authority in a directory.
- `embedded`: a single-node ledger that speaks the same Gateway protocol.
"""

from typing import Final

__version__: Final = "0.1.0"
