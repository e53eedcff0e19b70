import keyEn from "@messages/en/console/key.json";
import replayKeyEn from "@messages/en/console/replay-key.json";
import keyFi from "@messages/fi/console/key.json";
import replayKeyFi from "@messages/fi/console/replay-key.json";
import { texts } from "../shared/i18n/texts";

export const keyTexts = texts({ en: keyEn, fi: keyFi });

export const replayKeyTexts = texts({ en: replayKeyEn, fi: replayKeyFi });
