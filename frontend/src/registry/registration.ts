/** An operator's registration number (EN 4709-002): three characters after the dash are the operator's secret. */

const WITH_SECRET = /^([A-Za-z]{3}[A-Za-z0-9]{13})(?:-[A-Za-z0-9-]*|[A-Za-z0-9]{1,3})$/;
const PUBLIC = /^[A-Za-z]{3}[A-Za-z0-9]{13}$/;
const NUMBER = /^[A-Za-z0-9-]{1,32}$/;
const WHOLE = /^([A-Z]{3})([0-9a-z]{12})([0-9a-z])-([0-9a-z]{3})$/;

/** The number without what only the operator may know. */
export function publicPart(text: string): string {
  return WITH_SECRET.exec(text)?.[1] ?? text;
}

/** Luhn's check character over base 36. */
function checkCharacter(text: string): string {
  let total = 0;
  for (let place = 0; place < text.length; place++) {
    const code = parseInt(text.charAt(text.length - 1 - place), 36) * (place % 2 === 0 ? 2 : 1);
    total += Math.floor(code / 36) + (code % 36);
  }
  return ((36 - (total % 36)) % 36).toString(36);
}

/** The number of what was typed, as it is committed to; undefined for a whole number whose check character does not fit. */
export function readRegistration(text: string): string | undefined {
  if (publicPart(text) === text) return PUBLIC.test(text) ? text.slice(0, 3).toUpperCase() + text.slice(3).toLowerCase() : NUMBER.test(text) ? text : undefined;
  const [, country = "", number = "", check = "", secret = ""] = WHOLE.exec(text.slice(0, 3).toUpperCase() + text.slice(3).toLowerCase()) ?? [];
  return country !== "" && checkCharacter(number + secret) === check ? country + number + check : undefined;
}
