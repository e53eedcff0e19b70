"""What is committed to the ledger, as a stream that can be taken up again where it was left: by block and index."""
