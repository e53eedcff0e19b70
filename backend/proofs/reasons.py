"""The contract's reasons in Finnish, by their code; the contract itself writes them in English, with their figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from backend.languages import Language

FINNISH: Final[Mapping[str, str]] = {
    "within_buffer": "Mitattu paikka on puskurin sisällä.",
    "outside_buffer": "Mitattu paikka on puskurin ulkopuolella.",
    "cannot_refute": "Liian vähän ankkureita tai liian ristiriitaiset etäisyydet kumoamiseen.",
    "undecided": "Mittaus ei vielä ratkaise asiaa.",
    "assurance_too_low": "Varmuustaso ei täytä sääntöjen vaatimusta.",
    "claim_far_away": "Ilmoitettu paikka ei ole lähelläkään tätä alustaa.",
    "rounds_not_fresh": "Kierroksia mitattiin istunnon ajan ulkopuolella.",
    "frames_not_fresh": "Kehyksiä aikaleimattiin istunnon ajan ulkopuolella.",
    "claims_not_fresh": "Ilmoituksia tehtiin istunnon ajan ulkopuolella.",
    "claims_go_back": "Ilmoitusten ajat kulkevat taaksepäin.",
    "time_goes_back": "Kierrosten ajat kulkevat taaksepäin.",
    "claim_vague": "Ilmoitus on liian epätarkka todistaakseen mitään.",
    "claim_height_vague": "Ilmoitettu korkeus on liian epätarkka.",
    "claims_jump": "Ilmoitukset hyppäävät: yksikään drooni ei lennä niin.",
    "codes_not_matched": "Istunnon koodit eivät täsmänneet UWB:llä: toinen drooni tai toisto.",
    "not_countersigned": "Drooni ei allekirjoittanut etäisyyksiä.",
    "countersignature_invalid": "Droonin allekirjoitus ei sovi näihin etäisyyksiin ja ilmoituksiin.",
    "session_stopped": "Alusta lopetti ennen aikojaan.",
    "too_few_rounds": "Käyttökelpoisia kierroksia on liian vähän.",
    "rounds_missing": (
        "Liian moni yritetty kierros jäi vajaaksi: näin näyttää drooni, joka valitsee kierroksensa tai vaientaa "
        "yksittäisiä ankkureita."
    ),
    "anchor_rarely": "Ankkuri jätettiin pois: se mittasi liian harvassa kierroksessa.",
    "claims_torn": "Osassa kierroksista ankkurit kumoavat sen, mitä muissa ilmoitettiin: ilmoitukset hyppivät.",
    "rounds_vague": "Kierroksia jätettiin pois: niissä mitanneet ankkurit sopivat toiseenkin paikkaan.",
    "claims_unjudged": "Osa ilmoituksista tehtiin muulloin kuin mitattaessa, muualla: niitä ei mitattu.",
    "claims_unseen": "Osa ilmoituksista poikkeaa lennosta, jonka kierrosten ilmoitukset näyttävät.",
    "claims_waver": "Ilmoitukset voivat heilua droonin paikan ympärillä: todistettu on keskiarvo, ei jokainen niistä.",
    "request_unjudged": "Pyyntö tehtiin muualta ennen mittausta: sitä paikkaa mikään ei mitannut.",
    "obstructed": "Etäisyyksiä jätettiin pois: ankkurit näkivät esteen.",
    "anchor_silent": "Osa ankkureista ei mitannut mitään käyttökelpoista.",
    "no_estimate": "Näistä etäisyyksistä ei saada paikkaa.",
    "ranges_inconsistent": "Etäisyydet ovat keskenään ristiriidassa.",
    "anchor_suspected": "Ankkurin epäillään mittaavan väärin.",
    "mirror_ambiguity": "Ankkurien geometriaan sopii kaksi paikkaa.",
    "bursts": "Etäisyyksiä jätettiin pois virhepurskeina.",
    "cannot_settle": "Alusta ei tässä paikassa voi ratkaista asiaa.",
    "height_claimed": "Korkeus on droonin sana; todistettu on paikka kartalla.",
    "height_proved": "Myös korkeus on mitattu, puskurin sisällä ilmoitetusta.",
    "height_contradicts": "Drooni mitattiin muulta korkeudelta kuin se ilmoittaa.",
    "height_doubted": "Etäisyydet asettavat droonin muulle korkeudelle kuin se ilmoittaa; asia ei ole ratkennut.",
    "height_not_proved": "Korkeutta ei ole todistettu, ja säännöt vaativat sen.",
    "unchecked": "Vain kolme ankkuria mittasi; mikään ei tarkista niitä toisiaan vasten.",
    "upper_bound": "Kaksisuuntainen mittaus todistaa vain, kuinka kaukana drooni enintään on.",
    "time_differences_prove": "Kehysten aikaleimat yksin todistavat droonin olevan puskurin sisällä.",
    "time_differences_vague": "Aikaleimat sopivat ilmoitukseen, mutta kertovat tässä paikassa liian vähän.",
    "time_differences_contradict": "Kehysten aikaleimat sulkevat pois jokaisen paikan puskurissa.",
    "time_differences_disagree": "Mikään paikka ei selitä sekä aikaleimoja että etäisyyksiä.",
    "time_differences_inconsistent": "Ankkurien kellot ovat keskenään ristiriidassa.",
    "clock_suspected": "Yhden ankkurin kellon epäillään käyvän väärin: ilman sitä aikaleimat sopivat yhteen.",
    "time_differences_unbound": "Mikään ei sido kuultuja kehyksiä tähän istuntoon.",
    "no_time_stamps": "Alusta ei tuonut tarpeeksi aikaleimoja yhteisellä kellolla.",
    "no_witness": "Todistaja-alusta ei tuonut tarpeeksi aikaleimoja.",
    "witness_prove": "Todistaja-alustan aikaleimat yksin todistavat droonin olevan puskurin sisällä.",
    "witness_vague": "Todistaja-alustan aikaleimat sopivat ilmoitukseen, mutta kertovat liian vähän.",
    "witness_contradicts": "Todistaja-alustan aikaleimat sulkevat pois jokaisen paikan puskurissa.",
    "witness_inconsistent": "Todistaja-alustan kellot ovat keskenään ristiriidassa.",
    "witness_unbound": "Mikään ei sido todistaja-alustan kuulemia kehyksiä tähän istuntoon.",
    "measurements_contradict": "Etäisyydet kumoavat ilmoituksen ja aikaleimat todistavat sen: toinen on väärässä.",
    "clock_off": "Droonin kello on väärässä enemmän kuin sen nopeus sallii.",
    "clock_contradicts": "Mikään kello ei anna droonin ilmoittamia aikoja.",
    "anchors_unknown": "Osa ankkureista ei kuulu käyttöönotettuun alustaan.",
    "broadcast_own_contradicts": "Droonin itse allekirjoittama lähetys on ristiriidassa mitatun paikan kanssa.",
    "broadcast_contradicts": (
        "Joku lähettää droonin sarjanumeroa muualla kuin missä se mitattiin; kuka, sitä ei tiedetä."
    ),
    "broadcast_not_heard": "Droonin etätunnistusta ei kuultu, ja säännöt vaativat sen.",
    "broadcast_unsupported": "Droonin sarjanumerolla ei kuultu yhtään lähetystä, jota mittaus tukisi.",
    "broadcast_undecided": "Lähetys ei vielä täsmää eikä ole ristiriidassa mitatun paikan kanssa.",
    "leaving": "Uusimmat kierrokset sulkevat ilmoitetun paikan pois: drooni on lähtenyt siitä.",
    "drifting": "Uusimmat kierrokset loittonevat ilmoitetusta paikasta.",
    "pad_drifts": "Alusta ei enää mittaa kuten käyttöönotossa; epävarmuutta on lisätty.",
    "zone_active": "Ilmatilavyöhyke kieltää toiminnon tällä alustalla.",
    "closures_outdated": "Vyöhykkeiden sulkuajat tällä alustalla ovat vanhentuneet; mitään ei sallita.",
    "maintenance_missing": "Droonin huollosta ei ole merkintää.",
    "maintenance_lapsed": "Droonin viimeinen kirjattu huolto ei ole enää voimassa.",
}


def reasons_in(language: Language, reasons: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The reasons with their texts in a language; in English where it has no word for one."""
    if language == "en":
        return reasons
    return [reason | {"text": FINNISH.get(reason["code"], reason["text"])} for reason in reasons]
