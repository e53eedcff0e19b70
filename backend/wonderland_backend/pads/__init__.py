"""Landing pads: the ledger's record, where its anchors stand on the globe, and how the pad says that it is."""
