"""The answer in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from backend.conformance.rules import Limit, Status
from backend.languages import Language

STATUS: Final[Mapping[Status, Mapping[Language, str]]] = {
    "supported": {
        "en": "A proof supports the broadcast.",
        "fi": "Todistus tukee lähetystä.",
    },
    "contradicted": {
        "en": "A proof contradicts the broadcast: the drone cannot be where it says.",
        "fi": "Todistus kumoaa lähetyksen: drooni ei voi olla siellä, missä se sanoo olevansa.",
    },
    "unproven": {
        "en": "No proof tells whether the broadcast is true.",
        "fi": "Mikään todistus ei kerro, onko lähetys totta.",
    },
    "unknown": {
        "en": "Nobody has registered or heard this drone here.",
        "fi": "Kukaan ei ole rekisteröinyt eikä kuullut tätä droonia täällä.",
    },
}
LIMITS: Final[Mapping[Limit, Mapping[Language, str]]] = {
    "not_registered": {
        "en": "The drone is not registered on the ledger.",
        "fi": "Droonia ei ole rekisteröity tilikirjaan.",
    },
    "never_heard": {
        "en": "No pad has heard a broadcast of it.",
        "fi": "Mikään alusta ei ole kuullut sen lähetystä.",
    },
    "broadcast_stale": {
        "en": "The last broadcast is more than a minute old.",
        "fi": "Viimeinen lähetys on yli minuutin vanha.",
    },
    "no_proof": {
        "en": "It has never proved its place at a pad.",
        "fi": "Se ei ole koskaan todistanut paikkaansa millään alustalla.",
    },
    "no_measured_place": {
        "en": "The proof has no measured place.",
        "fi": "Todistuksessa ei ole mitattua paikkaa.",
    },
    "assurance_too_low": {
        "en": "The proof's assurance is below what was asked for.",
        "fi": "Todistuksen varmuustaso on pyydettyä alempi.",
    },
    "too_far_or_too_long_ago": {
        "en": "Since the proof the drone can have flown further than was asked for.",
        "fi": "Todistuksen jälkeen drooni on ehtinyt lentää pyydettyä kauemmas.",
    },
    "last_proof_refuted": {
        "en": "In its last proof the drone was not where it said.",
        "fi": "Viimeisimmässä todistuksessa drooni ei ollut siellä, missä se sanoi olevansa.",
    },
    "last_proof_inconclusive": {
        "en": "Its last proof settled nothing.",
        "fi": "Sen viimeisin todistus ei ratkaissut asiaa.",
    },
    "broadcast_refuted": {
        "en": "The verdict refuted what it broadcast at the pad and signed for.",
        "fi": "Päätös kumosi sen, mitä drooni lähetti alustan luona ja allekirjoitti.",
    },
    "broadcast_unattributed": {
        "en": "At the pad somebody broadcast its serial number from elsewhere: an impostor, or its own lie.",
        "fi": "Alustan luona joku lähetti sen sarjanumeroa muualta: toisena esiintyjä tai droonin oma valhe.",
    },
    "speed_impossible": {
        "en": "From the measured place no drone could have come so far in that time.",
        "fi": "Mitatusta paikasta mikään drooni ei olisi ehtinyt siinä ajassa niin kauas.",
    },
}
