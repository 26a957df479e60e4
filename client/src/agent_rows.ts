// Which agents the list shows, and in which order, without the page.
import type { AgentsState } from "./messages.ts";

type Row = AgentsState["rows"][number];

/** Bit, letter, words and style of each mark of an agent. */
export const MARKS = [
  [1, "F", "focal agent", "pd-focal"],
  [2, "E", "ego", "pd-ego"],
  [64, "!", "has a problem", "pd-bad"],
  [256, "", "locked", "pd-locked"],
  [128, "~", "trajectory no longer fits", "pd-warn"],
  [4, "N", "new", "pd-new"],
  [8, "e", "edited", "pd-edited"],
  [16, "L", "comes later than t = 0", "pd-later"],
  [32, "G", "is gone by t = 0", "pd-later"],
] as const;
const NEW = 4;
const MAIN = 3; // focal agent and ego are found by these words, too

export interface Filter {
  words: string;
  moving: boolean;
  new: boolean;
  /** Place of a kind; -1 for all. */
  kind: number;
}
export interface Order {
  /** Column of the rows; -1 for the order of the recording. */
  column: number;
  isDown: boolean;
}

/** After a click on a column: upwards, then downwards, then as recorded. */
export function nextOrder(order: Order, column: number): Order {
  if (order.column !== column) return { column, isDown: false };
  return order.isDown ? { column: -1, isDown: false } : { column, isDown: true };
}

function compare(a: Row, b: Row, column: number): number {
  if (column === 0) return a[0].localeCompare(b[0], undefined, { numeric: true });
  if (column === 4) return b[4] - a[4];
  const [one, other] = [a, b].map((row) => Number(row[column] ?? Number.POSITIVE_INFINITY));
  return one === other ? 0 : one - other;
}

/** Places of the rows that are shown, in order. */
export function arranged(rows: readonly Row[], kinds: AgentsState["kinds"], filter: Filter, order: Order): number[] {
  const words = filter.words.trim().toLowerCase().split(/\s+/).filter(Boolean);
  const shown = [...rows.keys()].filter((place) => {
    const [id, kind, , , marks, isMoving] = rows[place];
    const main = MARKS.filter(([bit]) => marks & bit & MAIN).map(([, , word]) => word);
    const text = [kinds[kind][0], id, ...main].join(" ").toLowerCase();
    return (
      words.every((word) => text.includes(word)) &&
      (!filter.moving || isMoving) &&
      (!filter.new || (marks & NEW) !== 0) &&
      (filter.kind < 0 || filter.kind === kind)
    );
  });
  if (order.column < 0) return shown;
  const sign = order.isDown ? -1 : 1;
  return shown.sort((a, b) => sign * compare(rows[a], rows[b], order.column) || a - b);
}
