"""Evidence of one session, in one file, that anybody can check without us.

`bundle` the file · `trust` what a verifier pins · `case` the bundle read as blocks and transactions · `derive` which
of them the verdict rests on · `steps` the numbered checks, `verify` runs them · `replay` the contract once more ·
`export` makes the file from any ledger, and is the only part that needs a connection.
"""
