import { texts } from "../shared/i18n/texts";

/** The live page alone: the last hour, the wall display, what is announced. */
export const liveTexts = texts({
  en: {
    proof: "Proof",
    notInAir: "{who} is not in the air just now.",
    itsVerdicts: "Its verdicts",
    lastHour: "Verdicts of the last hour",
    binCount: "{outcome, select, refuted {{count} refuted} inconclusive {{count} inconclusive} other {{count} verified}}",
    noVerdict: "no verdict",
    hourSummary: "last hour: {total} verdicts, {verified} verified, {inconclusive} inconclusive, {refuted} refuted",
    hourTotal: "last hour · {total} verdicts",
    wallLeave: "Escape leaves the wall display",
    wallQuiet: "Nobody was refused in the last half hour.",
    wallRefused: "{count, plural, one {One refusal in the last half hour} other {# refusals in the last half hour}}",
    wallWhere: "{who} at {pad}",
    announce: "{who}: {outcome, select, verified {verified} refuted {refuted} other {inconclusive}} at {pad}.",
    announceMany: "{total} verdicts: {verified} verified, {inconclusive} inconclusive, {refuted} refuted.",
    announceWho: "Refuted: {who}.",
  },
  fi: {
    proof: "Todistus",
    notInAir: "{who} ei ole juuri nyt ilmassa.",
    itsVerdicts: "Sen päätökset",
    lastHour: "Viime tunnin päätökset",
    binCount: "{outcome, select, refuted {{count} kumottu} inconclusive {{count} ratkaisematta} other {{count} vahvistettu}}",
    noVerdict: "ei päätöksiä",
    hourSummary: "viime tunti: {total} päätöstä, {verified} vahvistettu, {inconclusive} ratkaisematta, {refuted} kumottu",
    hourTotal: "viime tunti · {total} päätöstä",
    wallLeave: "Esc lopettaa seinänäytön",
    wallQuiet: "Ketään ei ole torjuttu viime puolen tunnin aikana.",
    wallRefused: "{count, plural, one {Yksi torjunta viime puolen tunnin aikana} other {# torjuntaa viime puolen tunnin aikana}}",
    wallWhere: "{who}, {pad}",
    announce: "{who}: {outcome, select, verified {vahvistettu} refuted {kumottu} other {ratkaisematta}}, {pad}.",
    announceMany: "{total} päätöstä: {verified} vahvistettu, {inconclusive} ratkaisematta, {refuted} kumottu.",
    announceWho: "Kumottu: {who}.",
  },
});
