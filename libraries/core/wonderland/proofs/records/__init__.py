"""Every record that the contract accepts, stores or emits: one definition each.

``schema`` holds the means of definition; the others hold the records by domain: ``pads``, ``uavs``, ``policies``,
``closures``, ``sessions``, ``verdicts``, ``assets``; ``transactions`` lists every transaction with its argument, roles
and event, and ``keys`` the ledger keys under which records stand.
"""
