/** A label and where it may stand; places on the screen, CSS pixels. */
export type Label = {
  id: string;
  left: number;
  top: number;
  width: number;
  height: number;
  /** Lower comes first, and stays where there is no room for both. */
  rank: number;
  /** How far from its place it must keep: half the size of the symbol there. */
  clear: number;
  sides: readonly Side[];
  /** The size of what stands there where there is no room for all of it. */
  fewer?: { width: number; height: number };
};

export type Side = "above" | "below" | "left" | "right" | "middle";
export type Placed = { label: Label; left: number; top: number; side: Side; isLess?: true };

/** Squares of the screen that something stands on. */
const SQUARE = 6;
const GAP = 2;
/** Where there is no room beside its place, a label stands somewhat further away. */
const FURTHER = [0, 12, 24] as const;
/** And one that must stand, as far as this. */
const FAR = [...FURTHER, 40, 60, 85] as const;

/** What of the screen is taken, by squares of some pixels: a look-up costs the same however much is there. */
export class Occupied {
  private readonly columns: number;
  private readonly rows: number;
  private readonly taken: Uint8Array;

  constructor(width: number, height: number) {
    this.columns = Math.max(1, Math.ceil(width / SQUARE));
    this.rows = Math.max(1, Math.ceil(height / SQUARE));
    this.taken = new Uint8Array(this.columns * this.rows);
  }

  /** Takes a box; what lies outside the screen needs no taking. */
  take(left: number, top: number, width: number, height: number): void {
    const [from, to] = [Math.max(0, Math.floor(left / SQUARE)), Math.min(this.columns - 1, Math.floor((left + width) / SQUARE))];
    const last = Math.min(this.rows - 1, Math.floor((top + height) / SQUARE));
    for (let row = Math.max(0, Math.floor(top / SQUARE)); row <= last; row++) {
      if (to >= from) this.taken.fill(1, row * this.columns + from, row * this.columns + to + 1);
    }
  }

  /** Whether a box lies within the screen. */
  holds(left: number, top: number, width: number, height: number): boolean {
    return left >= 0 && top >= 0 && left + width <= this.columns * SQUARE && top + height <= this.rows * SQUARE;
  }

  /** Whether a box lies within the screen and nothing stands there. */
  isFree(left: number, top: number, width: number, height: number): boolean {
    if (!this.holds(left, top, width, height)) return false;
    const [from, to] = [Math.floor(left / SQUARE), Math.min(this.columns - 1, Math.floor((left + width) / SQUARE))];
    const last = Math.min(this.rows - 1, Math.floor((top + height) / SQUARE));
    for (let row = Math.floor(top / SQUARE); row <= last; row++) {
      for (let column = from; column <= to; column++) if (this.taken[row * this.columns + column] === 1) return false;
    }
    return true;
  }
}

function corner({ left, top, width, height, clear }: Label, side: Side, further: number): [left: number, top: number] {
  const away = clear + GAP + further;
  switch (side) {
    case "above":
      return [left - width / 2, top - away - height];
    case "below":
      return [left - width / 2, top + away];
    case "left":
      return [left - away - width, top - height / 2];
    case "right":
      return [left + away, top - height / 2];
    case "middle":
      return [left - width / 2, top - height / 2];
  }
}

/**
 * Gives each label a side where it covers nothing, the most important first; one that finds none is left out, unless its
 * rank is negative: that one stands anyway. A label stays on the side where it was as long as it can (`before`).
 */
export function place(labels: Label[], occupied: Occupied, before: ReadonlyMap<string, Side>, most: number): Placed[] {
  const result: Placed[] = [];
  labels.sort((a, b) => a.rank - b.rank);
  for (const label of labels) {
    if (result.length >= most) break;
    const was = before.get(label.id);
    const sides = was === undefined || !label.sides.includes(was) ? label.sides : [was, ...label.sides];
    const find = (each: Label, fits: "isFree" | "holds"): Placed | undefined => {
      for (const further of each.rank < 0 ? FAR : FURTHER) {
        for (const side of sides) {
          const [left, top] = corner(each, side, further);
          if (occupied[fits](left, top, each.width, each.height)) return { label, left, top, side };
        }
      }
      return undefined;
    };
    const fewer = label.fewer && { ...label, ...label.fewer };
    const found = find(label, "isFree") ?? (label.rank < 0 ? (find(label, "holds") ?? anyway(label, sides[0] ?? "above")) : fewer && less(find(fewer, "isFree")));
    if (found === undefined) continue;
    const { width, height } = found.isLess === true ? (fewer ?? label) : label;
    occupied.take(found.left, found.top, width, height);
    result.push(found);
  }
  return result;
}

function anyway(label: Label, side: Side): Placed {
  const [left, top] = corner(label, side, 0);
  return { label, left, top, side };
}

function less(found: Placed | undefined): Placed | undefined {
  return found && { ...found, isLess: true };
}
