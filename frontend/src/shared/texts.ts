import { texts } from "./i18n/texts";

/** Numbers and times in words. */
export const formatTexts = texts({
  en: {
    now: "now",
    justNow: "just now",
    ago: "{age} ago",
    days: "{days}\u00a0d",
    word: "{value, select, 0 {No} 1 {One} 2 {Two} 3 {Three} 4 {Four} 5 {Five} 6 {Six} 7 {Seven} 8 {Eight} 9 {Nine} 10 {Ten} 11 {Eleven} 12 {Twelve} other {{figures}}}",
    verb: "{action, select, land {land} takeoff {take off} other {dock}}",
    noun: "{action, select, land {landing} takeoff {take-off} other {docking}}",
  },
  fi: {
    now: "nyt",
    justNow: "juuri nyt",
    ago: "{age} sitten",
    days: "{days}\u00a0pv",
    word: "{value, select, 0 {Ei yksikään} 1 {Yksi} 2 {Kaksi} 3 {Kolme} 4 {Neljä} 5 {Viisi} 6 {Kuusi} 7 {Seitsemän} 8 {Kahdeksan} 9 {Yhdeksän} 10 {Kymmenen} 11 {Yksitoista} 12 {Kaksitoista} other {{figures}}}",
    verb: "{action, select, land {laskeutua} takeoff {nousta} other {telakoitua}}",
    noun: "{action, select, land {laskeutuminen} takeoff {nousu} other {telakoituminen}}",
  },
});

/** The states of a drone, wherever its symbol stands. */
export const lookTexts = texts({
  en: {
    verified: "Verified",
    refuted: "Refuted",
    inconclusive: "Inconclusive",
    unproved: "No proof",
    "out-of-range": "Out of range",
    silent: "Silent",
    proving: "Being proved",
  },
  fi: {
    verified: "Vahvistettu",
    refuted: "Kumottu",
    inconclusive: "Ratkaisematta",
    unproved: "Ei todistusta",
    "out-of-range": "Kantaman ulkopuolella",
    silent: "Vaiti",
    proving: "Todistetaan",
  },
});

/** Words of the parts that every page shares. */
export const sharedTexts = texts({
  en: {
    copied: "copied",
    copy: "Copy {label} {value}",
    transaction: "transaction",
    tryAgain: "Try again",
    fetching: "Fetching…",
    replayThis: "Replay this",
    older: "Older",
    close: "Close",
    all: "all",
    filters: "Filters",
    clearFilters: "Clear filters",
    fromDay: "From",
    untilDay: "Until",
    asTable: "The same as a table",
  },
  fi: {
    copied: "kopioitu",
    copy: "Kopioi {label} {value}",
    transaction: "tapahtuma",
    tryAgain: "Yritä uudelleen",
    fetching: "Haetaan…",
    replayThis: "Toista tämä",
    older: "Vanhemmat",
    close: "Sulje",
    all: "kaikki",
    filters: "Rajaukset",
    clearFilters: "Poista rajaukset",
    fromDay: "Alkaen",
    untilDay: "Asti",
    asTable: "Sama taulukkona",
  },
});
