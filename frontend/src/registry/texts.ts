import fieldEn from "@messages/en/console/field.json";
import registryEn from "@messages/en/console/registry.json";
import fieldFi from "@messages/fi/console/field.json";
import registryFi from "@messages/fi/console/registry.json";
import { texts } from "../shared/i18n/texts";

/** The registry's pages. */
export const registryTexts = texts({ en: registryEn, fi: registryFi });

/** The names of the records' fields, by the last part of their path. */
export const fieldTexts = texts({ en: fieldEn, fi: fieldFi });
