"""Words for codes and facts: one catalogue for each language, as ICU messages in JSON, for every part of the product.

A catalogue is a folder of files (``en/reasons.json``), which translators' tools read and the console bundles. A message
names facts; their units are in their names, and each is shown as its language writes it: ``{error_mm}`` is "4.20 m"
and "4,20 m". What has no unit is a number to ICU (``{rounds, plural, …}``), or a text.
"""

from wonderland.messages.catalogue import LANGUAGES, Language, facts_of, keys_of, message_of, text

__all__ = ["LANGUAGES", "Language", "facts_of", "keys_of", "message_of", "text"]
