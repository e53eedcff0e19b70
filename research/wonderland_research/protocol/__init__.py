"""Proof of the protocol: a symbolic model of the exchange, lemma by lemma and level by level, checked by ProVerif.

``model/`` the model itself · ``model.py`` what is in it · ``prover.py`` runs ProVerif · ``report.py`` tables ·
``command.py`` ``wonderland protocol``. What it says, and what it cannot: docs/protocol.md.
"""
