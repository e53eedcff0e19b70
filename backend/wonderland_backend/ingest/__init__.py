"""What agents report: authenticated by their ledger identity, durable before it is acknowledged.

None of it is ever taken for the ledger's word.
"""
