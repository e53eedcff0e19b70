/** Zoom levels (MapLibre's: a world of 512 · 2^zoom pixels) at which the picture changes. */

/** The finer base map takes over here. */
export const FINE_ZOOM = 5;
/** Natural Earth's 1:10 million coast is a kilometre off in places: closer than this it would tell untruths. */
export const COAST_FADES: readonly [from: number, to: number] = [9.5, 12];
/** Around an archive's part of the world the coast stays for so many levels more. */
export const PLACE_FADES = 1;
/** Closer than this, a country's name says nothing. */
export const NAMES_END = 7;
/** Further away than this, pads that stand near each other are one mark. */
export const SITE_ZOOM = 9.5;
/** Closer than this, claims and measurements are drawn as ring and diamond instead of the verdict's symbol. */
export const CLOSE_ZOOM = 16.5;
/** Closer than this, a pad is its anchors' square and no longer a mark. */
export const SQUARE_ZOOM = 18.3;

/**
 * MapLibre reads a weight from the first name and takes the first family that there is: the bundled variable font, of
 * which no file is called "Medium".
 */
export const MEDIUM = ["Inter Medium", "Inter Variable"];
