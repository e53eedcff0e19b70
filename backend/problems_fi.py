"""Problems in Finnish: the title of each kind, and the details that users of the API meet most, by their English text.

What is not here has figures or names in it and stays English; `type` says to programs what a problem is.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

TITLES: Final[Mapping[str, str]] = {
    "bad-request": "Virheellinen pyyntö",
    "bad-view": "Virheellinen näkymä",
    "ceremony-over": "Tunnistautuminen on vanhentunut",
    "conflict": "Ristiriita",
    "database-busy": "Tietokanta on varattu",
    "forbidden": "Ei sallittu",
    "foreign-origin": "Pyyntö vieraalta sivulta",
    "insufficient-scope": "Oikeudet eivät riitä",
    "internal": "Palvelimen virhe",
    "invalid-request": "Pyyntöä ei voi käsitellä",
    "invalid-token": "Kelpaamaton tunniste",
    "ledger-away": "Tilikirjaan ei saada yhteyttä",
    "method-not-allowed": "Menetelmä ei ole käytössä",
    "not-found": "Ei löytynyt",
    "not-the-owner": "Ei omistaja",
    "precondition-failed": "Muuttunut sillä välin",
    "provider-away": "Toinen palvelu ei vastaa",
    "switched-off": "Pois käytöstä",
    "set-up-required": "Palvelinta ei ole otettu käyttöön",
    "sign-in-required": "Kirjautuminen vaaditaan",
    "test-conflict": "Ristiriita testien välillä",
    "too-large": "Liian suuri",
    "too-many-requests": "Liian monta pyyntöä",
    "unknown-host": "Tuntematon palvelimen nimi",
    "version-conflict": "Versioiden ristiriita",
    "view-too-large": "Liian suuri näkymä",
}
"""By the end of a problem's `type`."""

DETAILS: Final[Mapping[str, str]] = {
    "This is not what you saw (If-Match): it has changed since. Look at it again, then change it.": (
        "Tämä on muuttunut sen jälkeen, kun luit sen (If-Match). Lue se uudelleen ja muuta sitten."
    ),
    "Sign in first.": "Kirjaudu ensin.",
    "Live GeoJSON is switched off on this server; its administrator can switch it on (outputs.live_geojson).": (
        "Reaaliaikainen GeoJSON ei ole käytössä tällä palvelimella; ylläpitäjä voi ottaa sen käyttöön "
        "(outputs.live_geojson)."
    ),
    "This account is suspended; an administrator can lift that.": (
        "Tili on jäädytetty; ylläpitäjä voi palauttaa sen käyttöön."
    ),
    "This is not open to machines; a person has to sign in.": (
        "Tämä ei ole avoinna koneille: henkilön on kirjauduttava."
    ),
    "A bearer token is needed (Authorization: Bearer …).": "Tarvitaan tunniste (Authorization: Bearer …).",
    "Authorization is not a bearer token.": "Authorization-otsakkeessa ei ole Bearer-tunnistetta.",
    "The token is no JWT.": "Tunniste ei ole JWT.",
    "The token is not signed by RS256 or ES256.": "Tunnistetta ei ole allekirjoitettu algoritmilla RS256 tai ES256.",
    "The token is not of an issuer that is believed here.": "Tunnisteen myöntäjään ei luoteta täällä.",
    "The token's signature is not its issuer's.": "Tunnisteen allekirjoitus ei ole sen myöntäjän.",
    "The token's key is none of its issuer's.": "Tunnisteen avain ei kuulu sen myöntäjälle.",
    "The token's key is not known, and its issuer's keys cannot be fetched just now.": (
        "Tunnisteen avainta ei tunneta, eikä sen myöntäjän avaimia saada juuri nyt."
    ),
    "The token has expired.": "Tunniste on vanhentunut.",
    "The token is good for longer than an hour; ask for one that is not.": (
        "Tunniste on voimassa yli tunnin; pyydä lyhytikäisempi."
    ),
    "The token is for somebody else: its aud is not this server's name.": (
        "Tunniste on tarkoitettu muulle: sen aud ei ole tämän palvelimen nimi."
    ),
    "The token is bound to a certificate, and the connection shows none.": (
        "Tunniste on sidottu varmenteeseen, eikä yhteydessä ole varmennetta."
    ),
    "The token is bound to another certificate than the connection shows.": (
        "Tunniste on sidottu muuhun varmenteeseen kuin yhteydessä on."
    ),
    "The client was revoked.": "Asiakasohjelma on suljettu pois.",
    "The request has fields or parameters that are not allowed; each is named in `errors`.": (
        "Pyynnössä on kenttiä tai parametreja, joita ei sallita; `errors` nimeää ne."
    ),
    "The database has no connection free just now; ask again in some seconds.": (
        "Tietokannassa ei ole juuri nyt vapaata yhteyttä; yritä uudelleen muutaman sekunnin kuluttua."
    ),
    "There is nothing at this address; see /api/v1/openapi.json for what there is.": (
        "Tässä osoitteessa ei ole mitään; /api/v1/openapi.json kertoo, mitä on."
    ),
    "This address does not take that method; the Allow header says which it takes.": (
        "Tämä osoite ei ota vastaan tätä menetelmää; Allow-otsake kertoo, mitä se ottaa."
    ),
    "Requests from pages of other origins are refused.": "Pyynnöt muiden sivustojen sivuilta hylätään.",
    "No proof with this id is on the ledger, as far as it was mirrored.": (
        "Tilikirjassa ei ole tällä tunnuksella todistusta, sikäli kuin se on peilattu."
    ),
    "No session with this id is on the ledger, as far as it was mirrored.": (
        "Tilikirjassa ei ole tällä tunnuksella istuntoa, sikäli kuin se on peilattu."
    ),
    "No transaction with this id is on the ledger, as far as it was mirrored.": (
        "Tilikirjassa ei ole tällä tunnuksella tapahtumaa, sikäli kuin se on peilattu."
    ),
    "There is no such flight; they are kept as long as positions are.": (
        "Tällaista lentoa ei ole; lennot säilytetään yhtä kauan kuin sijainnit."
    ),
    "There is no such alert.": "Tällaista hälytystä ei ole.",
    "There is no such subscription.": "Tällaista tilausta ei ole.",
    "There is no such delivery; they are kept for two weeks.": (
        "Tällaista toimitusta ei ole; ne säilytetään kaksi viikkoa."
    ),
    "There is no such request.": "Tällaista pyyntöä ei ole.",
    "As many streams are open as this server has; try again later, or ask without a stream.": (
        "Palvelimen kaikki tapahtumavirrat ovat käytössä; yritä myöhemmin tai hae ilman virtaa."
    ),
    "The first request with this key is under way; ask again in a moment.": (
        "Ensimmäinen pyyntö tällä avaimella on kesken; kysy hetken kuluttua uudelleen."
    ),
    "This server has no ledger of its own to ask.": "Tällä palvelimella ei ole omaa tilikirjaa, jolta kysyä.",
}
