"""Alerts in Finnish, from their kind and facts; the console has texts of its own, with units as its user likes them."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, Final

TEXTS: Final[Mapping[str, str]] = {
    "refuted": "{uav_id} ei ole siellä missä sanoo: mitattu {distance} päähän ilmoituksestaan alustalla {pad_id}.",
    "broadcast_contradicts": (
        "{uav_id} on allekirjoittanut lähetyksen muusta paikasta kuin alustalle {pad_id}: mitattu {distance} päähän "
        "siitä."
    ),
    "broadcast_unattributed": (
        "Joku lähettää tunnuksella {uav_id} {distance} päässä paikasta, johon {pad_id} sen mittasi: toisena esiintyjä "
        "tai droonin oma valhe."
    ),
    "stamps_contradict": (
        "{uav_id} vääristää kelloaan alustalla {pad_id}: siitä riippumattomat aikaleimat asettavat sen {distance} "
        "päähän ilmoituksestaan."
    ),
    "leaving": "{uav_id} oli lähdössä ilmoittamastaan paikasta alustalla {pad_id}, kun sitä mitattiin: kumottu.",
    "permission_unmatched": ("{uav_id} sai luvan alustalla {pad_id}; sen jälkeen sen lähetystä ei ole kuultu siellä."),
    "ledger_halted": "Tilikirjan peilaus on pysähtynyt; se sanoi: ”{why}”.",
    "unauthorised": "{uav_id} pyysi toimintoa {action} alustalla {pad_id} ilman lupaa.",
    "zone_closed": "{uav_id} pyysi toimintoa {action} alustalla {pad_id}, jonka {closed}.",
    "closures_ending": (
        "Alustan {pad_id} sulkuajat vyöhykkeiden vuoksi on julkaistu vain {until} asti; sen jälkeen siellä ei sallita "
        "mitään."
    ),
    "closures_differ": (
        "Tilikirja kertoo alustan {pad_id} sulkevista vyöhykkeistä muuta kuin tuodut vyöhykkeet: {state}. Julkaise "
        "uudelleen."
    ),
    "identity_odd": "{pad_id} kuulee outoa nimellä {uav_id}: {finding}.",
    "broadcast_odd": "{pad_id} kuulee outoa droonista {uav_id}: {finding}.",
    "broadcasts_flooded": (
        "{pad_id} kuulee outoja lähetyksiä yhtä aikaa {drones} nimellä; vain ensimmäisistä on oma hälytyksensä."
    ),
    "pad_silent": "Alusta {pad_id} ei ole raportoinut {since} jälkeen.",
    "pad_drifting": "Alusta {pad_id} ei enää mittaa kuten käyttöönotossa: {drift}.",
    "certificate_expiring": "Varmenne {who} vanhenee {until}.",
    "ledger_away": "Tilikirjaan ei saada yhteyttä: {answer}.",
}
FINDINGS: Final[Mapping[str, str]] = {
    "two_places": "sama tunnus kahdesta paikasta, välimatka {away}",
    "impossible_speed": "{away} ajassa {interval}, niin ei lennä mikään",
    "time_stuck": "sen oma aika seisoi {interval}",
    "time_backwards": "sen oma aika siirtyi taaksepäin {interval}, kuten toistossa",
    "time_off": "sen oma aika poikkeaa alustan ajasta {interval}",
    "several_identities": "sama lähetin käyttää myös nimeä {other}",
    "rate_high": "enemmän sijainteja kuin drooni lähettää",
    "signature_bad": "allekirjoitus ei pidä paikkaansa",
}
_STATES: Final = {"missing": "vyöhyke sulkee sen, mutta mitään ei ole julkaistu"}
_CHANGED: Final = "vyöhykkeet ovat sittemmin muuttuneet"
_ACTIONS: Final = {"land": "laskeutuminen", "takeoff": "lentoonlähtö", "dock": "telakointi"}


class _Known(dict[str, Any]):
    def __missing__(self, key: str) -> str:
        return "tuntematon"


def text(kind: str, facts: Mapping[str, Any]) -> str:
    """One sentence."""
    shown = _Known(facts)
    if "action" in facts:
        shown["action"] = _ACTIONS.get(facts["action"], facts["action"])
    if isinstance(facts.get("error_mm"), int):
        shown["distance"] = f"{facts['error_mm'] / 1000:.1f} m".replace(".", ",")
    for name in ("since", "until"):
        if isinstance(facts.get(f"{name}_ms"), int):
            shown[name] = _time(facts[f"{name}_ms"])
    shown["closed"] = _closed(facts)
    shown["drift"] = _drift(facts)
    shown["answer"] = "ei vastausta" if facts.get("state") == "no_answer" else f"”{shown['why']}”"
    shown["state"] = _STATES.get(str(facts.get("state")), _CHANGED)
    if "finding" in facts:
        shown["finding"] = _finding(facts)
    return TEXTS[kind].format_map(shown)


def _closed(facts: Mapping[str, Any]) -> str:
    if facts.get("code") == "closures_outdated":
        return "sulkuajat ovat vanhentuneet"
    return f"vyöhyke {facts['zone']} sulkee" if "zone" in facts else "vyöhyke sulkee"


def _drift(facts: Mapping[str, Any]) -> str:
    anchor, off_mm = facts.get("anchor_id"), facts.get("off_mm")
    if facts.get("state") == "moved" and anchor is not None and off_mm is not None:
        return f"ankkuri {anchor} on noin {off_mm / 10:.0f} cm paikaltaan, siellä ei todisteta mitään"
    added = f", epävarmuutta lisätään {facts['extra_sigma_mm']} mm" if facts.get("extra_sigma_mm") else ""
    return f"{f'ankkuri {anchor}' if anchor is not None else 'sen ankkurit yhdessä'}{added}"


def _finding(facts: Mapping[str, Any]) -> str:
    away = f"{facts['distance_mm'] / 1000:.0f} m".replace(".", ",") if "distance_mm" in facts else "pitkä matka"
    interval = f"{facts['interval_ms'] / 1000:.1f} s".replace(".", ",") if "interval_ms" in facts else "jonkin aikaa"
    found = FINDINGS.get(str(facts["finding"]), str(facts["finding"]))
    return found.format(away=away, interval=interval, other=facts.get("other_uav_id", "tuntematon"))


def _time(t_ms: int) -> str:
    when = datetime.fromtimestamp(t_ms / 1000, UTC)
    return f"{when.day}.{when.month}.{when.year} klo {when:%H.%M} UTC"
